"""
What a recording is, and what runs on it: batch and stream, one formula each.

Read ``signals`` first, then the grids, then upwards from ``arx`` to ``drift_model``.
"""
