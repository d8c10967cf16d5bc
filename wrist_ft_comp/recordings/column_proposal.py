"""
What the columns of another program's log may be: proposed by names, units and values.

A time increases; of two, one that is no row number. A temperature has its name or its unit, and
readings that a thermometer makes. A force has its name, or it is what is left with a unit or a
word of forces. What never changes, what counts, and texts are none of them. What cannot be told
stays open, as in ``force_z=…``.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import count
import re
import shlex
from typing import NamedTuple
from unicodedata import normalize

import numpy as np

from wrist_ft_comp import units
from wrist_ft_comp.channels import AXES, CHANNELS, is_plausible, temperature_channel
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recordings import column_map, table_format
from wrist_ft_comp.recordings.column_map import Column, KINDS, Placed
from wrist_ft_comp.recordings.table import Table, TableInMemory
from wrist_ft_comp.recordings.table_format import exact_ns, find_form, Header, LIKELY_DAYS, MISSING
from wrist_ft_comp.series import NANOSECONDS
from wrist_ft_comp.stored.recording_writer import ORIGIN
from wrist_ft_comp.units import STAMP, TIME_UNITS_NS, to_celsius
from wrist_ft_comp.wire.temperature_source import may_be_temperature

_EXPECTED = {
    'stamp': 'stamp_s (or stamp_ms, stamp_us, stamp_ns, stamp_min, stamp_h)',
    'raw wrench': f'any of {", ".join(AXES)}',
    'temperature': 'temperature_c (or temperature_k, temperature_f)',
}
#: Stands in a map for a column that a person has to name.
OPEN = '…'
#: Words of quantities, in small letters, in the languages of common recorders.
_QUANTITIES = {
    'force': 'forces?|frc|f|kraft|effort|fuerza|forza|síla|сила|힘|力|荷重',
    'torque': 'torques?|trq|t|m|mom|momento?|drehmoment|couple|coppia|момент|'
              '토크|トルク|力矩|扭矩',
    'linear_acceleration': 'acceleration|accel|acc|a|beschleunigung',
}  # fmt: skip
#: A word that ends in an axis, and the quantity before it.
_AXIS = re.compile(f'({"|".join(_QUANTITIES.values())})?([xyz])')
#: Words of times, in words of names, and alone.
_TIME_WORD = re.compile(
    'time|stamp|zeit|dat(e|um)|elapsed|epoch|clock|secs?$|seconds|millis|micros|horodat|heure|'
    'temps$|tiempo|fecha|hora$|tempo$|日時|時刻|時間|时间|日期'
)
_ELAPSED = {'elapsed', 'relative', 'duration', 'laufzeit'}
_SHORT_TIME = {'t', 'x', 'ms', 'us', 'x_value', 'xvalue', *TIME_UNITS_NS}
#: Words of thermometers beside those of any language that begin with "temp".
_HEAT_WORDS = {'t', 'tmp', 'tc', 'pt', 'rtd', 'ntc', 'thermistor', '温度', '온도', 'температура'}
#: Words of the true wrench; of what is asked for, allowed, or made of readings; of what is no raw
#: wrench; of what was read; and of any force.
_TRUE = {'reference', 'ref', 'truth', 'true'}
_NO_READING = re.compile(
    'target|desired|cmd|command|set_?(point|value|pt)|soll|nominal|consigne|limit|grenz|alarm|'
    'threshold|schwell|deviation|abweichung|gradient|percent|prozent|peak|valley|spitze|'
    'taupunkt|variance|(?<![a-z])(dew|(sp|set|nom|lim|rate|d_?t_dt|pct|pk|power|std|rms|min|max|'
    'minimum|maximum)(?![a-z]))|_(dev|err|error)$'
)
TREATED = re.compile(
    f'compensat|filter|tare|zero|bias|external|reference|drift|{_NO_READING.pattern}',
    re.IGNORECASE)  # fmt: skip
_READING = {
    'pv', 'ist', 'istwert', 'act', 'actual', 'meas', 'measured', 'messwert', 'mean', 'avg',
    'average', 'mittelwert',
}  # fmt: skip
_FORCE_WORD = re.compile(
    'force|kraft|load|last|weight|gewicht|cell|zelle|newton|frc|gauge|dms|effort|poids|charge|'
    'fuerza|peso|carga|forza|сила|вес|힘|力|荷重|重'
)
#: Six numbers are a wrench by their names, unless they are of joints or motors.
_WRENCH = re.compile('(?!.*(joint|motor|current|target|tau)).*(wrench|force|torque|(^|_)ft?(_|$))')
#: Names of temperatures of what heats the sensor, or of its surroundings.
FAR = re.compile(r'motor|drive(?!r)|joint|cabinet|ambient|room|cpu|battery', re.IGNORECASE)
#: What has a temperature and is no metal near a sensor.
_NO_THERMOMETER = {'cpu', 'battery', 'batt', 'gpu', 'soc', 'stamp', 'secs'}
#: Two clocks that are farther apart count from another day, ns.
_OTHER_EPOCH_NS = 10**17
#: A name of nanoseconds, and what stands before it and before whole seconds.
_NANOSEC = re.compile('(.*?)_?(nano|n)_?sec(s|onds)?')
#: What of a name is no word of it: a unit in brackets or behind a slash, what follows a comma.
_NO_WORD = re.compile(r'[\[(][^\[\]()]*[^\W\d][^\[\]()]*[\])]|\s/\s.*|,.*')
#: Signs of a map: a column with one of them in its name is called by its number.
_MAP_SIGNS = re.compile(r'[,:=…]|\*[-+.\deE]')
#: Readings of a wrist in kelvins, the most that they are apart, and those in tenths of °C.
_KELVINS, _MOST_SPAN_K, _TENTHS = (253.15, 450.0), 80.0, (100.0, 600.0)
#: Most channels that rows of one channel each may have.
_MOST_CHANNELS = 40
#: A temperature moves from sample to sample by a smaller share of all that it moves.
_SMOOTH = 0.2
#: A time runs back, as at midnight, in at most this share of the rows.
_MOST_BACK = 0.05
#: Numbers in this range that grow by less are days, and no seconds.
_MOST_DAYS = 30.0


class Proposal(NamedTuple):
    """A map of the columns of tables with one clock, as --columns and --time take it."""

    columns: str
    time: str

    @classmethod
    def of(cls, found: Sequence[tuple[dict[str, str], str]], lacking: Sequence[str]) -> 'Proposal':
        """Join what propose found in each table; KINDS that are lacking without it stay OPEN."""
        times, entries = {time for _, time in found if time}, []
        for columns, time in found:
            # Each table has its own form of times; forms of dates are found again.
            own = f':{time}' if len(times) > 1 and time in TIME_UNITS_NS else ''
            for ours, theirs in columns.items():
                if theirs != OPEN or 'raw wrench' in lacking:
                    entries.append(f'{ours}={theirs}{own if ours == STAMP else ""}')
        still_lacking = column_map.lacking_kinds([columns for columns, _ in found])
        for kind, channel in zip(KINDS, (STAMP, 'force_z', 'temperature_c'), strict=True):
            if kind in lacking and kind in still_lacking:
                entries.append(f'{channel}={OPEN}')
        return cls(','.join(entries), times.pop() if len(times) == 1 else '')

    def refusal(self, table: str, names: list[str], lacking: list[str], how: str = '') -> str:
        """Say which KINDS of columns a table lacks, and how to say what they are."""
        expected = ' and '.join(_EXPECTED[kind] for kind in lacking)
        form = f' --time {shlex.quote(self.time)}' if self.time not in {'', 's'} else ''
        how = how or f"such as --columns '{self.columns}'{form}."
        sentence = (
            f'{table} has no {" and no ".join(lacking)} column; expected {expected}, got '
            f'{column_map.listed(names)}. Rename them, or say what they are, {how}'
        )
        if OPEN in self.columns:
            sentence += f' Put the name or the number of a column in the place of {OPEN}.'
        if f'temperature_c={OPEN}' in self.columns:
            sentence += ' If it is in another file of this clock, join both: force.csv+heat.csv.'
        return sentence


def warn_of_unused(placed: Placed) -> Iterator[str]:
    """Warn, in one sentence, of columns that are not used, and say what their names mean."""
    unused = [placed.header.names[place] for place in placed.unused]
    unused = [n for n in unused if n and not n.startswith((ORIGIN, column_map.COMPENSATED))]
    if unused:
        names = column_map.listed(unused)
        meant = Proposal.of([propose(placed)], ()).columns
        perhaps = f" Perhaps they are: --columns '{meant}'." if meant else ''
        yield f'{placed.table} has columns that are not understood and not used: {names}.{perhaps}'


def warn_of_clocks(placed: Placed, table: Table | TableInMemory) -> Iterator[str]:
    """Warn of times between channels, which differ from those by which the channels are read."""
    header, stamp, used = placed.header, placed.columns.get(STAMP), placed.channels
    if stamp is None or stamp.place < 0 or not used:
        return
    first = next((column.place for column in used if column.place > stamp.place), used[-1].place)
    between = [_Looks(k, (), header) for k in placed.unused if first < k < used[-1].place]
    times = [looks for looks in between if looks.time_score() or looks.unit_of(STAMP)]
    times = [looks for looks in times if not _NANOSEC.fullmatch(looks.plain)]
    shown = table.shown_rows() if times else []
    starts = [looks.place for looks in times if _is_another_clock(stamp, looks, shown)]
    if starts:
        late = column_map.listed(column.name for column in used if column.place > starts[0])
        yield (
            f'{placed.table} has another time before {late}, which differs from {stamp.name} and '
            'is not used. Make a file of each time and its columns, and join them: '
            'force.csv+heat.csv.'
        )


def _is_another_clock(stamp: Column, looks: '_Looks', rows: Sequence[Sequence[str]]) -> bool:
    """Whether times differ by more than a second, or, from a beginning, move apart by as much."""
    pairs = [(row[stamp.place], row[looks.place]) for row in rows]
    pairs = [pair for pair in pairs if not MISSING & {cell.lower() for cell in pair}]
    with suppress(ValueError, ArithmeticError):
        one, other = zip(*pairs, strict=True)
        form = stamp.unit or find_form(one)
        apart_ns = exact_ns(other, looks.unit_of(STAMP) or form) - exact_ns(one, form)
        is_since_1970 = abs(apart_ns[0]) > _OTHER_EPOCH_NS
        return bool(np.abs(apart_ns - apart_ns[0] * is_since_1970).max() > NANOSECONDS)
    return False


class _Looks:
    """A column that is not understood yet: its name, and what its cells look like."""

    def __init__(self, place: int, cells: Sequence[str], header: Header) -> None:
        self.place, self.unit = place, header.units.get(place, '')
        self.name = name = header.title(place)
        #: The words and numbers of its name in small letters, without a unit.
        text = _NO_WORD.sub(' ', normalize('NFKC', name))
        text = re.sub(r'(?<=[a-z])(?=[A-Z])|(?<=[\u3040-\ud7af])(?=[A-Za-z])', ' ', text)
        self.words = re.findall(r'[^\W\d_]+|\d+', text.lower())
        self.plain = '_'.join(self.words)
        self.filled = [cell for cell in cells if cell.lower() not in MISSING]
        numbers = []
        for cell in self.filled:
            with suppress(ValueError):
                numbers.append(header.number_in(cell))
        self.numbers = np.array(numbers)
        #: Whether nearly all cells that are filled hold a number; without cells nobody knows.
        self._is_number = not cells or len(self.numbers) > 0.9 * len(self.filled) > 0
        steps = np.diff(self.numbers)
        is_constant = len(steps) > 1 and not steps.any()
        self._counts = len(steps) > 2 and abs(steps[0]) == 1 and bool((steps == steps[0]).all())
        self.is_no_reading = _NO_READING.search(self.plain) is not None
        #: Whether its values may be those of a sensor.
        self.is_measured = self._is_number and not is_constant and not self._counts
        # t is a time, and T is a temperature.
        is_short = self.plain in _SHORT_TIME and not name.strip().startswith('T')
        self._is_time_word = is_short or any(map(_TIME_WORD.search, self.words))
        #: What --time has to say where it is a time.
        self.form = find_form(self.filled, month_first=header.delimiter == ',')
        if self.form == '%H:%M' and not _ELAPSED.isdisjoint(self.words):
            self.form = units.TIMEDELTA
        if self._is_number and len(self.numbers):
            own = units.plain_unit(self.plain) if self._is_time_word else ''
            own = own if own in TIME_UNITS_NS and (is_short or own != 's') else ''
            self.form = self.unit_of(STAMP) or own or table_format.unit_of_times(self.numbers)
            first, lasts = self.numbers[0], self.numbers[-1] - self.numbers[0]
            for form, day in units.DAYS_TO_1970.items() if self._is_time_word else ():
                if LIKELY_DAYS[0] < first - day < LIKELY_DAYS[1] and 0 <= lasts < _MOST_DAYS:
                    self.form = form

    def unit_of(self, channel: str) -> str:
        """Find its unit as one of a channel; empty where it is in no such unit."""
        return units.known_unit(channel, self.name, self.unit)

    def may_be(self, channel: str) -> bool:
        """Whether neither unit nor values exclude that it is what a sensor reads of a channel."""
        others = ('temperature_c', 'force_x', 'torque_x', 'linear_acceleration_x')
        has_other_unit = not self.unit_of(channel) and any(map(self.unit_of, others))
        return self.is_measured and not has_other_unit

    def time_score(self) -> float:
        """Tell how well it is a time; 0 where it is none."""
        if not self.filled:
            return float(self._is_time_word)
        has_unit = bool(self.unit_of(STAMP))
        is_clock = not self._is_number or self.form in units.DAYS_TO_1970
        is_clock = is_clock or bool(table_format.epoch_unit(float(self.numbers[0])))
        if not self.form or not (is_clock or self._is_time_word or has_unit):
            return 0.0
        try:
            steps = np.diff(exact_ns(self.filled, self.form))
        except (ValueError, ArithmeticError):
            return 0.0
        steps = -steps if len(steps) and (steps <= 0).all() else steps  # the newest is first
        if not len(steps) or np.mean(steps < 0) > _MOST_BACK:
            return float(not len(steps))
        # A clock is better than seconds, and seconds are better than what counts rows.
        is_row_number = self._counts and not is_clock and not has_unit
        merit = 1.0 + 2.0 * is_clock + 0.5 * self._is_time_word - 0.5 * is_row_number
        return merit * float(np.mean(steps > 0))

    def thermometer(self) -> str | None:
        """Find :UNIT, or a factor, by which it reads like a thermometer; None if it is none."""
        unit, steps = self.unit_of('temperature_c'), np.abs(np.diff(self.numbers))
        is_named = may_be_temperature((self.plain,)) or (
            not _HEAT_WORDS.isdisjoint(self.words)
            and not any(map(_AXIS.fullmatch, self.words))
            and (len(steps) < 8 or bool(np.median(steps) < _SMOOTH * np.ptp(self.numbers)))
        )
        is_other = self.is_no_reading or not _NO_THERMOMETER.isdisjoint(self.words)
        if is_other or not (unit or is_named) or not self.may_be('temperature_c'):
            return None
        behind = f':{unit}' if unit else ''
        is_counts = 'raw' in self.words or units.RAW_UNIT.search(self.name.lower()) is not None
        if not unit and not is_counts and len(self.numbers):
            low, high = np.quantile(self.numbers, (0.05, 0.95)).tolist()
            if _KELVINS[0] < low <= high < min(low + _MOST_SPAN_K, _KELVINS[1]):
                behind = ':K'
            elif _TENTHS[0] <= low <= high <= _TENTHS[1]:
                behind = '*0.1'
        celsius = to_celsius(self.numbers, behind[1:] if behind[:1] == ':' else 'C')
        is_strange = sum(map(is_plausible, celsius.tolist())) <= 0.9 * len(celsius)
        return None if len(celsius) and behind != '*0.1' and is_strange else behind

    def channel(self) -> str:
        """Find the axis that its name means, or ''; of a reference only if it says so."""
        axis, by_unit = '', (q for q in ('force', 'torque') if self.unit_of(f'{q}_x'))
        quantity = next(by_unit, '')
        for word in sorted(self.words, key=len):
            match = _AXIS.fullmatch(word)
            part, axis = match.groups('') if match else (word, axis)
            named = (q for q, words in _QUANTITIES.items() if re.fullmatch(words, part))
            quantity = next(named, quantity)
        if not quantity or not axis or self.words[0] == 'external':
            return ''
        name = f'{quantity}_{axis}'
        return name if _TRUE.isdisjoint(self.words) else f'reference_{name}'


def propose(
    placed: Placed, rows: Sequence[Sequence[str]] = (), all_names: Sequence[str] = ()
) -> tuple[dict[str, str], str]:
    """Propose what other columns are: by our names, as --columns has them; and what --time is."""
    header, names = placed.header, placed.header.names
    cells = list(zip(*rows, strict=True)) if rows else [()] * len(names)
    free = [_Looks(k, cells[k], header) for k in placed.unused if names[k] or any(cells[k])]
    found, time = dict[str, _Looks](), ''
    if rows and header.lines_above:
        _refuse_long_form(placed.table, free, header)
    if STAMP not in placed.columns:
        found, time = _find_times(free, header)
    else:
        free = [looks for looks in free if not looks.unit_of(STAMP)]
    found |= _find_channels(free, placed)

    proposed = {}
    thermometers = [channel for channel in found if channel.startswith('temperature')]
    order = [*column_map.STAMP_COLUMNS, *AXES, *thermometers, *CHANNELS]
    for channel in filter(found.__contains__, dict.fromkeys(order)):
        looks = found[channel]
        # A map names a column by its number where its name is none for a map, or of two columns.
        name = names[looks.place]
        if not name or _MAP_SIGNS.search(name) or (all_names or names).count(name) > 1:
            name = str(header.columns_before + looks.place + 1)
        # Behind it stand the factor and the unit that the map has to have.
        behind = header.said.get(channel.partition('_')[0], '')
        if channel.startswith('temperature'):
            behind = looks.thermometer() or ''
        elif channel not in column_map.STAMP_COLUMNS and looks.unit_of(channel):
            behind = f':{looks.unit_of(channel)}'
        proposed[channel] = name + behind
    # Six numbers without a name are a wrench in an order that a person knows.
    unnamed = [looks for looks in free if looks.may_be('force_z')]
    if len(unnamed) >= len(AXES) and not {*AXES} & {*placed.columns, *proposed}:
        proposed |= dict.fromkeys(AXES, OPEN)
    return proposed, time


def _refuse_long_form(table: str, free: Sequence[_Looks], header: Header) -> None:
    """Refuse rows of one channel each: texts of a column name forces and temperatures."""
    numbers = [looks for looks in free if looks.is_measured]
    for looks in (k for k in free if numbers and not len(k.numbers)):
        channels = tuple(dict.fromkeys(looks.filled))[:_MOST_CHANNELS]
        meant, _ = propose(Placed(table, Header(names=channels), {}))
        if 'temperature_c' in meant and not {*AXES}.isdisjoint(meant):
            time = max(free, key=_Looks.time_score)
            value = max(numbers, key=lambda k: (-k.time_score(), len({*k.filled})))
            pivot = [repr(header.names[k.place]) for k in (value, time, looks)]
            raise RecordingError(
                f'{table} has a row for each channel ({", ".join(channels)}); expected a column. '
                f'Make them by python3 -c "import pandas; t = pandas.read_csv({table!r}, '
                f'sep={header.delimiter!r}, skiprows={header.lines_above - 1}, dtype=str, '
                f"encoding_errors='replace'); t[{pivot[0]}] = pandas.to_numeric(t[{pivot[0]}]"
                f".str.replace({header.decimal!r}, '.'), 'coerce'); t.pivot_table("
                f"{', '.join(pivot)}, sort=False).to_csv('wide.csv', mode='x')\"."
            )


def _find_times(free: list[_Looks], header: Header) -> tuple[dict[str, _Looks], str]:
    """Take the columns of the stamps from those that are free, and their form."""
    scores = {looks: score for looks in free if (score := looks.time_score())}
    if not scores:
        return {}, ''
    best = max(scores, key=scores.__getitem__)
    found, time = {STAMP: best}, best.form
    is_time_of_day = time.startswith(('%H', '%I'))
    for looks in free:
        # Nanoseconds go beyond whole seconds of the same stamp: none of an arrival's, say.
        nanosec = _NANOSEC.fullmatch(looks.plain) if time == 's' else None
        if nanosec and nanosec[1] in {'', best.plain, re.sub('_?sec(s|onds)?$', '', best.plain)}:
            is_whole = len(looks.filled) == len(best.filled) and not (best.numbers % 1).any()
            found |= {column_map.STAMP_NANOSEC: looks} if is_whole else {}
        is_date = looks is not best and looks.form.startswith(('iso', '%'))
        if is_date and is_time_of_day and not any(':' in cell for cell in looks.filled):
            found.setdefault(column_map.STAMP_DATE, looks)
    if date := found.get(column_map.STAMP_DATE):
        joined = map(' '.join, zip(date.filled, best.filled, strict=False))
        time = find_form([*joined], month_first=header.delimiter == ',')
    free[:] = [k for k in free if k not in found.values() and scores.get(k, 0.0) <= 1]
    return found, time


def _find_channels(free: list[_Looks], placed: Placed) -> dict[str, _Looks]:
    """Take the columns of thermometers, forces and torques from those that are free."""
    absent = [channel for channel in CHANNELS if channel not in placed.columns]
    hot = [looks for looks in free if looks.thermometer() is not None]
    hot.sort(key=lambda looks: bool(FAR.search(looks.plain)))
    # Thermometers that say no unit have that of all others.
    if {looks.unit_of('temperature_c') for looks in hot} == {'', 'F'}:
        for looks in hot:
            looks.unit = 'F'
    thermometers = (c for c in map(temperature_channel, count()) if c not in placed.columns)
    found = dict(zip(thermometers, hot, strict=False))

    # Six numbered columns, such as ft_raw_wrench_0 to ft_raw_wrench_5, are a wrench.
    numbered: dict[str, list[_Looks]] = {}
    for looks in free:
        base, _, number = looks.plain.rpartition('_')
        if number.isdecimal() and _WRENCH.match(base):
            numbered.setdefault(base, []).append(looks)
    axes = dict[_Looks, str]()
    for group in numbered.values():
        axes.update(zip(group, AXES, strict=True) if len(group) == len(AXES) else ())

    def rank(looks: _Looks) -> tuple[int, ...]:
        is_treated, words = TREATED.search(looks.plain) is not None, looks.words
        has_unit = bool(looks.unit_of('force_x') or looks.unit_of('torque_x'))
        # fz_N before fz_raw, its counts; not tcp_fz_N, which is of another frame.
        own = {*words} - {unit.lower() for unit in units.UNIT_WORDS}
        of_raw = has_unit and any(own <= {*k.words} for k in free if 'raw' in k.words)
        return is_treated, not of_raw, 'raw' not in words, _READING.isdisjoint(words), len(words)

    cold = sorted((k for k in free if k not in hot and not k.is_no_reading), key=rank)
    for looks in cold:
        channel = axes.get(looks) or looks.channel()
        if channel in absent and looks.may_be(channel):
            found.setdefault(channel, looks)
    # The only force of a log is taken for the one along z; of several, a person knows the axes.
    forces = [k for k in cold if k.unit_of('force_z') or _FORCE_WORD.search(k.plain)]
    forces = [looks for looks in forces if looks.may_be('force_z')]
    if len(forces) == 1 and {*AXES} <= {*absent} - {*found}:
        found['force_z'] = forces[0]
    free[:] = [looks for looks in free if looks not in found.values()]
    return found
