"""However long the stream runs and whatever its thermometers do, what is kept does not grow."""

import pickle

import pytest

from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SECOND = 1_000_000_000
START_S = 1_700_000_000
HISTORY_S = 20.0
#: Thermometer and time, s, of the readings in a second; two thermometers, three readings each.
STEADY = [(j, k / 3) for k in range(3) for j in range(2)]
READINGS = {
    'steady': lambda second: [(j, second + at) for j, at in STEADY],
    'one is silent': lambda second: [(j, second + at) for j, at in STEADY if not j or second < 30],
    'one never speaks': lambda second: [(0, float(second))],
    'clock runs back': lambda second: [(j, second % 100 + at) for j, at in STEADY],
    'with gaps': lambda second: [(j, second + at) for j, at in STEADY if second % 300 < 240],
}


@pytest.mark.parametrize('axes', [{}, {'force_z': (0.4, 1e-3, 30.0)}])
@pytest.mark.parametrize('readings', READINGS.values(), ids=READINGS)
def test_memory_does_not_grow_with_time(make_model, readings, axes):
    settings = StreamSettings(history_s=HISTORY_S)
    compensator = Compensator(2, settings, make_model(axes, thermometers=2) if axes else None)
    sizes = []
    for second in range(900):
        for thermometer, at in readings(second):
            stamp_ns = round((START_S + at) * SECOND)
            compensator.add_temperature(thermometer, stamp_ns, 20.0 + second % 7)
        compensator.correct((START_S + second) * SECOND, [1.0] * 6)
        if second % 150 == 149:
            sizes.append(len(pickle.dumps(compensator)))
    # What is kept for a model to come is full after HISTORY_S; numbers differ by some digits.
    assert max(sizes) - sizes[0] < 200, sizes
