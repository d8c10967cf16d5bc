"""The names for others' programs: which they are, what they take, that they load little."""

import ast
from dataclasses import fields
from importlib import import_module
import inspect
from pathlib import Path
import re
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas
import pytest

import wrist_ft_comp
from wrist_ft_comp import Calibration, Compensator, Recording, TareCollector
from wrist_ft_comp.drift.drift_model import Drift
from wrist_ft_comp.report.evaluation import AxisEvaluation

#: What others' programs are written against: a change of these breaks them.
SIGNATURES = {
    'accuracy': '(output, expected, full_scale)',
    'calibrate': '(recordings, settings=None, progress=None)',
    'compensate': '(model, table, *others, tare_s=0.0)',
    'evaluate': "(model, recordings, *, reference='unloaded', tare_s=60.0)",
    'load_model': '(path)',
    'read_recording': '(path, *, period_s=1.0, topics=None, max_bad_share=0.01, progress=None)',
    'recording_from_columns': "(*tables, name='table', period_s=1.0, max_bad_share=0.01)",
    'save_model': '(path, calibration, provenance=None)',
    'write_report': '(path, stored, calibration, recordings)',
    'thermal_sensitivity_drift': '(temperature_c, zero_output, full_scale_output, reference_c)',
    'Compensator': '(thermometers, settings=None, model=None)',
    'TareCollector': '(duration_s, max_deviation_n)',
    'StreamSettings': '(thermal_period_s=1.0, temperature_timeout_s=5.0, max_drift_n=200.0, '
    'max_drift_rate_n_s=1.0)',
}
METHODS = {
    Compensator.add_temperature: '(self, thermometer, stamp_ns, temperature_c, '
    'keep_output_of=None, arrival_ns=None)',
    Compensator.compensation_at: '(self, stamp_ns)',
    Compensator.correct: '(self, stamp_ns, raw, *, external=False)',
    Compensator.go_live: '(self, model, keep_output_of=None)',
    Compensator.reset_tare: '(self)',
    Compensator.set_tare: '(self, raw, stamp_ns, weight=None)',
    TareCollector.add: '(self, stamp_ns, raw)',
    TareCollector.result: '(self)',
}
#: What these have at least; settings with their defaults.
ATTRIBUTES: dict[Any, set[str]] = {
    AxisEvaluation: {'rms_before', 'rms_after', 'max_before', 'max_after'},
    Calibration: {'model', 'fits', 'temperature_range_c', 'duration_s', 'warnings'},
    Recording: {'name', 'period_ns', 'first_cell', 'temperature_c', 'wrench', 'warnings'},
    Drift: {'zero', 'sensitivity'},
}
SETTINGS = {
    'CalibrationSettings': {'reference': 'unloaded', 'min_temperature_span_k': 3.0},
    'Topics': {
        'wrench': '/wrench_raw',
        'temperatures': ('/temperature',),
        'reference': '/wrench_reference',
    },
}
#: Neither of these is for a loop on a robot.
HEAVY = (
    'scipy|pandas|matplotlib|rosbags|jinja2|rich|'
    r'wrist_ft_comp[.](cli|report|ros|fit[.](auto|calibrate))'
)


def bare(function):
    """The signature without annotations, which Python versions write differently."""
    parameters = inspect.signature(function).parameters.values()
    bare_ones = [parameter.replace(annotation=parameter.empty) for parameter in parameters]
    return str(inspect.Signature(bare_ones))


def test_the_public_names_stay():
    others = {*SETTINGS, 'Calibration', 'Recording', 'WristFtCompError'}
    assert set(wrist_ft_comp.__all__) == {*SIGNATURES, *others}
    assert set(wrist_ft_comp.__all__) <= set(dir(wrist_ft_comp))
    assert not hasattr(wrist_ft_comp, 'calibrat')


def test_signatures_of_functions_and_methods_stay():
    signatures = {name: bare(getattr(wrist_ft_comp, name)) for name in SIGNATURES}
    assert signatures == SIGNATURES
    assert {method: bare(method) for method in METHODS} == METHODS


def test_attributes_of_results_and_defaults_of_settings_stay():
    for record, attributes in ATTRIBUTES.items():
        held = record._fields if hasattr(record, '_fields') else [f.name for f in fields(record)]
        assert attributes <= set(held), record
    for name, defaults in SETTINGS.items():
        made = getattr(wrist_ft_comp, name)()
        assert {setting: getattr(made, setting) for setting in defaults} == defaults


def test_type_checkers_see_what_is_loaded():
    source = Path(wrist_ft_comp.__file__).read_text('utf-8')
    seen = {
        alias.name: getattr(import_module(str(node.module)), alias.name)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith('wrist_ft_comp.')
        for alias in node.names
    }
    assert seen == {name: getattr(wrist_ft_comp, name) for name in wrist_ft_comp.__all__}
    assert Path(wrist_ft_comp.__file__).with_name('py.typed').exists()


def loaded_by(statement):
    """Modules that a statement loads in a fresh process, beside those of numpy."""
    program = f'import sys\nbefore = set(sys.modules)\n{statement}\n'
    program += 'print(*(set(sys.modules) - before))'
    words = [sys.executable, '-c', program]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_imports_are_light():
    loaded = loaded_by('import wrist_ft_comp')
    assert [name for name in loaded if name.startswith('wrist_ft_comp')] == ['wrist_ft_comp']
    assert 'numpy' not in loaded
    loaded = loaded_by(
        'import numpy\nbefore = set(sys.modules)\n'
        'from wrist_ft_comp import Compensator, load_model, StreamSettings, TareCollector'
    )
    assert 'wrist_ft_comp.stream.compensator' in loaded
    assert not [name for name in loaded if re.match(HEAVY, name)]


class Sensor:
    """A sensor at 200 Hz for some seconds; it drifts, and is warm from the start."""

    def __init__(self, seconds, force_z):
        self._left, self._stamp_ns, self._force_z = seconds * 200, 10**18, force_z

    def is_running(self):
        return self._left > 0

    def read(self):
        self._left -= 1
        self._stamp_ns += 5_000_000
        return self._stamp_ns, [0.0, 0.0, self._force_z, 0.0, 0.0, 0.0], 30.0


def test_the_documented_examples_run(make, tmp_path, monkeypatch, capsys):
    def day(seed):
        quiet = 0.01 * np.random.default_rng(seed).standard_normal(720)
        return {**make.drifting(7200, seed, every=10), 'torque_x': quiet}

    monkeypatch.chdir(tmp_path)
    for seed, name in enumerate(('monday', 'tuesday', 'wednesday')):
        make.csv(f'{name}.csv', day(seed))
    thursday, used = pandas.DataFrame(day(3)), []
    names: dict[str, Any] = {
        'wrench_stamps_ns': (thursday['stamp_s'] * 1e9).astype(int),
        'force_z': thursday['force_z'],
        'temperature_stamps_ns': (thursday['stamp_s'][::3] * 1e9).astype('datetime64[ns]'),
        'celsius': thursday['temperature_c'][::3],
        'sensor': Sensor(5, force_z=7.0),
        'controller': SimpleNamespace(use=used.append),
    }
    document = (Path(__file__).parents[1] / 'docs/python.md').read_text('utf-8')
    for block in re.findall(r'^```python\n(.*?)^```', document, re.M | re.S):
        if 'rclpy' not in block:
            exec(block, names)  # noqa: S102 -- the document's own words
    printed = capsys.readouterr().out
    before, after = map(float, re.findall(r'force_z: (\S+) -> (\S+) RMS\n', printed)[0])
    assert after < 0.1 * before
    assert 'monday.csv, tuesday.csv' in Path('days.html').read_text('utf-8')
    assert wrist_ft_comp.load_model('model.yaml').model.axes.keys() == {'force_z'}
    compensated = np.asarray(names['frame']['force_z'])
    assert np.std(compensated) < 0.1 * np.std(day(2)['force_z'])
    assert len(used) == 1000
    stamps_ns = 10**18 + 5_000_000 * np.arange(1, 1001)
    force, celsius = np.full(1000, 7.0), np.full(1000, 30.0)
    batch = {'stamp_ns': stamps_ns, 'force_z': force, 'temperature_c': celsius}
    expected = wrist_ft_comp.compensate(names['model'], batch)['force_z'][-1]
    assert expected != 7.0
    assert used[-1] == pytest.approx([0.0, 0.0, expected, 0.0, 0.0, 0.0])
    pressed = names['compensator'].correct(stamps_ns[-1], [1.0, 0.0, 7.0 + 5.0, 0.0, 0.0, 0.0])
    assert pressed == pytest.approx([1.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    assert names['thursday'].name == 'thursday'
    assert f'{names["thursday"].duration_s} ()' in printed
