"""
A simulated sensor: heat flow, strain gauges, and a run of loads and rooms.

Read ``ft_sensor`` first.
"""
