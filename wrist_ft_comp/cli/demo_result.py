"""The result of a demonstration: errors of the received wrenches, a verdict, a picture."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from wrist_ft_comp.cli.evaluate import evaluation_text
from wrist_ft_comp.cli.tables import table_text
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.report.evaluation import AxisEvaluation, judge_errors, TaredErrors
from wrist_ft_comp.signals import AXES, axis_unit, FloatArray, GRAVITY, NANOSECONDS
from wrist_ft_comp.stored.demo_log import DemoLog

#: The simulated sensor's thermometers.
TOPICS = ('temperature', 'temperature_2')
#: Mass of the tool, kg.
TOOL_KG = 1.4
#: Mass of the part that it picks up, kg.
PART_KG = 0.8
#: Both wrenches are tared on this time after the calibration, s.
_TARE_S = 60.0
#: The drift of force z has to become smaller by this factor.
_RATIO = 10.0
#: The same at work, where weight and contacts disturb the calibration.
_RATIO_AT_WORK = 5.0
#: Largest relative error of the tool's mass.
_MASS_SHARE = 0.05


def errors(log: DemoLog) -> TaredErrors:
    """Compare raw and compensated wrenches with the true ones."""
    return TaredErrors(
        *(_tared(log, wrench, log.reference) for wrench in (log.raw, log.compensated))
    )


def external_errors(log: DemoLog) -> FloatArray:
    """Compare ``wrench_external`` with what pushed on the tool, (n, 6); NaN with a part in it."""
    # The chosen payload is the tool alone: times with a part in it do not count.
    weight = np.linalg.norm((log.reference - log.external_reference)[:, :3], axis=1)
    alone = weight < (TOOL_KG + PART_KG / 2) * GRAVITY
    external = np.where(alone[:, np.newaxis], log.external, np.nan)
    return _tared(log, external, log.external_reference)


def _tared(log: DemoLog, wrench: FloatArray, true: FloatArray) -> FloatArray:
    """Find the errors of what came after the calibration, tared on its first minute, (n, 6)."""
    since_s = (log.stamps_ns - log.calibrated_ns) / NANOSECONDS
    after = since_s > 0
    error = (wrench - true)[after]
    first = error[since_s[after] <= _TARE_S]
    if not np.isfinite(first).any():
        raise RecordingError(
            f'Not every wrench was received in the {_TARE_S:g} s after the calibration, so the '
            'demonstration cannot be judged. Try a lower --speed.'
        )
    return np.asarray(error - np.nanmean(first, axis=0))


@dataclass(frozen=True)
class Outcome:
    """Figures of a demonstration, N and N m by axis."""

    #: What is left of the drift in ``wrench``.
    axes: dict[str, AxisEvaluation]
    #: Root mean square error of ``wrench_external``; empty if not at work.
    external: dict[str, float]
    #: Of the payloads that were learnt, by name.
    masses_kg: Mapping[str, float]
    #: How many wrenches were compared.
    wrenches: int
    #: Whether the drift fell, and the mass was found, as well as is promised.
    reached: bool
    #: The same in words, with the numbers.
    sentence: str

    def as_json(self) -> dict[str, object]:
        """Everything a script may want."""
        axes = {axis: asdict(figures) for axis, figures in self.axes.items()}
        for axis, rms in self.external.items():
            axes[axis]['external_rms'] = rms
        return {'axes': axes, 'wrenches': self.wrenches, 'masses_kg': {**self.masses_kg}}

    def table(self) -> str:
        """Put it into tables."""
        units = {axis: axis_unit(axis) for axis in self.axes}
        text = (
            f'\nafter the calibration, over {self.wrenches} wrenches received from the topics:\n'
            f'{evaluation_text(self.axes, units)}'
        )
        if self.external:
            rows = [[axis, units[axis], f'{rms:.3g}'] for axis, rms in self.external.items()]
            text += (
                '\nwrench_external against what really pushed on the tool:\n'
                f'{table_text(["axis", "unit", "RMS error"], rows)}'
            )
        return text


def judge(log: DemoLog, masses_kg: Mapping[str, float] | None) -> Outcome:
    """Judge a demonstration; at work by the masses that were learnt, too."""
    axes = judge_errors([errors(log)])
    ratio = axes['force_z'].rms_before / axes['force_z'].rms_after
    wanted = _RATIO if masses_kg is None else _RATIO_AT_WORK
    reached, external = ratio >= wanted, {}
    sentence = f'drift of force z fell {ratio:.1f} times; at least {wanted:.0f} are wanted'
    if masses_kg is not None:
        tool_kg = min(masses_kg.values(), key=lambda mass: abs(mass - TOOL_KG), default=0.0)
        off = abs(tool_kg - TOOL_KG) / TOOL_KG
        sentence += (
            f'\nthe tool of {TOOL_KG:g} kg was found to be {tool_kg:.3f} kg, {off:.1%} off; at '
            f'most {_MASS_SHARE:.0%} are wanted'
        )
        rms = np.sqrt(np.nanmean(external_errors(log) ** 2, axis=0)).tolist()
        external = dict(zip(AXES, rms, strict=True))
        reached &= off <= _MASS_SHARE
    return Outcome(axes, external, masses_kg or {}, len(log.stamps_ns), reached, sentence)


def draw(log: DemoLog, *, external: bool) -> bytes:
    """Draw what came after the calibration, and if asked for what wrench_external is off by."""
    from wrist_ft_comp.report.pictures import draw_drift, png_bytes  # noqa: PLC0415 -- matplotlib

    raw, compensated = errors(log)
    elapsed_s = (log.stamps_ns - log.calibrated_ns) / NANOSECONDS
    elapsed_s = elapsed_s[elapsed_s > 0]
    temperatures = []
    for number, topic in enumerate(TOPICS):
        rows = (log.thermometer == number) & (log.temperature_stamps_ns > log.calibrated_ns)
        times = (log.temperature_stamps_ns[rows] - log.calibrated_ns) / NANOSECONDS
        temperatures.append((topic, times, log.temperature_c[rows]))
    left = [raw, compensated, *([external_errors(log)] if external else [])]
    series = [
        (f'{axis}, {axis_unit(axis)}', elapsed_s, [drift[:, i] for drift in left])
        for i, axis in enumerate(AXES)
    ]
    return png_bytes(draw_drift(series, temperatures))
