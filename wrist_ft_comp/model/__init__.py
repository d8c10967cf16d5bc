"""
What a recording is and what runs on it, one formula for batch and stream; numpy only.

Read ``signals`` first (recordings, axes, units), then the two grids that average samples into
thermal cells (``batch_grid.grid_samples``, ``stream_grid.ThermalGrid``). The model from the inside
out: ``arx`` (one latent), ``arx_pls`` (outer and inner model), ``features``, ``axis_model`` (one
axis). What others use is on top: ``drift_model`` (``DriftModel`` with ``start``, ``step``,
``run``, ``correct``) and ``offline`` (``simulate_drift``, ``track_drift``, ``correct_many``).
Beside them, ``temperature_source`` knows how a person names a thermometer, and ``columns`` makes
recordings of tables in memory.
"""
