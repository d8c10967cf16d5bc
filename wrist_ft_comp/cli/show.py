"""wrist_ft_comp show: what a file is."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from wrist_ft_comp.cli import options, paths
from wrist_ft_comp.cli.tables import table_text
from wrist_ft_comp.files.model_file import is_model, load_model
from wrist_ft_comp.files.recordings import (
    ChannelSummary,
    describe_recording,
    RAW_WRENCH,
    RecordingSummary,
    REFERENCE,
    TEMPERATURE,
)
from wrist_ft_comp.model.drift_model import StoredModel
from wrist_ft_comp.model.signals import NANOSECONDS
from wrist_ft_comp.report.view import drifts_removed

#: What a model is for, to whoever finds one.
_PURPOSE = (
    'It predicts from temperatures how a wrist force/torque sensor drifts. The node',
    '"compensator" runs it (parameter model_file); wrist_ft_comp evaluate judges it.',
)
EXAMPLES = """\
examples:
  wrist_ft_comp show model.yaml
  wrist_ft_comp show warm_up.mcap --json
"""


def add_parser(commands: options.Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        'show',
        help='say what a model or a recording holds',
        description='Say what a model file or a recording holds.',
        epilog=EXAMPLES,
    )
    parser.set_defaults(run=run)
    parser.add_argument('file', type=Path, metavar='FILE', help='MODEL.yaml or REC')
    options.add_topics(parser)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    if paths.is_report(arguments.file):
        return _show_report(arguments)
    if arguments.file.suffix in {'.yaml', '.yml'} or is_model(arguments.file):
        stored = load_model(arguments.file)
        if arguments.json:
            options.print_json({'sha256': stored.sha256, **stored.document})
        else:
            print(_model_text(stored))
        return 0
    with options.progress_bar('reading') as progress:
        summary = describe_recording(arguments.file, options.topics_from(arguments), progress)
    if arguments.json:
        options.print_json(asdict(summary))
    else:
        print(_text(summary, arguments.file))
    return 0


def _show_report(arguments: argparse.Namespace) -> int:
    """Say that a file is a report; returns the exit code."""
    if arguments.json:
        options.print_json({'name': arguments.file.name, 'kind': 'report'})
    else:
        print(f'{arguments.file}: a report of wrist_ft_comp; open it in a browser')
    return 0


def _model_text(stored: StoredModel) -> str:
    """Describe a model for people."""
    document = stored.document
    lines = [
        f'{stored.path}: a drift model, sha256 {stored.sha256[:12]}',
        *_PURPOSE,
        _origin(stored),
        *(
            f'thermometer {j}: calibrated from {low:.1f} to {high:.1f} °C'
            for j, (low, high) in enumerate(
                (thermometer['range_c'] for thermometer in document['thermometers']), start=1
            )
        ),
        '',
        _axes_text(stored),
        '',
        *(f'{axis}: {entry["chosen"]}' for axis, entry in document['axes'].items()),
        *(
            f'{axis}: {note}'
            for axis, entry in document['axes'].items()
            for note in entry['notes']
        ),
        *(f'warning: {warning}' for warning in document['warnings']),
    ]
    return '\n'.join(lines)


def _origin(stored: StoredModel) -> str:
    """Say when and from how much a model was made; people may have edited its provenance."""
    provenance = stored.document['provenance']
    recordings = provenance.get('recordings')
    count = len(recordings) if isinstance(recordings, list) else 0
    return (
        f'made {provenance.get("created", "at an unknown time")} from '
        f'{stored.document["duration_s"] / 3600:.2f} h in {count} '
        f'recording{"" if count == 1 else "s"}; thermal period '
        f'{stored.model.period_ns / NANOSECONDS:g} s'
    )


def _axes_text(stored: StoredModel) -> str:
    """Put the evidence of every axis into a table."""
    return table_text(
        ['axis', 'unit', 'RMS before', 'after (held out)', 'drift', 'time constants, s'],
        [
            [
                axis,
                entry['unit'],
                f'{entry["rms_before"]:.4g}',
                f'{entry["rms_after"]:.4g}',
                drifts_removed(stored.model.axes.get(axis)),
                ', '.join(f'{tau:.0f}' for tau in entry['time_constants_s']) or '-',
            ]
            for axis, entry in stored.document['axes'].items()
        ],
    )


def _duration_s(summary: RecordingSummary) -> float | None:
    """Time span of a recording, s."""
    if summary.first_ns is None or summary.last_ns is None:
        return None
    return (summary.last_ns - summary.first_ns) / NANOSECONDS


def _text(summary: RecordingSummary, path: Path) -> str:
    """Describe a recording for people."""
    duration_s = _duration_s(summary)
    span = 'no samples' if duration_s is None else f'{duration_s:.1f} s'
    rows = [
        [c.name, c.kind, str(c.samples), _rate(c, duration_s), c.role or '-']
        for c in summary.channels
    ]
    return '\n'.join(
        [
            f'{summary.name}: {summary.kind}, {span}',
            table_text(['channel', 'type or unit', 'samples', 'per second', 'used as'], rows),
            *_use(summary, path),
            *(f'warning: {warning}' for warning in summary.warnings),
        ]
    )


def _rate(channel: ChannelSummary, duration_s: float | None) -> str:
    """Say how often a channel was sampled, on average."""
    return f'{(channel.samples - 1) / duration_s:.4g}' if duration_s else '-'


def _use(summary: RecordingSummary, path: Path) -> Iterator[str]:
    """Say what a recording is good for, or what it lacks."""
    held = {channel.role for channel in summary.channels if channel.samples}
    lacks = [role for role in (RAW_WRENCH, TEMPERATURE) if role not in held]
    if not lacks:
        reference = ' --reference recorded' if REFERENCE in held else ''
        yield f'Learn from it: wrist_ft_comp calibrate {path} -o model.yaml{reference}'
        return
    kinds = {RAW_WRENCH: '/WrenchStamped', TEMPERATURE: '/Temperature'}
    options_of = {RAW_WRENCH: '--wrench-topic', TEMPERATURE: '--temperature-topic'}
    fitting = {
        role: [c.name for c in summary.channels if c.kind.endswith(kinds[role]) and not c.role]
        for role in lacks
    }
    missing = [role for role in lacks if not fitting[role]]
    if missing:
        yield f'It holds no {" and no ".join(missing)}, so nothing can be learnt from it.'
        return
    names = [f'{options_of[role]} {name}' for role in lacks for name in fitting[role]]
    yield "If these are the sensor's topics, learn from them (its own thermometer first):"
    yield f'wrist_ft_comp calibrate {path} -o model.yaml {" ".join(names)}'
