"""A simulated wrist with its sensor, whose node is in ``node``; read ``ft_sensor`` first."""
