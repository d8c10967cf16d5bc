"""A model that learns day by day; read ``lesson`` first, then ``schedule`` and ``day``."""
