"""The simulated sensor: heat, gauges, readings, and what drives it."""

import numpy as np
import pytest

from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.simulation import ft_sensor
from wrist_ft_comp.simulation.ft_sensor import build_sensor, CELLS, measured_wrench, RunSettings

UNLOADED = np.zeros(6)
LOAD = np.array([20.0, -30.0, 50.0, 1.0, -2.0, 0.5])


@pytest.fixture
def sensor():
    return build_sensor(1)


def test_stored_energy_is_the_heat_that_came_in_without_convection(monkeypatch):
    monkeypatch.setattr(ft_sensor, 'CONVECTION_W_PER_K', (1e-12, 0.0, 0.0))
    motor, body, tool = ft_sensor.CAPACITY_J_PER_K
    held = np.tile([0.5, 20.0], (600, 1))
    rise = ft_sensor.trajectory(build_sensor(1), 20.0, held)[-1] - 20.0
    stored_j = motor * rise[0] + body * rise[1:-1].mean() + tool * rise[-1]
    assert stored_j == pytest.approx(0.5 * ft_sensor.MOTOR_W * 600 * ft_sensor.STEP_S)


def test_bridge_agrees_with_circuit_analysis():
    rng = np.random.default_rng(0)
    resistances, changes = rng.uniform(340, 360, (20, 4)), rng.uniform(-2, 2, (20, 4))
    for r, d in zip(resistances, changes, strict=True):
        r1, r2, r3, r4 = r + d * [1, -1, 1, -1]
        # Kirchhoff at both output nodes, supply 1 V: r2 and r3 to the supply, r1 and r4 to 0 V.
        conductance = np.diag([1 / r1 + 1 / r2, 1 / r3 + 1 / r4])
        outputs_v = np.linalg.solve(conductance, [1 / r2, 1 / r3])
        assert ft_sensor.bridge_output(r, d) == pytest.approx(outputs_v[0] - outputs_v[1])


def test_the_gain_is_nominal_at_one_temperature_and_falls_by_0_04_percent_per_kelvin(sensor):
    def output_and_gain(temperature_c):
        nodes_c = np.full(CELLS + 2, temperature_c)
        unloaded = measured_wrench(sensor, nodes_c, UNLOADED)
        return unloaded, (measured_wrench(sensor, nodes_c, LOAD) - unloaded) / LOAD

    unloaded, gain = output_and_gain(ft_sensor.NOMINAL_C)
    np.testing.assert_allclose(unloaded, 0, atol=1e-9)
    np.testing.assert_allclose(gain, 1, rtol=1e-12)
    slope = (output_and_gain(45.0)[1] - output_and_gain(25.0)[1]) / 20.0
    np.testing.assert_allclose(slope, -4e-4, atol=0.3e-4)


@pytest.mark.parametrize('seed', range(10))
def test_warm_up_moves_force_z_by_5_to_20_newtons_for_every_specimen(seed):
    sensor = build_sensor(seed)
    nodes_c = ft_sensor.trajectory(sensor, 22.0, np.tile([1.0, 22.0], (5400, 1)))
    drift = np.ptp(measured_wrench(sensor, nodes_c, UNLOADED), axis=0)
    assert 5.0 < drift[2] < 20.0
    assert (drift[:3] > 2.0).all()
    assert (drift[3:] > 0.05).all()


def test_readings_lie_on_the_grid_of_the_converter(sensor):
    rng = np.random.default_rng(0)
    states_c = ft_sensor.trajectory(sensor, 22.0, np.tile([0.7, 26.0], (500, 1)))
    wrench = ft_sensor.digitised_wrench(measured_wrench(sensor, states_c, UNLOADED), rng)
    celsius = ft_sensor.digitised_temperatures(sensor, states_c, rng)
    for values, quantum in ((wrench, ft_sensor.QUANTUM), (celsius, 0.0625)):
        np.testing.assert_allclose(values / quantum, np.round(values / quantum), atol=1e-6)
    assert len(np.unique(wrench[:, 2])) > 10


def test_duty_cycle_is_piecewise_constant_and_0_before_the_first_start():
    chosen = RunSettings(duty_start_s=(10.0, 20.0), duty_level=(0.5, 0.9))
    run = ft_sensor.draw_run(chosen, np.random.default_rng(0))
    levels = ft_sensor.drive(run, np.array([0.0, 9.99, 10.0, 19.99, 20.0, 1e6]))[:, 0]
    np.testing.assert_array_equal(levels, [0, 0, 0.5, 0.5, 0.9, 0.9])


def test_loads_are_bounded_smooth_and_differ_between_axes():
    chosen = RunSettings(force_n=30.0, torque_nm=2.0)
    run = ft_sensor.draw_run(chosen, np.random.default_rng(0))
    wrench = ft_sensor.true_wrench(run, np.arange(0, 5000, 0.5))
    assert wrench.shape == (10_000, 6)
    largest = np.abs(wrench).max(axis=0)
    assert ((largest > [15] * 3 + [1] * 3) & (largest <= [30] * 3 + [2] * 3)).all()
    assert np.abs(np.diff(wrench[:, 2])).max() < 30 * 2 * np.pi / 60 * 1.6 * 0.5
    assert np.abs(np.corrcoef(wrench.T) - np.eye(6)).max() < 0.3


@pytest.mark.parametrize('starts_s', [(0.0,), (5.0, 5.0)])
def test_run_that_cannot_be_followed_is_refused(starts_s):
    with pytest.raises(SettingsError, match=r'ascend, s, and as many levels; got .*0\.1, 0\.2\]'):
        RunSettings(starts_s, (0.1, 0.2))
