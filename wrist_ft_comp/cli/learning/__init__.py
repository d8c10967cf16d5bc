"""Learning from one day after another: the job that the node starts."""
