"""A simulated wrist with its sensor, whose node lives in ``ros``; read ``ft_sensor`` first."""
