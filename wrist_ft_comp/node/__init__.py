"""The compensator, a list of parts, and the simulated sensor; read ``compensator_node`` first."""
