"""
One model of a given structure to given data.

Read ``axis_data`` first, what is fitted for one axis, then ``bins`` and ``moments``, the sums that
every fit is made from: ``regression`` solves for gains, ``time_constants`` searches what is not
linear, ``standard_errors`` says how sure both are, and ``pool`` fits what ``auto`` averages. The
paper's methods are apart: ``pls`` is the outer model, ``pls_arx`` both.
"""
