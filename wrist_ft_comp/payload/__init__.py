"""Weight on the flange: fitted, separated from drift, taken off; read ``weight`` first."""
