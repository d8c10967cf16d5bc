"""What stands on a node's command line besides the values of its parameters."""
