"""One rule for every gap: who lived through it, who was restarted and who reads the file agree."""

import csv
from dataclasses import replace
from itertools import pairwise

from hypothesis import assume, given, HealthCheck, Phase, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from wrist_ft_comp.cli.main import main
from wrist_ft_comp.drift.drift_model import ThermometerPrediction
from wrist_ft_comp.stored.model_file import load_model
from wrist_ft_comp.stored.state_file import load_state, save_state, SavedState
from wrist_ft_comp.stream import failed_thermometers
from wrist_ft_comp.stream.compensator import Compensator, StreamSettings

SECOND = 1_000_000_000
START = 1_700_000_000
Z = 2
#: Two thermometers that read about the same, soon dead or frozen, and soon believed again.
ALIKE = ThermometerPrediction(
    np.array([0.0, 20.0]), np.array([[[0.0, 0.7], [0.0, 0.3]], [[0.6, 0.0], [0.4, 0.0]]]),
    np.zeros(2), *np.array([[3.0], [40.0], [5.0]]) * np.ones((3, 2)))  # fmt: skip
#: When in a cell of a second each thermometer reports, and how far from its mean, K.
SAMPLES = (0.25, -0.3), (0.75, 0.3)
#: The output follows the model at once, so that it can be compared.
FOLLOWS = StreamSettings(max_drift_n=1e6, max_drift_rate_n_s=1e6)


@pytest.fixture(scope='module')
def write_model(make_model, save, tmp_path_factory):
    """Write a model of two thermometers, force z, with a time constant, s."""

    def write(time_constant_s):
        axes = {'force_z': (2.0, 0.0, time_constant_s)}
        model = replace(make_model(axes, thermometers=2, prediction=ALIKE), start_s=3.0)
        return save(tmp_path_factory.mktemp('gaps') / 'model.yaml', model).path

    return write


@pytest.fixture(scope='module')
def hasty(write_model):
    """The least memory there is: a minute."""
    return write_model(15.0)


@st.composite
def days(draw):
    """Thermometers heard by cell, twice in each: a list of (cell, temperatures or None)."""
    cell, rows, rng = 0, [], np.random.default_rng(draw(st.integers(0, 99)))
    stretch = st.tuples(
        st.sampled_from(['both', 'both', 'first', 'second', 'slow', 'frozen', 'jump']),
        st.integers(2, 100),
    )
    drawn = draw(st.lists(stretch, min_size=1, max_size=7))
    for kind, cells in [('both', 3), *drawn, ('both', 6)]:
        # Two samples in a row make the leap of the clock believed.
        if kind == 'jump':
            cell += draw(st.sampled_from([3, 20, 59, 60, 61, 200, 5000]))
            continue
        for k in range(cells):
            heard = [kind != 'second', kind != 'first']
            if kind == 'slow' and k % 7:
                heard = [False, not k % 3]
            celsius = (30 + 15 * np.sin(cell / 60) + rng.uniform(-0.7, 0.7, 2)).tolist()
            if kind == 'frozen':
                celsius[0] = 31.0
            rows.append((cell, [c if h else None for c, h in zip(celsius, heard, strict=True)]))
            cell += 1
    return rows


class Life:
    """A stream that is fed and may be killed; the drift after every cell that it completed."""

    def __init__(self, model, folder):
        self.model, self.folder = model, folder
        self.compensator = Compensator(2, FOLLOWS, model)
        self.drift = {}
        self.seen = []

    def feed(self, rows):
        for cell, celsius in rows:
            for thermometer, value in enumerate(celsius):
                for second, noise in SAMPLES if value is not None else ():
                    stamp = round((START + cell + second) * SECOND)
                    sample = thermometer, stamp, value + noise
                    for done in self.compensator.add_temperature(*sample):
                        self.drift[done.number - START] = None
            self.seen.append((cell, celsius))
            last = self.compensator.tracker.end_ns // SECOND - START - 1
            if last in self.drift and self.drift[last] is None:
                self.drift[last] = self.compensator.compensation.zero[Z]
        # Of several cells that one temperature completed, only the last one's drift is subtracted.
        self.drift = {cell: drift for cell, drift in self.drift.items() if drift is not None}

    def restart(self):
        """Go on from the file of the state; what was in no completed cell is lost."""
        memory = self.compensator.memory()
        if memory is None:
            return
        path = self.folder / 'state.json'
        save_state(path, SavedState(0, None, np.zeros(6), memory))
        self.compensator = Compensator(2, FOLLOWS, self.model)
        self.compensator.resume(load_state(path).thermal, 0.0)
        self.seen = [row for row in self.seen if (START + row[0]) * SECOND < memory.end_ns]


def compensated(model_path, rows, folder):
    """Let the command read a file with these temperatures; the drift of force z by cell."""
    # The drift of a cell is reached at the end of the next one.
    wrenches = {cell + 2: None for cell, _ in rows}
    lines = [
        (cell + second, '', *('' if value is None else value + noise for value in celsius))
        for cell, celsius in rows
        for second, noise in SAMPLES
    ]
    lines += [(cell, '0.0', '', '') for cell in wrenches]
    path, out = folder / 'day.csv', folder / 'out.csv'
    out.unlink(missing_ok=True)
    with path.open('w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(['stamp_s', 'force_z', 'temperature_c', 'temperature_2_c'])
        writer.writerows((START + second, *rest) for second, *rest in sorted(lines))
    assert main(['compensate', str(model_path), str(path), '-o', str(out)]) == 0
    with out.open(newline='') as file:
        found = [row for row in csv.DictReader(file) if row['force_z']]
    return {
        round(int(row['stamp_ns']) / 10**9) - START - 2: -float(row['force_z']) for row in found
    }


@settings(
    max_examples=8,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    phases=[Phase.generate],  # to make an example smaller takes minutes
)
@given(rows=days(), kills=st.lists(st.integers(3, 400), max_size=3))
def test_stream_restart_and_file_give_the_same_drift(hasty, tmp_path, monkeypatch, rows, kills):
    """In every cell in which a thermometer reports: within a gap only a file knows its end."""
    for name, time_s in (('STILL_S', 15.0), ('AGREED_S', 30.0)):
        monkeypatch.setattr(failed_thermometers, name, time_s)
    model = load_model(hasty).model
    killed, lived = (Life(model, tmp_path) for _ in range(2))
    kills = sorted(cell for cell in kills if cell < len(rows) - 5)
    for begin, end in pairwise([0, *kills, len(rows)]):
        killed.feed(rows[begin:end])
        if end in kills:
            killed.restart()
    lived.feed(killed.seen)
    tracker = lived.compensator.tracker
    # A lone sample behind a leap is not believed, live; a file cannot know. Nor does it hold what
    # was believed before the first readings proved to be wrong, which a restart has forgotten.
    assume(not tracker.grid.late and not tracker.clocks.rejected)
    assume(not any(spikes.dropped for spikes in tracker.spikes))
    read = compensated(hasty, killed.seen, tmp_path)
    last = rows[-1][0] - 1
    assert last in lived.drift
    assert last in killed.drift
    for cell in lived.drift:
        assert read[cell] == pytest.approx(lived.drift[cell], abs=1e-9)
    for cell in lived.drift.keys() & killed.drift.keys():
        assert killed.drift[cell] == pytest.approx(lived.drift[cell], abs=1e-9)


@pytest.mark.parametrize('hours', [0.45, 1])
def test_after_a_night_without_samples_the_evening_has_no_effect(write_model, tmp_path, hours):
    """Soaked at 40 °C, then silent while it cools to 22 °C: on a line, or soaked there."""
    path, silent = write_model(600.0), round(hours * 3600)
    evening = [(cell, [40.0, 40.0]) for cell in range(100)]
    morning = [(100 + silent + cell, [22.0, 22.0]) for cell in range(700)]
    lived, killed = (Life(load_model(path).model, tmp_path) for _ in range(2))
    killed.feed(evening)
    killed.restart()
    killed.feed(morning)
    lived.feed(killed.seen)
    read = compensated(path, killed.seen, tmp_path)
    pole, heat = np.exp(-1 / 600), 20.0
    line = np.linspace(40.0, 22.0, silent + 3)[1:] if hours < 0.5 else np.full(10**5, 22.0)
    for celsius in line:
        heat = pole * heat + (1 - pole) * (celsius - 20.0)
    for drift in (lived.drift, killed.drift, read):
        assert drift[100 + silent] == pytest.approx(2.0 * heat, abs=1e-9)
        assert drift[700 + silent] == pytest.approx(read[700 + silent], abs=1e-9)


@pytest.mark.parametrize('back', [30, 10_000])
def test_a_clock_set_back_has_the_same_effect_with_and_without_a_restart(hasty, tmp_path, back):
    """As of a bag in a loop. A file cannot hold it: stamps that do not increase are dropped."""
    killed, lived = (Life(load_model(hasty).model, tmp_path) for _ in range(2))
    evening = [(20_000 + cell, [20.0 + cell / 10, 30.0]) for cell in range(100)]
    morning = [(20_100 - back + cell, [35.0, 31.0]) for cell in range(30)]
    for life in (killed, lived):
        life.feed(evening)
    killed.restart()
    for life in (killed, lived):
        life.drift.clear()
        life.feed(morning)
    assert killed.drift == pytest.approx(lived.drift, abs=1e-9)
    assert len(lived.drift) > 20
    assert lived.compensator.tracker.forgot
