"""
What the columns of another program's log may be: proposed by names, units and values.

A time increases; of two, one that is no row number. A temperature has its name or its unit, and
readings that a thermometer makes. A force has its name, or it is what is left with a unit or a
word of forces. What never changes, what counts, and texts are none of them. What cannot be told
stays open, as in ``force_z=…``.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
import difflib
from itertools import count
from math import isnan
import re
import shlex
from typing import NoReturn

import numpy as np

from wrist_ft_comp.channels import AXES, is_plausible, temperature_channel
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
from wrist_ft_comp.recordings.table import exact_ns, find_form
from wrist_ft_comp.recordings.table_header import number_in
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


def refuse_missing(
    placed: Placed, missing: Sequence[str], rows: Sequence[Sequence[str]] = ()
) -> NoReturn:
    """Refuse a table for the KINDS of columns that are missing, and propose a map of it."""
    columns, time = propose(placed, rows)
    expected = ' and '.join(_EXPECTED[kind] for kind in missing)
    form = f' --time {shlex.quote(time)}' if time not in {'', 's'} else ''
    remedy = f"Rename them, or say what they are, such as --columns '{columns}'{form}"
    if OPEN in columns:
        remedy += f', with the name or the number of a column in the place of {OPEN}'
    if columns == f'temperature_c={OPEN}':
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
    entries = [e for e in propose(placed)[0].split(',') if e and OPEN not in e]
    meant = f" Perhaps they are: --columns '{','.join(entries)}'." if entries else ''
    return [f'{sentence}.{meant}']


class _Looks:
    """A column that is not understood yet: its name, and what its cells look like."""

    def __init__(self, place: int, name: str, unit: str, cells: Sequence[str]) -> None:
        self.place, self._name, self._unit = place, name, unit
        #: The name in small letters, its parts separated by _, without a unit.
        self.plain = re.sub(r'\W+', '_', re.sub(r'[\[(].*|\s/\s.*', '', name.lower())).strip('_')
        self._filled = [cell for cell in cells if cell]
        numbers = []
        for cell in self._filled:
            with suppress(ValueError):
                numbers.append(number_in(cell, ''))
        self.numbers = np.array([number for number in numbers if not isnan(number)])
        #: Whether nearly all cells that are filled hold a number; without cells nobody knows.
        self._is_number = not cells or len(self.numbers) > 0.9 * len(self._filled) > 0
        self._steps = steps = np.diff(self.numbers)
        self._is_constant = len(steps) > 1 and not steps.any()
        self._counts = len(steps) > 2 and abs(steps[0]) == 1 and bool((steps == steps[0]).all())
        self._is_short = bool(_SHORT_TEMPERATURE.fullmatch(name.strip()))
        #: What --time has to say where it is a time.
        self.form = find_form(self._filled)
        if self._is_number:
            self.form = self.unit_of(STAMP) or self.form or 's'

    def unit_of(self, channel: str) -> str:
        """Find its unit as one of a channel; empty where it is in no such unit."""
        return known_unit(channel, self._name, self._unit)

    def may_be(self, channel: str) -> bool:
        """Whether neither unit nor values exclude that it is what a sensor reads of a channel."""
        others = ('temperature_c', 'force_x', 'torque_x', 'linear_acceleration_x')
        is_other = not self.unit_of(channel) and any(map(self.unit_of, others))
        return self._is_number and not self._is_constant and not self._counts and not is_other

    def time_score(self) -> float:
        """Tell how well it is a time; 0 where it is none."""
        is_named = bool(_TIME_WORD.fullmatch(self.plain)) and not self._is_short
        if not self._filled:
            return float(is_named)
        has_unit = bool(self.unit_of(STAMP))
        is_clock = not self._is_number or self.numbers[0] >= _CLOCK_S
        if not self.form or not (is_clock or is_named or has_unit):
            return 0.0
        try:
            steps = np.diff(exact_ns(self._filled, self.form))
        except (ValueError, ArithmeticError):
            return 0.0
        if not len(steps) or np.mean(steps < 0) > _MOST_BACK:
            return float(not len(steps))
        # A clock is better than seconds, and seconds are better than what counts rows.
        is_row_number = self._counts and not is_clock and not has_unit
        merit = 1.0 + 2.0 * is_clock + 0.5 * is_named - 0.5 * is_row_number
        return merit * float(np.mean(steps > 0))

    def temperature_unit(self) -> str | None:
        """Find the unit in which it reads like a thermometer; None where it is none."""
        unit, steps = self.unit_of('temperature_c'), np.abs(self._steps)
        is_smooth = len(steps) < 8 or np.median(steps) < _SMOOTH * np.ptp(self.numbers)
        is_named = may_be_temperature((self.plain,)) or (self._is_short and is_smooth)
        if not (unit or is_named) or not self.may_be('temperature_c'):
            return None
        if not len(self.numbers):
            return unit
        first = self.numbers[0]
        likely = (u for u, (low, high) in _COLD_STARTS.items() if low < first < high)
        unit = unit or next(likely, '')
        plausible = map(is_plausible, to_celsius(self.numbers, unit or 'C').tolist())
        return unit if sum(plausible) > 0.9 * len(self.numbers) else None


def propose(placed: Placed, rows: Sequence[Sequence[str]] = ()) -> tuple[str, str]:
    """
    Propose what columns are that are not understood, as ``--columns`` and ``--time`` take it.

    By names, units and some rows of texts. A stamp, a force and a temperature that are missing
    stay OPEN where no column can be said to be one; empty where nothing is missing.
    """
    units = (*placed.units, *[''] * len(placed.names))
    cells = list(zip(*rows, strict=True)) if rows else [()] * len(placed.names)
    used = {column.place for column in placed.columns.values()}
    free = [
        _Looks(place, name, units[place], cells[place])
        for place, name in enumerate(placed.names)
        if place not in used and name
    ]
    found: dict[str, tuple[_Looks, str]] = {}
    absent = [c for c in (STAMP, STAMP_NANOSEC, *CHANNELS) if c not in placed.columns]

    def take(channel: str, looks: _Looks, unit: str) -> None:
        found[channel] = looks, unit
        free.remove(looks)
        if channel in absent:
            absent.remove(channel)

    time, scores = '', {looks: score for looks in free if (score := looks.time_score())}
    if STAMP in absent and scores:
        best = max(scores, key=scores.__getitem__)
        time = best.form
        take(STAMP, best, '')
        for looks in [looks for looks in free if _NANOSEC.fullmatch(looks.plain)][:1]:
            take(STAMP_NANOSEC, looks, '')
    for looks, score in scores.items():
        if score > 1 and looks in free:  # another time
            free.remove(looks)
    if set(AXES) <= set(absent):
        for channel, looks in zip(AXES, _six_of(free), strict=False):
            take(channel, looks, looks.unit_of(channel))
    thermometers = (c for c in map(temperature_channel, count()) if c not in placed.columns)
    for looks in list(free):
        channel = _named_like(looks.plain, absent)
        if (unit := looks.temperature_unit()) is not None:
            take(next(thermometers), looks, unit)
        elif not may_be_temperature((looks.plain,)) and channel and looks.may_be(channel):
            take(channel, looks, looks.unit_of(channel))
    if set(AXES) <= set(absent):
        for looks in free:
            unit = looks.unit_of('force_z')
            if looks.may_be('force_z') and (unit or _FORCE_WORD.search(looks.plain)):
                take('force_z', looks, unit)
                break
    return _written(placed, found), time


def _written(placed: Placed, found: Mapping[str, tuple[_Looks, str]]) -> str:
    """Write a map of what was found, and of what has to be named."""
    # Where newtons cannot be, forces that name no unit are in kilonewtons.
    spans = {c: float(np.ptp(of.numbers)) for c, (of, _) in found.items() if len(of.numbers)}
    force, torque = (max(spans.get(c, 0.0) for c in axes) for axes in (AXES[:3], AXES[3:]))
    in_kilonewtons = 0 < force < max(_NEVER_NEWTONS, min(torque, _PERHAPS_NEWTONS))
    entries = []
    order = STAMP, STAMP_NANOSEC, *AXES, *map(temperature_channel, range(100)), *CHANNELS
    for channel in dict.fromkeys(order):
        if channel in found:
            looks, unit = found[channel]
            if in_kilonewtons and channel in AXES[:3]:
                unit = unit or 'kN'
            name = placed.names[looks.place]
            if _MAP_SIGNS.search(name) or placed.names.count(name) > 1:
                name = str(looks.place + 1)
            entries.append(f'{channel}={name}:{unit}' if unit else f'{channel}={name}')
    for channel, kind in zip((STAMP, 'force_z', 'temperature_c'), KINDS.values(), strict=True):
        if {*kind}.isdisjoint({*placed.columns, *found}):
            entries.append(f'{channel}={OPEN}')
    return ','.join(entries[:_MOST_ENTRIES])


def _six_of(free: Iterable[_Looks]) -> list[_Looks]:
    """Find six columns of a wrench that are numbered: the raw one first."""
    groups: dict[str, list[_Looks]] = {}
    for looks in free:
        if match := re.fullmatch(r'(.*(?:wrench|force|torque|ft).*?)_?(\d+)', looks.plain):
            groups.setdefault(match[1], []).append(looks)
    six = {name: group for name, group in groups.items() if len(group) == len(AXES)}
    return six[min(six, key=lambda name: 'raw' not in name)] if six else []


def _named_like(plain: str, absent: Sequence[str]) -> str:
    """Find the missing channel that a column may be, or ''; a reference only if it says so."""
    prefix = 'reference_' if _TRUE.search(plain) else ''
    plain = _TRUE.sub('', plain).strip('_')
    if plain.startswith('external_'):
        return ''
    names = [n.removeprefix(prefix) for n in absent if n.startswith('reference_') == bool(prefix)]
    short = re.sub(r'_(k|m|c)?n(m|mm)?$|_(lbf|kgf?|g)$', '', plain)
    # Such as /ft/wrench/force/x, whatever stands before.
    ends = [name for name in names if plain.replace('_', '').endswith(name.replace('_', ''))]
    # A second force_z is like force_y, but of another axis; and so is Z Force.
    axes = [part for part in re.split(r'[\d_]+', plain) if part in {'x', 'y', 'z'}]
    axes += re.findall(r'[xyz]$', plain)
    alike = [n for n in names if not axes or n[-2:-1] != '_' or n[-1] in axes]
    near = difflib.get_close_matches(short, alike, 1, _LEAST_SIMILARITY)
    last = re.sub(r'.*_(?=f[xyz]$)', '', short)  # such as ft_fz
    name = _ALIASES.get(short) or _ALIASES.get(last) or next(iter((*ends, *near)), '')
    return f'{prefix}{name}' if name in names else ''
