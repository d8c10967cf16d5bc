"""The node that learns by itself: the diary that it keeps, and what becomes of a better model."""
