"""One model to given data, and its judgement; read ``calibrate`` first, then ``auto_method``."""
