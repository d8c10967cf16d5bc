"""A payload and its frame in words and in the forms that others take."""

import numpy as np
from scipy.spatial.transform import Rotation

from wrist_ft_comp.payload.driver_commands import driver_calls
from wrist_ft_comp.payload.weight import ForceFrame, Payload


def test_roll_pitch_and_yaw_are_turns_about_fixed_axes():
    turn = Rotation.from_euler('xyz', [10.0, 20.0, -30.0], degrees=True)
    assert '10.0, 20.0, -30.0 degrees' in str(ForceFrame(turn.as_matrix()))


def test_drivers_take_mass_and_centre_in_their_units():
    calls = driver_calls(Payload(1.25, np.array([0.01, -0.02, 0.1])))
    universal = calls['Universal Robots']
    assert 'mass: 1.25, center_of_gravity: {x: 0.0100, y: -0.0200, z: 0.1000}' in universal
    assert '[1.25, 10.0, -20.0, 100.0, 0, 0, 0, 0, 0, 0]' in calls['xArm']
    assert '<origin xyz="0.0100 -0.0200 0.1000"/><mass value="1.25"/>' in calls['URDF']
    assert calls['MoveIt'].endswith('weight: 1.25')
