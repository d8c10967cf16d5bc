"""Worlds: see worlds_drawn; ``family(name, seed)`` draws one."""

from worlds_drawn import FAMILIES, family, World

__all__ = ['FAMILIES', 'World', 'family']
