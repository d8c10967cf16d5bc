"""
What the columns of another program's log may be: proposed by names, units and values.

A time increases; of two, one that is no row number. A temperature has its name or its unit, and
readings that a thermometer makes. A force has its name, or it is what is left with a unit or a
word of forces. What never changes, what counts, and texts are none of them. What cannot be told
stays open, as in ``force_z=…``.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
import difflib
from itertools import count, islice
from math import nan
import re
import shlex
from typing import NoReturn

import numpy as np

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings.column_map import (
    CHANNELS,
    COMPENSATED,
    KINDS,
    known_unit,
    listed,
    ORIGIN,
    Placed,
    STAMP,
    STAMP_NANOSEC,
)
from wrist_ft_comp.recordings.stamps import exact_ns, find_form
from wrist_ft_comp.recordings.table_header import number_in
from wrist_ft_comp.signals import AXES, is_plausible, temperature_channel
from wrist_ft_comp.wire.temperature_source import may_be_temperature, to_celsius

_EXPECTED = {
    'stamp': 'stamp_s (or stamp_ms, stamp_us, stamp_ns, stamp_min, stamp_h)',
    'raw wrench': f'any of {", ".join(AXES)}',
    'temperature': 'temperature_c (or temperature_k, temperature_f)',
}
#: Stands in a map for a column that a person has to name.
OPEN = '…'
#: Names of columns by other loggers, in small letters, without signs and a unit in brackets.
_ALIASES = {
    f'{short}{axis}': f'{channel}_{axis}'
    for shorts, channel in (
        (('f', 'f_', 'kraft_'), 'force'),
        (('t', 't_', 'm', 'm_'), 'torque'),
        (('a', 'acc_'), 'linear_acceleration'),
    )
    for short in shorts
    for axis in 'xyz'
}
#: T, T1, T_sensor or T [°C] is a temperature; t is a time, and T_x a torque.
_SHORT_TEMPERATURE = re.compile(
    r'T(\d+|_(?![xyzXYZ]\b)\w+)?\s*(/\s*°\w|[\[(]\W*(deg)?\W*[CKF]\w*\W*)?'
)
#: Words of times, of the true wrench, and of forces, in names.
_TIME_WORD = re.compile(
    r'_*(t|.*(time|stamp|zeit|date|datum|elapsed|epoch|clock|secs?|seconds|x_?value))'
    r'(_?(ns|us|ms|s|min|h))?'
)
_TRUE = re.compile('reference|ref|truth|true')
_FORCE_WORD = re.compile(r'force|kraft|load|last|weight|gewicht|cell|zelle|newton|frc|gauge|dms')
_NANOSEC = re.compile('.*?(nano|n)sec(s|onds)?')
#: Signs of a map: a column with one of them in its name is called by its number.
_MAP_SIGNS = re.compile(r'[,:=…]|\*[-+.\deE]')
#: A column is probably meant where its name is as similar as this, 0 to 1.
_LEAST_SIMILARITY = 0.7
#: Between which readings a day may begin in a unit, and hardly in °C.
_COLD_STARTS = {'F': (55.0, 120.0), 'K': (230.0, 330.0)}
#: Forces that move by less than this over a whole recording, less than any sensor's noise, are in
#: no newtons; nor are those that move by less than the second, and by less than the torques.
_NEVER_NEWTONS, _PERHAPS_NEWTONS = 0.02, 0.5
#: A temperature moves from sample to sample by a smaller share of all that it moves.
_SMOOTH = 0.2
#: Times of clocks are at least this, in any unit since 1970: 2001.
_CLOCK_S = 1e9
#: A time runs back, as at midnight, in at most this share of the rows.
_MOST_BACK = 0.05
#: Most entries of a proposed map.
_MOST_ENTRIES = 30


@dataclass(frozen=True)
class Proposal:
    """A map of columns as ``--columns`` and ``--time`` take it; empty where nothing is missing."""

    columns: str = ''
    time: str = ''

    @property
    def is_open(self) -> bool:
        """Whether a person has to name a column."""
        return OPEN in self.columns


def refuse_missing(
    placed: Placed, missing: Sequence[str], rows: Sequence[Sequence[str]] = ()
) -> NoReturn:
    """Refuse a table for the KINDS of columns that are missing, and propose a map of it."""
    proposal = propose(placed, rows)
    expected = ' and '.join(_EXPECTED[kind] for kind in missing)
    time = f' --time {shlex.quote(proposal.time)}' if proposal.time not in {'', 's'} else ''
    remedy = f"Rename them, or say what they are, such as --columns '{proposal.columns}'{time}"
    if proposal.is_open:
        remedy += f', with the name or the number of a column in the place of {OPEN}'
    if proposal.columns == f'temperature_c={OPEN}':
        remedy += '. If it is in another file, join both in Python (recording_from_columns)'
    raise RecordingError(
        f'{placed.table} has no {" and no ".join(missing)} column; expected {expected}, got '
        f'{listed(placed.names)}. {remedy}.'
    )


def warn_of_unused(placed: Placed) -> list[str]:
    """Warn, in one sentence, of columns that are not used, and say what their names mean."""
    used, ours = {column.place for column in placed.columns.values()}, (ORIGIN, COMPENSATED)
    unused = [
        name
        for place, name in enumerate(placed.names)
        if name and place not in used and not name.startswith(ours)
    ]
    if not unused:
        return []
    sentence = f'{placed.table} has columns that are not understood and not used: {listed(unused)}'
    entries = [e for e in propose(placed).columns.split(',') if e and OPEN not in e]
    meant = f" Perhaps they are: --columns '{','.join(entries)}'." if entries else ''
    return [f'{sentence}.{meant}']


class _Looks:
    """A column that is not understood yet: its name, and what its cells look like."""

    def __init__(self, place: int, name: str, unit: str, cells: Sequence[str]) -> None:
        self.place, self.name, self.unit = place, name, unit
        self.plain = re.sub(r'\W+', '_', re.sub(r'[\[(].*|\s/\s.*', '', name.lower())).strip('_')
        self.numbers = np.array([_number(cell) for cell in cells])
        finite = self.numbers[np.isfinite(self.numbers)]
        filled = [cell for cell in cells if cell]
        #: Whether nearly all cells that are filled hold a number; without cells nobody knows.
        self.is_number = not cells or len(finite) > 0.9 * len(filled) > 0
        #: The form of its times; of numbers, their unit.
        self.form = find_form(filled)
        steps = np.diff(finite)
        self.is_constant = bool(len(finite) > 2 and not steps.any())
        self.counts = bool(len(steps) > 2 and abs(steps[0]) == 1 and (steps == steps[0]).all())
        self.is_smooth = len(steps) < 8 or float(np.median(np.abs(steps))) < _SMOOTH * np.ptp(
            finite
        )
        self.finite = finite
        self._is_short_temperature = bool(_SHORT_TEMPERATURE.fullmatch(name.strip()))
        self.time_score = self._score_time(filled)

    def _score_time(self, filled: Sequence[str]) -> float:
        """Tell how well it is a time; 0 where it is none."""
        has_unit = bool(known_unit(STAMP, self.name, self.unit))
        is_named = bool(_TIME_WORD.fullmatch(self.plain)) and not self._is_short_temperature
        if not filled:
            return float(is_named)
        is_clock = not self.is_number or self.finite[0] >= _CLOCK_S
        if not self.form or not (is_clock or is_named or has_unit):
            return 0.0
        try:
            steps = np.diff(exact_ns(filled, self.form))
        except (ValueError, ArithmeticError):
            return 0.0
        rises = float(np.mean(steps > 0)) if len(steps) else 1.0
        if len(steps) and float(np.mean(steps < 0)) > _MOST_BACK:
            return 0.0
        # A clock is better than seconds, and seconds are better than what counts rows.
        is_row_number = self.counts and not is_clock and not has_unit
        return rises * (1.0 + 2.0 * is_clock + 0.5 * is_named - 0.5 * is_row_number)

    @property
    def may_measure(self) -> bool:
        """Whether it may be what a sensor reads."""
        return self.is_number and not self.is_constant and not self.counts

    def may_be(self, channel: str) -> bool:
        """Whether neither unit nor values exclude a channel."""
        others = [c for c in ('temperature_c', 'force_x', 'torque_x', 'linear_acceleration_x')
                  if known_unit(c, self.name, self.unit)]  # fmt: skip
        unit = known_unit(channel, self.name, self.unit)
        return self.may_measure and (bool(unit) or not others or channel.startswith('rotation'))

    @property
    def is_temperature(self) -> bool:
        """Whether name or unit say that it is a temperature."""
        return (
            may_be_temperature((self.plain,))
            or (self._is_short_temperature and self.is_smooth)
            or bool(known_unit('temperature_c', self.name, self.unit))
        )

    def temperature_unit(self) -> str | None:
        """Find the unit in which its readings are those of a thermometer; None where in none."""
        unit = known_unit('temperature_c', self.name, self.unit)
        if not unit and len(self.finite):
            first = self.finite[0]
            likely = (u for u, (low, high) in _COLD_STARTS.items() if low < first < high)
            unit = next(likely, '')
        readings = to_celsius(self.finite, unit or 'C')
        share = np.mean([is_plausible(value) for value in readings]) if len(readings) else 1.0
        return unit if share > 0.9 else None


def _number(cell: str) -> float:
    try:
        return number_in(cell, '')
    except ValueError:
        return nan


def propose(placed: Placed, rows: Sequence[Sequence[str]] = ()) -> Proposal:
    """
    Propose what columns are that are not understood, by names, units and some rows of texts.

    A stamp, a force and a
    temperature that are missing and that no column can be said to be stay open.
    """
    known = {channel: column.place for channel, column in placed.columns.items()}
    names, units = placed.names, (*placed.units, *[''] * len(placed.names))
    cells = list(zip(*rows, strict=True)) if rows else [()] * len(names)
    free = [
        _Looks(k, name, units[k], cells[k])
        for k, name in enumerate(names)
        if k not in known.values() and (name or rows)
    ]
    found: dict[str, _Looks] = {}
    words: dict[str, str] = {}

    def take(channel: str, looks: _Looks, unit: str = '') -> None:
        found[channel] = looks
        words[channel] = unit
        free.remove(looks)

    time = ''
    stamps = [looks for looks in free if looks.time_score > 0]
    if STAMP not in known and stamps:
        best = max(stamps, key=lambda looks: looks.time_score)
        time = known_unit(STAMP, best.name, best.unit) if best.is_number else best.form
        time = time or best.form or 's'
        take(STAMP, best)
        nanosec = [looks for looks in free if _NANOSEC.fullmatch(looks.plain)]
        if nanosec and time == 's':
            take(STAMP_NANOSEC, nanosec[0])
    free = [looks for looks in free if not looks.time_score > 1 and looks.plain]

    absent = [channel for channel in CHANNELS if channel not in known]
    if set(AXES) <= set(absent):
        for channel, looks in zip(AXES, _six_of(free), strict=False):
            take(channel, looks)
            absent.remove(channel)
    thermometers = (c for c in map(temperature_channel, count()) if c not in known)
    for looks in list(free):
        is_temperature = looks.is_temperature
        channel = '' if looks.plain.startswith('external_') else _named_like(looks.plain, absent)
        if is_temperature and looks.may_be('temperature_c'):
            unit = looks.temperature_unit()
            if unit is not None:
                take(next(thermometers), looks, unit)
        elif not is_temperature and channel and looks.may_be(channel):
            absent.remove(channel)
            take(channel, looks, known_unit(channel, looks.name, looks.unit))
    has_axis = set(AXES) & {*known, *found}
    if not has_axis:
        for looks in free:
            unit = known_unit('force_z', looks.name, looks.unit)
            if looks.may_be('force_z') and (unit or _FORCE_WORD.search(looks.plain)):
                take('force_z', looks, unit)
                break
    _guess_kilonewtons(found, words)
    order = [STAMP, STAMP_NANOSEC, *AXES, *map(temperature_channel, range(100)), *CHANNELS[6:]]
    entries = [
        f'{channel}={_called(found[channel])}{":" * bool(words[channel])}{words[channel]}'
        for channel in order
        if channel in found
    ]
    for channel, kind in zip((STAMP, 'force_z', 'temperature_c'), KINDS.values(), strict=True):
        if {*kind}.isdisjoint({*known, *found}):
            entries.append(f'{channel}={OPEN}')
    return Proposal(','.join(islice(entries, _MOST_ENTRIES)), time)


def _called(looks: _Looks) -> str:
    """Name a column in a map."""
    return str(looks.place + 1) if _MAP_SIGNS.search(looks.name) or not looks.name else looks.name


def _six_of(free: Iterable[_Looks]) -> list[_Looks]:
    """Find six columns of a wrench that are numbered: the raw one first."""
    groups: dict[str, list[_Looks]] = {}
    for looks in free:
        if match := re.fullmatch(
            r'(.*(?:wrench|force|torque|ft).*?)_?\[?(\d+)\]?', looks.name.lower()
        ):
            groups.setdefault(match[1], []).append(looks)
    six = {name: group for name, group in groups.items() if len(group) == len(AXES)}
    return six[min(six, key=lambda name: 'raw' not in name)] if six else []


def _named_like(plain: str, absent: Sequence[str]) -> str:
    """Find the missing channel that a column may be, or ''; a reference only if it says so."""
    prefix = 'reference_' if _TRUE.search(plain) else ''
    plain = _TRUE.sub('', plain).strip('_')
    names = [n.removeprefix(prefix) for n in absent if n.startswith('reference_') == bool(prefix)]
    short = re.sub(r'_(k|m|c)?n(m|mm)?$|_(lbf|kgf?|g)$', '', plain)
    # Such as /ft/wrench/force/x, whatever stands before.
    ends = [name for name in names if plain.replace('_', '').endswith(name.replace('_', ''))]
    # A second force_z is like force_y, but of another axis.
    axis = plain.rstrip('0123456789')[-1:]
    alike = [n for n in names if axis not in 'xyz' or n[-2:-1] != '_' or n.endswith(axis)]
    near = difflib.get_close_matches(short, alike, 1, _LEAST_SIMILARITY)
    last = re.sub(r'.*_(?=f[xyz]$)', '', short)  # such as ft_fz
    name = _ALIASES.get(short) or _ALIASES.get(last) or next(iter((*ends, *near)), '')
    return f'{prefix}{name}' if name in names else ''


def _guess_kilonewtons(found: Mapping[str, _Looks], words: dict[str, str]) -> None:
    """Put kN behind forces that name no unit, where newtons cannot be."""
    spans = {
        c: float(np.ptp(found[c].finite)) for c in AXES if c in found and len(found[c].finite)
    }
    force = max((span for c, span in spans.items() if c.startswith('force')), default=0.0)
    torque = max((span for c, span in spans.items() if c.startswith('torque')), default=0.0)
    if 0 < force < max(_NEVER_NEWTONS, min(torque, _PERHAPS_NEWTONS)):
        for channel in AXES[:3]:
            if channel in found and not words[channel]:
                words[channel] = 'kN'
