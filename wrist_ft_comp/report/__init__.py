"""
What a person reads: figures (``evaluation``), is that good (``verdict``), what to do (``advice``).

``report_content`` holds all of it, ``page`` lays it out. Nothing here opens a file.
"""
