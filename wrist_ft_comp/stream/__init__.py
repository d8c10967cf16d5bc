"""One sensor, live, without a clock or file; read ``compensator``, then ``drift_tracker``."""
