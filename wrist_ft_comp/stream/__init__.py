"""
One sensor, live: wrenches and temperatures in, compensated wrenches out; no clock, no file.

Read ``compensator`` first: ``Compensator`` (``add_temperature``, ``correct``, ``go_live``) is what
the node holds. A temperature goes on to ``drift_tracker``, where the model is stepped, through
``timestamp_filter``; ``limits`` bound what is subtracted. ``warm_restart`` takes thermal memory
over a restart, ``tare`` averages a load, ``cell_averager`` makes the rows of the node's recording,
and ``input_checks`` watches for readings that no sensor makes.
"""
