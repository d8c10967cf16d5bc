"""
One sensor, live: wrenches and temperatures in, compensated wrenches out.

Read ``compensator`` first: it is what the node holds. Everything else is a part of it.
"""
