"""The command line, and the only prints; read ``main`` first, then a command, such as ``show``."""
