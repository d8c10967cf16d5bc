"""The simulated wrist of the package, which conducts heat, as it warms up."""

from judging import recording_of
import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.series import FloatArray
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation.ft_sensor import FtSensorSettings
from wrist_ft_comp.simulation.run import draw_run, drive, RunSettings, true_wrench

#: The duty cycle of the wrist changes this often, s.
DUTY_S = 1200.0


def warm_up(
    rng: np.random.Generator,
    seed: int,
    hours: float,
    *,
    loaded: bool = False,
    contact_n: FloatArray | float = 0.0,
) -> Recording:
    """Warm the heat-conducting wrist of a seed up; a contact pushes along z beside the loads."""
    sensor = ft_sensor.build_sensor(FtSensorSettings(), seed)
    starts = np.arange(0.0, hours * 3600, DUTY_S)
    levels = rng.uniform(0, 1, len(starts)) * (rng.random(len(starts)) > 0.35)
    force_n, torque_nm = (20.0, 1.0) if loaded else (0.0, 0.0)
    run = draw_run(
        RunSettings(tuple(starts), tuple(levels), force_n=force_n, torque_nm=torque_nm), rng
    )
    elapsed_s: FloatArray = np.arange(round(hours * 3600), dtype=float) + 0.5
    true = true_wrench(run, elapsed_s)
    true[:, AXES.index('force_z')] += contact_n
    driven = drive(run, elapsed_s)
    nodes_c = ft_sensor.trajectory(sensor, ft_sensor.start(sensor, float(driven[0, 1])), driven)
    measured = ft_sensor.measured_wrench(sensor, nodes_c[:-1], true)
    wrench = ft_sensor.digitised_wrench(sensor, measured, rng)
    return recording_of(ft_sensor.digitised_temperatures(sensor, nodes_c[:-1], rng), wrench, true)
