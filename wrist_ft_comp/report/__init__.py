"""
What a person reads: figures (``evaluation``), is that good (``verdict``), what to do (``advice``).

``report_content`` holds all of it, ``html_page`` lays it out.
"""
