"""
The only modules that open files: recordings, models, states, and the store.

Read ``recordings`` and ``model_file`` first; the others are formats.
"""
