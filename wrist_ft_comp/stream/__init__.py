"""One sensor, live or replayed; read ``compensator``, ``drift_tracker``, ``thermal_memory``."""
