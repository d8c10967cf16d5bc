"""
What a person reads: the verdict, its evidence, and a page with pictures.

Read ``evaluation`` and ``verdict`` first; ``page`` puts everything together.
"""
