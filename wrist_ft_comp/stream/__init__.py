"""One sensor, live or replayed; read ``compensator``, ``drift_tracker``, ``temperature_gaps``."""
