"""
One model of a given structure to given data.

Read ``problem`` first, then ``bins`` and ``moments``, what every fit is made from.
"""
