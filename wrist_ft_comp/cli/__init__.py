"""The command line: the only prints. One file for each command."""
