"""One sensor, live or replayed; read ``compensator``, ``drift_tracker``, ``gaps_and_restarts``."""
