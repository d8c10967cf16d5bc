"""The command line: arguments, exit codes, progress, and every print."""
