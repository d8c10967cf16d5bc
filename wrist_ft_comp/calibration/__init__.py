"""
From recordings to a judged model.

Read ``calibrate`` first: it checks the recordings (``data_checks``), identifies axis by axis what
was chosen (``settings``), by ``auto`` or by one of the ``paper_methods``, and hands a ``result``
back. Candidates are scored in ``cross_validation``, on folds that they did not see. ``chamber``
does the same for tables of a temperature chamber.
"""
