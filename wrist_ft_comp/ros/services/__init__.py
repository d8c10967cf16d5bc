"""
The node's services, a file each.

A service is given what it needs: the compensator, the present parameters, where to log, and what
remembers a refusal for the diagnostics. ``deferred`` lets a service answer later.
"""
