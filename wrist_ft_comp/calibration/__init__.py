"""
From recordings to a judged model, or to a refusal that says why.

Read ``calibrate`` first; it names the others in the order of their work.
"""
