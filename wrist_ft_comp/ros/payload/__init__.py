"""The payload in operation: ``wrench_external``, and learning what is mounted."""
