"""
A simulated robot wrist with its sensor; the node that publishes it lives in ``ros``.

Read ``ft_sensor`` first (``build_sensor``, ``start``, ``simulate``), then what it stands on:
``heat_flow`` (conduction along the wrist) and ``strain_gauges`` (six bridges that drift). ``run``
draws what happens to it (``draw_run``, ``drive``, ``true_wrench``).
"""
