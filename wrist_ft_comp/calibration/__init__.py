"""From recordings to a judged model; read ``calibrate`` first, then ``cross_validation``."""
