"""Jobs that take minutes; ``entry`` is what runs in a process beside the node."""
