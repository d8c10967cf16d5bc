"""A model that learns day by day; read ``lesson`` first, then ``day`` and ``challenge``."""
