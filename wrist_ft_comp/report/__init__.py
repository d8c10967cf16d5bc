"""
What a person reads: the verdict, its evidence, and a page with pictures.

Read ``evaluation`` (what a model leaves of the drift) and ``verdict`` (is that good?) first;
``coverage`` and ``advice`` say what is missing. ``of_calibration`` and ``of_evaluation`` fill the
records of ``view``, which ``page`` turns into HTML by ``templates``, with ``pictures``. Nothing
here opens a file: pages are text.
"""

#: What every page names as its generator, by which it is known again.
GENERATOR = 'wrist_ft_comp report'
#: The same of every picture of its own.
PAINTER = 'wrist_ft_comp picture'
