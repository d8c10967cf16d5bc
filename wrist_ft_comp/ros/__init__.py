"""The nodes: the only modules that import rclpy."""
