"""Jobs that take minutes; ``job_main`` is what runs in a process beside the node."""
