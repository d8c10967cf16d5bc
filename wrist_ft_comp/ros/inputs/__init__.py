"""
Topics whose type the node has to find out.

``topic_types`` asks the graph what a topic carries, ``field_inputs`` takes temperatures out of
messages of any type.
"""
