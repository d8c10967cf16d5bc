"""
What stands on a node's command line besides the values of its parameters.

``usage`` is what ``--help`` shows; ``unknown`` tells of parameters that the node does not have.
"""
