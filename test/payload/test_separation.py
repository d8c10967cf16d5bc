"""Learnt at work: payload, contacts and tares apart from drift; and what is said of wrong data."""

from dataclasses import replace

import numpy as np
import pytest

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import CalibrationRefusedError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.payload import separation
from wrist_ft_comp.payload.accelerometer_calibration import calibrated_by_norm
from wrist_ft_comp.payload.separation import learn_at_work, separate, separate_again
from wrist_ft_comp.steps_in_recordings import Step

PLS = IdentificationSettings(method='pls')
AT_WORK = CalibrationSettings('payload', identification=PLS)
MASSES, CENTERS = [1.3, 2.1], [[0.01, -0.02, 0.09], [0.02, -0.01, 0.12]]


@pytest.fixture(scope='module')
def days(make_working_day):
    return [make_working_day(0, 1200), make_working_day(1, 1200)]


@pytest.fixture(scope='module')
def plain(make_working_day):
    """Work with a tool only: there is nothing to search for, which is quick."""
    return [make_working_day(seed, part=False) for seed in (0, 3)]


def test_steps_that_leave_no_stretch_are_refused(plain, monkeypatch):
    steps = [Step(cell, np.ones(6)) for cell in range(5, 1200, 5)]
    monkeypatch.setattr(separation, 'find_steps', lambda *_: steps)
    with pytest.raises(CalibrationRefusedError, match='so often that no stretch is left'):
        separate(plain)


@pytest.mark.parametrize(('noise', 'hangs'), [(0.002, True), (0.0, False)])
def test_the_time_in_which_an_imu_hangs_does_not_count(plain, noise, hangs):
    """Its driver repeats the last message; one without noise repeats itself at each rest."""
    day, rng = plain[0], np.random.default_rng(0)
    force = day.specific_force + noise * rng.standard_normal((1200, 3))
    speed = np.full(1200, 0.01) + noise * rng.random(1200)
    if hangs:
        force[900:], speed[900:] = force[900], speed[900]
    found = separate([replace(day, specific_force=force, rotation_speed=speed)])
    counts = np.isfinite(found.drift[0].wrench).all(axis=1)
    assert counts[:900].mean() > 0.7
    assert counts[901:].any() != hangs


def test_tool_and_part_are_found_lightest_first_beside_drift_and_contacts(days):
    learnt = calibrate(days, AT_WORK)
    for axis in ('force_x', 'force_z', 'torque_y'):
        assert learnt.fits[axis].rms_after < 0.15 * learnt.fits[axis].rms_before
    payloads = learnt.payloads.payloads.values()
    assert not learnt.warnings
    np.testing.assert_allclose([p.mass_kg for p in payloads], MASSES, rtol=0.003)
    np.testing.assert_allclose([p.center_m for p in payloads], CENTERS, atol=0.0005)
    np.testing.assert_allclose([p.share for p in payloads], 0.5, atol=0.05)


def without_drift(day):
    theta = (day.temperature_c - 20.0) * [0.3, -0.2, 0.5, 0.01, 0.02, -0.01]
    return day.wrench - theta


@pytest.mark.parametrize('by_tf', [True, False])
def test_by_tf_masses_of_a_robot_that_hardly_rests_are_doubted(plain, by_tf):
    day, rng = plain[0], np.random.default_rng(0)
    force = day.specific_force + (0.0 if by_tf else 0.02) * rng.normal(size=(1200, 3))
    speed = np.maximum(day.rotation_speed, np.tile([0.0, 0.1], 600))
    swinging = replace(day, specific_force=force, rotation_speed=speed)
    warnings = learn_at_work([swinging]).warnings
    assert any(said.startswith('TF does not show how') for said in warnings) == by_tf


JUMP = np.array([28.0, 39.0, 6.0, -0.2, 0.4, 0.6])


def warmer(n, lag, kelvin):
    """Sudden heat from a cell on, N and N m."""
    return np.outer(kelvin * (1 - np.exp(-n / lag)) * (n > 0), [0.1, 0.2, -1, 0, 0, 0])


def pressed(n, until):
    return np.outer((n >= 0) & (n < until), [9, -9, 30, 1, 1, 0.1])


class TestDrift:
    def test_contacts_do_not_count_and_the_rest_does(self, make_working_day):
        day = make_working_day(2, part=False)
        quiet = make_working_day(2, part=False, contacts=0.0)
        touched = np.abs(day.wrench - quiet.wrench).max(axis=1) > 1.0
        kept = np.isfinite(separate([day]).drift[0].wrench[:, 0])
        moving = day.rotation_speed > 0.5
        assert kept[touched].mean() < 0.02
        assert kept[~touched & ~moving].mean() > 0.95
        assert not kept[moving].any()

    def test_a_tare_of_the_driver_is_found_and_taken_out(self, make_working_day):
        tared = make_working_day(0, tare_at=907)
        found = separate([tared, make_working_day(1)])
        assert [[step.cell for step in steps] for steps in found.steps] == [[907], []]
        drift = found.drift[0].wrench - found.drift[0].reference
        left = drift - (tared.wrench - without_drift(tared))
        before, after = np.nanmean(left[:907], axis=0), np.nanmean(left[907:], axis=0)
        np.testing.assert_allclose(before, after, atol=0.25)

    @pytest.mark.parametrize(
        ('added', 'at'),
        [
            (lambda n: np.outer((n >= 120) | ((n >= 95) & (n < 97)), JUMP), [1020]),
            (lambda n: warmer(n + 40, 100, 60) + np.outer(n >= 0, JUMP / 4), [900]),
            (lambda n: warmer(n, 20, 25) + pressed(n, 24), []),
            (lambda n: warmer(n, 6, 25) + pressed(n, 14), []),
            (lambda n: np.outer((n >= -10) & (n < 12), JUMP / 4), []),
        ],
        ids=['a press like a tare', 'amid heat', *2 * ['heat behind a contact'], 'a bump'],
    )
    def test_tares_are_told_from_sudden_heat_and_contacts(self, plain, added, at):
        change = added(np.arange(len(plain[0])) - 900)
        (steps,) = separate([replace(plain[0], wrench=plain[0].wrench + change)]).steps
        assert [round(step.cell, -1) for step in steps] == at
        for step in steps:
            size = JUMP if at == [1020] else JUMP / 4
            np.testing.assert_allclose(step.jump, size, atol=1.8)

    def test_a_contact_beside_a_gap_does_not_count(self, plain):
        wrench = plain[1].wrench.copy()
        wrench[610:891] = np.nan
        wrench[892:899] += [-19, 4, -20, 1, 2, 0.3]
        found = separate([replace(plain[1], wrench=wrench)])
        assert found.steps == [[]]
        assert np.isnan(found.drift[0].wrench[892:899]).all()

    def test_beside_a_known_drift_a_long_press_is_neither_drift_nor_a_step(self, plain):
        day, cells = plain[1], np.arange(len(plain[1]))
        pressed = (cells >= 700) & (cells < 850)
        force = np.array([10, 10, 10, 1, 1, 1]) * pressed[:, None]
        rough = separate([replace(day, wrench=day.wrench + force)])
        again = separate_again(rough, [day.wrench - without_drift(day)])
        assert again.steps == [[]]
        assert not np.isfinite(again.drift[0].wrench[pressed]).any()
        assert np.isfinite(again.drift[0].wrench[~pressed]).mean() > 0.6

    def test_a_recording_without_an_axis_is_refused(self, plain):
        wrench = plain[1].wrench.copy()
        wrench[:, 4] = np.nan
        with pytest.raises(CalibrationRefusedError, match=r'no torque_y'):
            separate([plain[0], replace(plain[1], wrench=wrench)])

    def test_gain_drift_is_learnt_from_the_moving_weight(self, days):
        stretched = []
        for day in days:
            share = 1 + 0.002 * (day.temperature_c - 30.0)
            drift = day.wrench - without_drift(day)
            stretched.append(replace(day, wrench=share * without_drift(day) + drift))
        terms = calibrate(stretched, AT_WORK).fits['force_z']
        assert terms.model is not None
        assert len(terms.model.dynamics.output_mean) == 2


class TestAccelerometer:
    def test_bias_at_any_temperature_and_scale_are_found_by_the_norm_at_rest(self, days):
        bias, scale = np.array([0.1, -0.2, 0.05]), np.array([1.02, 0.99, 1.01])
        true, theta = days[0].specific_force, days[0].temperature_c - days[0].temperature_c.mean()
        measured = true * scale + bias + theta * [0.015, -0.01, 0.02]
        found = calibrated_by_norm([replace(days[0], specific_force=measured)])
        np.testing.assert_allclose(found.frame.scale, scale, rtol=0.005)
        np.testing.assert_allclose(found.frame.bias, bias, atol=0.03)
        np.testing.assert_allclose(found.forces[0], true, atol=0.05)

    def test_a_specific_force_in_g_is_refused(self, days):
        with pytest.raises(CalibrationRefusedError, match=r'is 1 at rest, and 9\.81'):
            calibrated_by_norm([replace(days[0], specific_force=days[0].specific_force / 9.807)])

    def test_a_robot_that_never_rests_weighs_its_tool(self, make_recording):
        """A cell that turns holds the mean of a vector that turns, which is no scale error."""
        n, rng = np.arange(7200), np.random.default_rng(0)
        tilt, turn = 0.3 * n, 0.11 * n
        up = np.stack((np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)))
        weight = -1.5 * 9.807 * up.T
        warm = 20 + 12 * (1 - np.exp(-n / 1500)) + 2 * np.sin(n / 700)
        raw = np.column_stack((weight, np.cross([0.01, -0.02, 0.08], weight)))
        raw += np.outer(warm, [0.3, -0.2, 0.5, 0.01, 0.02, -0.01])
        raw += rng.normal(0, 0.03, raw.shape) * [1, 1, 1, 0.02, 0.02, 0.02]
        parts = (-weight / 1.5, raw, warm[:, None])
        force, raw, warm = (part.reshape(720, 10, -1).mean(axis=1) for part in parts)
        day = make_recording(warm, dict(zip(AXES, raw.T, strict=True)), period_s=10.0)
        found = calibrate([replace(day, specific_force=force)], AT_WORK)
        assert found.payloads.payloads['1'].mass_kg == pytest.approx(1.5, rel=0.01)
        assert any('never rests' in warning for warning in found.warnings)


class TestDoubts:
    @pytest.mark.parametrize('moving', [0.0, 0.6])
    def test_the_specific_force_of_another_frame_is_refused(self, make_working_day, moving):
        one, other = (make_working_day(seed, 600, part=False) for seed in range(2))
        turns = np.where(np.random.default_rng(0).random(600) < moving, 1.0, 0.0)
        wrong = [
            replace(day, specific_force=force, wrench=day.wrench + 200.0, rotation_speed=turns)
            for day, force in ((one, other.specific_force), (other, one.specific_force))
        ]
        with pytest.raises(CalibrationRefusedError, match='do not follow gravity'):
            calibrate(wrong, AT_WORK)

    def test_one_pose_gives_the_drift_and_no_payload(self, make_working_day):
        up = np.array([[0.0, 0, 1]])
        still = [make_working_day(n, poses=up, part=False, contacts=0.0) for n in range(2)]
        calibration = calibrate(still, AT_WORK)
        assert calibration.payloads is None
        warnings = '\n'.join(calibration.warnings)
        assert 'No payload can be identified: gravity moved by 0.00' in warnings
        assert calibration.fits['force_z'].rms_after < 0.2 * calibration.fits['force_z'].rms_before

    def test_a_weight_that_the_driver_subtracts_is_no_payload(self, make_working_day):
        day = make_working_day(0, 600)
        rng, drift = np.random.default_rng(0), day.wrench - without_drift(day)
        noise = 0.05 * rng.standard_normal(drift.shape) * [1, 1, 1, 0.02, 0.02, 0.02]
        calibration = calibrate([replace(day, wrench=drift + noise)], AT_WORK)
        assert calibration.payloads is None
        assert 'nothing weighs on the sensor' in '\n'.join(calibration.warnings)

    @pytest.mark.parametrize('kept', [slice(50), slice(None, None, 10)])
    def test_too_few_cells_and_rows_far_apart_are_refused(self, plain, kept):
        wrench = np.full_like(plain[0].wrench, np.nan)
        wrench[kept] = plain[0].wrench[kept]
        with pytest.raises(CalibrationRefusedError, match='at least 120'):
            separate([replace(plain[0], wrench=wrench)])
