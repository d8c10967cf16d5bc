"""
The only modules that import rclpy: two nodes, and what they are made of.

Read ``compensator_node`` first: it makes the others and gives each what it needs, and none knows
the node. ``input_health`` and ``diagnostics`` are what it says of itself, ``live_model`` and
``state_keeper`` what it is after a restart, ``services`` what can be asked of it. ``running`` is
how nodes start and end; ``executables`` are the entry points, which import no rclpy.
"""
