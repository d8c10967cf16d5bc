"""What is mounted on a sensor: found, separated from drift, subtracted; read ``weight`` first."""
