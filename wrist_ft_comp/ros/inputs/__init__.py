"""Topics whose type the node has to find out, and temperatures in messages of any type."""
