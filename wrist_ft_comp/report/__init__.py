"""
What a person reads: the verdict, its evidence, and a page with pictures.

Read ``evaluation`` (what a model leaves of the drift) and ``verdict`` (is that good?) first;
``coverage`` says what the recordings have seen and what to record next. ``report_content`` holds
all of it for a calibration or an evaluation, and ``page`` turns it into HTML with ``templates``
and ``pictures``. Nothing here opens a file: pages are text.
"""
