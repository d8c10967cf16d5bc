"""
The only modules that import rclpy: two nodes and what they are made of.

Read ``compensator_node`` first; its services are in ``services``.
"""
