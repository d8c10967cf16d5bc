"""What runs: temperature to drift, axis by axis; read ``drift_model`` first, then ``arx_pls``."""
