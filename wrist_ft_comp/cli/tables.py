"""Tables, verdicts and warnings that commands print, and the same for scripts."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
import sys
import textwrap

import numpy as np

from wrist_ft_comp.cli.options import print_json
from wrist_ft_comp.drift.drift_model import StoredModel
from wrist_ft_comp.fit.data_checks import silent_stretches
from wrist_ft_comp.fit.settings import CalibrationSettings
from wrist_ft_comp.learning.diary import Diary, last_change, Memory, TORQUES
from wrist_ft_comp.payload.weight import driver_calls, Payload
from wrist_ft_comp.ranges import rounded
from wrist_ft_comp.recording import Recording
from wrist_ft_comp.report.days import (
    date_of,
    drift_left,
    DriftLeft,
    event_line,
    events,
    judged_drifts,
    known_temperatures,
    summary,
    usual_drift,
)
from wrist_ft_comp.report.report_content import ReportContent
from wrist_ft_comp.report.verdict import LEVEL_NAMES
from wrist_ft_comp.stored.payload_file import payload_figures
from wrist_ft_comp.stream.offline import thermometer_doubts

#: Letters in a line of a terminal.
WIDTH = 80
#: Most days in the table; JSON has all.
MOST_DAYS = 40
#: Newest days whose verdicts are printed.
_VERDICTS = 3
_GAP = '  '


def table_text(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Align a table of at most 80 columns: the first to the left, the others to the right."""
    table = [list(header), *(list(row) for row in rows)]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    while sum(widths) + len(_GAP) * (len(widths) - 1) > WIDTH:
        widths[widths.index(max(widths))] -= 1
    lines = []
    for row in table:
        # A row takes as many lines as its highest cell needs.
        cells = [textwrap.wrap(cell, width) for cell, width in zip(row, widths, strict=True)]
        for first, *others in zip_longest(*cells, fillvalue=''):
            right = [f'{part:>{width}}' for part, width in zip(others, widths[1:], strict=True)]
            lines.append(_GAP.join([f'{first:{widths[0]}}', *right]).rstrip())
    return '\n'.join(lines)


def days_text(directory: Path, diary: Diary, memory: Memory) -> str:
    """Sum days up, put them into a table, and list what happened, and temperatures they saw."""
    days, happened = diary.days[-MOST_DAYS:], events(diary)
    rows = []
    for day in days:
        drift = drift_left(day)
        drifts = (*drift, 100 * drift.share)
        rows.append(
            [
                day.name.removesuffix('.csv'),
                date_of(day),
                f'{day.hours:.1f}' if day.first_ns else '-',
                ' to '.join(f'{value:.1f}' for value in (*day.temperature_c, ())[0]) or '-',
                *('-' if np.isnan(value) else rounded(value) for value in drifts),
            ]
        )
    header = ['day', 'date', 'hours', 'temperature, °C', 'drift, N', 'left, N', 'left, %']
    seen = (
        f'thermometer {j}: {", ".join(f"{low:.1f} to {high:.1f}" for low, high in ranges)} °C'
        for j, ranges in enumerate(known_temperatures(diary), start=1)
    )
    newest = f' (newest {MOST_DAYS} of {len(happened)})' if len(happened) > MOST_DAYS else ''
    lines = [
        f'What happened{newest}:' if happened else '',
        *(event_line(event, diary.days) for event in happened[-MOST_DAYS:]),
        *(f'{day.name}: {day.verdict}' for day in days[-_VERDICTS:] if day.verdict),
        f'last change: {last_change(diary.history) or "none yet"}',
        f'known temperatures: {"; ".join(seen) or "none yet"}',
        f'offered: {memory.offered}; call ~/adopt to make it live' if memory.offered else '',
        f'paused: {diary.paused}' if diary.paused else '',
    ]
    newest = f', of which the newest {MOST_DAYS}' if len(diary.days) > MOST_DAYS else ''
    head = [
        f'{directory}: days of a node that learns, {len(diary.days)}{newest}',
        *map(_filled, summary(diary)),
    ]
    return '\n'.join([*head, table_text(header, rows), '', *map(_filled, filter(None, lines))])


def days_json(diary: Diary, memory: Memory) -> dict[str, object]:
    """Turn days, what was left of their drift, and what happened into plain values."""
    # Where its recording could not be read, a day has neither date nor length.
    unknown = {'first_ns': None, 'hours': None}
    days = [
        {**vars(day), 'known': sorted(day.known), 'force_n': _shares(drift_left(day)),
         **({} if day.first_ns else unknown)}
        for day in diary.days
    ]  # fmt: skip
    happened = [
        {**event._asdict(), 'first': days[event.first]['name'], 'last': days[event.last]['name']}
        for event in events(diary)
    ]
    force, torque = judged_drifts(diary), judged_drifts(diary, TORQUES)
    medians = {'force_n': _shares(usual_drift(force)), 'torque_nm': _shares(usual_drift(torque))}
    decisions = [(entry.day, entry.why) for entry in diary.history if entry.day]
    node = {**vars(memory), 'change': last_change(diary.history)}
    sentence, counted = summary(diary)
    figures = {'sentence': sentence, 'counted': counted, 'days': len(force), **medians}
    said = {'summary': figures, 'events': happened}
    return {'days': days, 'decisions': decisions, 'paused': diary.paused, 'node': node, **said}


def _shares(drift: DriftLeft) -> dict[str, float]:
    """Turn what was left of a drift into plain values."""
    return {**drift._asdict(), 'share': drift.share}


def _filled(line: str) -> str:
    """Break a long line; what follows is indented."""
    return textwrap.fill(line, WIDTH, subsequent_indent='    ')


def payloads_json(payloads: Mapping[str, Payload]) -> list[dict[str, object]]:
    """Put payloads into plain values; what is not known is null."""
    return [
        {'name': name, **payload_figures(payload), 'driver_calls': driver_calls(payload)}
        for name, payload in payloads.items()
    ]


def verdict_lines(content: ReportContent) -> list[str]:
    """Say of every axis whether it is good, why, and what another day is accepted by."""
    lines = []
    for axis in content.axes:
        level = LEVEL_NAMES[axis.verdict.level]
        lines.append(_filled(f'{axis.axis}: {level}. {axis.verdict.sentence} {axis.limit}'))
    return [*lines, _filled(content.conditions)] if content.conditions else lines


def advice_lines(content: ReportContent) -> list[str]:
    """List what to record next, most important first."""
    return ['', 'What to record next:', *(_filled(f'  - {line}') for line in content.advice)]


@dataclass(frozen=True)
class Result:
    """The result of a command."""

    #: In words, and everything that a script may want.
    words: str
    document: Mapping[str, object]
    #: What a person should know besides; a script finds it in the document.
    warnings: Sequence[str] = ()


def print_result(result: Result, *, as_json: bool) -> None:
    """Print a result, in words or as JSON."""
    if as_json:
        print_json(result.document)
    else:
        print(result.words)
        print_warnings(result.warnings)


def print_warnings(sentences: Iterable[str]) -> None:
    """Print warnings to standard error; of two that begin alike, the longer one only."""
    distinct = dict.fromkeys(sentences)
    for sentence in distinct:
        if not any(other != sentence and other.startswith(sentence) for other in distinct):
            print(f'warning: {sentence}', file=sys.stderr)


def range_warnings(stored: StoredModel, recording: Recording) -> tuple[str, ...]:
    """Say where thermometers leave the range of a model, are silent for long, or are doubted."""
    sentences = []
    pairs = zip(recording.temperature_c.T, stored.document['thermometers'], strict=False)
    for number, (column, thermometer) in enumerate(pairs):
        low, high = thermometer['range_c']
        share = float(np.mean((column < low) | (column > high)))
        if share > 0:
            sentences.append(
                f'Thermometer {number + 1} of {recording.name} goes from {column.min():.1f} to '
                f'{column.max():.1f} °C; the model was learnt from {low:.1f} to {high:.1f} °C. '
                f'For {rounded(100 * share, 2)} % of the time the correction is a guess.'
            )
    heard = recording.measured
    if stored.model.prediction is not None:  # one that is silent is predicted by the others
        heard = np.broadcast_to(heard.any(axis=1, keepdims=True), heard.shape)
    silent = [replace(recording, measured=heard)]
    sentences += silent_stretches(silent, CalibrationSettings().max_gap_s)
    sentences += [
        f'In {recording.name}, for {rounded(100 * share, 2)} % of the time, {doubt}.'
        for doubt, share in thermometer_doubts(stored.model, recording).items()
    ]
    return tuple(sentences)
