"""
The payload in operation: ``wrench_external``, and learning what is mounted.

Who does not ask for it pays nothing: ``ExternalWrench.on_wrench`` is None then.
"""
