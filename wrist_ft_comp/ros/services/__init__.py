"""The node's services, a file each, and ``recorder``; ``deferred`` lets one answer later."""
