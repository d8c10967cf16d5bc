"""One sensor, live or replayed; read ``compensator`` first, then ``drift_tracker`` and ``gap``."""
