"""
The only modules that import rclpy: two nodes, and what they are made of.

Read ``compensator_node`` first: it gives each other what it needs, and none knows the node.
"""
