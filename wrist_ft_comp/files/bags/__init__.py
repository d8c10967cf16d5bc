"""Bags of rosbag2; read ``bag`` first: it opens and writes by what is installed."""
