"""The node's services, a file each."""
