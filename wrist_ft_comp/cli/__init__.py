"""
The command line, and the only prints.

Read ``main`` first, then a command: ``calibrate``, ``evaluate``, ``compensate``, ``show``,
``demo`` or ``completion``, each ``add_arguments`` and ``run``. They share ``options`` (typed),
``paths`` (refusals before the work) and ``tables`` (what is printed). ``calibration_job`` is what
``calibrate`` runs and the node starts as a process; ``entry`` sets the environment first.
"""
