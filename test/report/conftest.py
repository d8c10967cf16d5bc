"""Reports of every kind: a good sensor, a weak one, none to mend, an evaluation, plateaus."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.report import report_content as contents
from wrist_ft_comp.report.evaluation import tared_errors
from wrist_ft_comp.report.html_page import page
from wrist_ft_comp.stored.model_file import save_model

#: Markup in it, and longer than a line of a telephone.
NAME = '<b>a_name_without_any_space_' + 'x' * 60 + '.csv & "quotes"'


def make_recording(  # noqa: PLR0913 -- a factory names what it can vary
    name=NAME, seed=0, *, cells=400, axes=3, slope=1.0, hidden=0.0, reference=None
):
    """Two thermometers, some axes that drift with the first one, and drift that nobody sees."""
    rng = np.random.default_rng(seed)
    t = np.arange(cells)
    inside = 20 + 10 * (1 - np.exp(-t / 90)) * (1 + 0.2 * np.sin(t / 50 + seed))
    outside = 20 + 4 * (1 - np.exp(-t / 200)) + rng.normal(0, 0.01, cells)
    unseen = np.cumsum(rng.normal(0, 1, cells)) * hidden
    scale = np.array([1, 2, 3, 0.01, 0.02, 0.03])
    drift = np.outer(slope * (inside - 20) + unseen, scale)
    load = np.zeros((cells, 6)) if reference is None else reference
    wrench = drift + load + rng.normal(0, 0.02, (cells, 6)) * scale
    wrench[:, axes:] = np.nan
    return Recording(
        name=name, period_ns=10 * 10**9, first_cell=0,
        temperature_c=np.stack((inside, outside), axis=1),
        measured=np.ones((cells, 2), dtype=bool), wrench=wrench,
        reference=np.full((cells, 6), np.nan) if reference is None else reference,
        warnings=('Something <odd> was left out.',),
    )  # fmt: skip


def make_plateaus():
    """Eight temperatures of a chamber, the wrench at the end of each only."""
    day = make_recording(cells=480)
    temperature_c = np.repeat(np.arange(0.0, 80.0, 10.0), 60)
    wrench = day.wrench + np.outer(temperature_c, [1, 1, 1, 0, 0, 0])
    wrench[np.arange(480) % 60 < 50] = np.nan
    return replace(day, temperature_c=np.stack([temperature_c] * 2, axis=1), wrench=wrench)


def learn(recordings, folder, reference='unloaded', **chosen):
    settings = CalibrationSettings(reference, identification=IdentificationSettings(**chosen))
    calibration = calibrate(recordings, settings)
    provenance = {
        'recordings': [{'path': f'/data/{day.name}', 'sha256': 'a' * 64} for day in recordings],
        'settings': {'reference': reference, 'identification': chosen},
    }
    return calibration, save_model(folder / '<i>model.yaml', calibration, provenance)


def evaluated(stored, recording, reference='unloaded'):
    errors = tared_errors(stored.model, recording, reference)
    return contents.EvaluatedRecording(recording, reference, errors)


@pytest.fixture(scope='session')
def make():
    return SimpleNamespace(recording=make_recording, evaluated=evaluated, learn=learn, name=NAME)


@pytest.fixture(scope='session')
def stored(tmp_path_factory):
    """A model that was learnt from one recording, monday.csv."""
    folder = tmp_path_factory.mktemp('stored')
    return learn([make_recording('monday.csv')], folder, method='pls')[1]


@pytest.fixture(scope='session')
def view(tmp_path_factory, stored, make_working_day):
    """Views by kind, made once."""

    @cache
    def build(kind):
        folder = tmp_path_factory.mktemp(kind)
        if kind == 'plateaus':
            recordings = [make_plateaus()]
            calibration, model = learn(recordings, folder, method='pls', features='hats')
            return contents.calibration_content(calibration, recordings, model)
        if kind == 'evaluation':
            second = evaluated(stored, make_recording('second.csv', 1), 'constant')
            both = [evaluated(stored, make_recording()), second]
            return contents.evaluation_content(stored, both, 60.0, [Path('a.csv')], stored.topics)
        if kind == 'work':
            recordings = [make_working_day(0), make_working_day(1)]
            calibration, model = learn(recordings, folder, 'payload', method='pls')
            return contents.calibration_content(calibration, recordings, model)
        drifts = {'good': (1.0, 0.0, 0), 'weak': (0.05, 0.1, 0), 'none': (0.0, 0.0, 2)}
        slope, hidden, seed = drifts[kind]
        recordings = [
            make_recording(name, k, slope=slope, hidden=hidden)
            for k, name in enumerate([NAME] if kind == 'weak' else [NAME, 'second.csv'], seed)
        ]
        calibration, model = learn(recordings, folder, method='pls' if kind == 'weak' else 'auto')
        return contents.calibration_content(calibration, recordings, model)

    return build


@pytest.fixture(scope='session')
def text(view):
    """Pages by kind, as text."""
    return cache(lambda kind: page(view(kind)))
