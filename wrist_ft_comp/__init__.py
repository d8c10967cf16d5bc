"""
Temperature-drift compensation for a robot's wrist force/torque sensor.

The rooms, and what each looks into besides ``errors``; no arrow points back:

- ``model``: what a recording is and what runs on it. Nothing.
- ``stream``: one sensor, live. ``model``.
- ``identification``: one model to given data. ``model``.
- ``calibration``: from recordings to a judged model. The three above.
- ``report``: what a person reads. ``model``, ``calibration``.
- ``files``: the only modules that open files. ``model``, ``stream``, ``calibration``.
- ``simulation``: the simulated sensor. ``model``.
- ``ros``: the only modules that import rclpy. All but ``cli``.
- ``cli``: the only prints. All; it may start what ``ros`` offers.
"""

__version__ = '0.2.0'

#: Environment in which numpy computes in one thread. The sums of a fit are too small for more:
#: on a busy computer threads that wait for one another cost it four times the processor time.
ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
