"""What is written and read: options of the command, columns of recordings, entries of models."""

import argparse
from collections.abc import Iterator
import json
from pathlib import Path
from typing import Any

from markdown import table

import wrist_ft_comp
from wrist_ft_comp.channels import (
    AXES,
    FORCE_CHANNELS,
    REFERENCE_CHANNELS,
    ROTATION_CHANNEL,
    temperature_channel,
)
from wrist_ft_comp.cli.main import build_parser
from wrist_ft_comp.errors import WristFtCompError

SCHEMA = Path(wrist_ft_comp.__file__).parent / 'stored/model.schema.json'
FORMATS = """\
## Recordings

A rosbag2 folder (mcap or sqlite3, compressed or not), a bare `.mcap` or `.db3`, or a table: CSV,
packed or not, a workbook, parquet. A table has these columns in any order, or a map of its own
columns to these (`--columns`). A cell is empty where a channel has no sample.
"""
EXITS = """\
Options that several commands take stand [below](#options-of-several-commands).

Exit codes: 0, done; 1, refused or failed, with one sentence on standard error (of `node status`:
something is not OK); 2, a wrong option or argument; 130, interrupted by Ctrl-C.

With `--json` an error is also `{"error": {"kind": …, "message": …}}` on standard output. `kind` is
%s, `interrupted` or `operating_system`. Later versions may have more.

A command replaces an existing file only if it is empty, or was written by this package and is of
the same kind (known by its content): a model replaces a model, a report a report, a picture a
picture. All other files stay, also those that the command reads. Recordings stay, too:
`compensate` needs a new name. An option that the given files have no use for is ignored.
"""
MODEL_FILE = """
## Model file

YAML, version 4, checked when it is loaded; another version is refused. `*` stands for the name of
an axis. The table has what needs a word; `wrist_ft_comp/stored/model.schema.json` has all entries.
"""
#: Entries whose own entries are left out, because no person reads or writes them.
INNER = ('prediction', 'axes.*.candidates', 'axes.*.model')


def command_line() -> Iterator[str]:
    """Describe the command's options, in a form that no Python version changes."""
    yield '## Command `wrist_ft_comp`\n'
    yield EXITS % ', '.join(f'`{error.kind()}`' for error in WristFtCompError.__subclasses__())
    kind = argparse._SubParsersAction
    (subparsers,) = (a for a in build_parser()._actions if isinstance(a, kind))
    commands: dict[str, argparse.ArgumentParser] = dict(subparsers.choices)
    users: dict[tuple[str, str], list[str]] = {}
    for name, parser in commands.items():
        for row in map(option_row, parser._actions[1:]):
            users.setdefault(row, []).append(name)
    # What several commands take is described once, but for what they begin with.
    shared = [row for row, names in users.items() if len(names) > 1 and row[0][1] == '-']
    for name, parser in commands.items():
        rows = map(option_row, parser._actions[1:])
        yield f'### `{name}`\n\n{parser.description}\n'
        yield table(('argument', 'what it is'), (row for row in rows if row not in shared)) + '\n'
    yield '### Options of several commands\n'
    several = ((row[0], ', '.join(names), row[1]) for row, names in users.items() if row in shared)
    yield table(('option', 'commands', 'what it is'), several) + '\n'


def option_row(action: argparse.Action) -> tuple[str, str]:
    """Describe one option."""
    value = (
        action.metavar
        or (action.choices and ','.join(map(str, action.choices)))
        or action.dest.upper()
    )
    value = '' if action.nargs == 0 else f' {value}' if action.option_strings else str(value)
    name = f'{", ".join(action.option_strings)}{value}'
    return f'`{name}`', str(action.help or '') % {**vars(action), 'prog': 'wrist_ft_comp'}


def csv_columns() -> str:
    """List the columns of a CSV recording."""
    thermometers = ', '.join(f'`{temperature_channel(j)}`' for j in range(3))
    rows = [
        [' or '.join(f'`stamp_{unit}`' for unit in ('h', 'min', 's', 'ms', 'us', 'ns')),
         'h, min, s, ms, µs or ns',
         'one of them, ascending; kept as integer nanoseconds'],
        [', '.join(f'`{axis}`' for axis in AXES), 'N, N m', 'raw wrench, any subset'],
        [f'{thermometers} …', '°C',
         ('thermometers, the one inside the sensor first; '
          '`temperature_k`, `temperature_2_f` … are in K or °F')],
        [', '.join(f'`{channel}`' for channel in REFERENCE_CHANNELS), 'N, N m',
         'true wrench, any subset'],
        [', '.join(f'`{channel}`' for channel in FORCE_CHANNELS), 'm/s²',
         ('specific force in any frame fixed to the sensor, as sensor_msgs/Imu: 9.81 upwards at '
          'rest; all three or none')],
        [f'`{ROTATION_CHANNEL}`', 'rad/s', 'speed of rotation of the sensor'],
        ['`recorded_from?…`', '–',
         ('empty; written by a node, its name goes on with what the sensor was called, such as '
          '`frame_id=ft&wrench_topic=/ft/wrench&temperature_topics=/ft/temperature`')],
    ]  # fmt: skip
    return table(('column', 'unit', 'what it is'), rows)


Schema = dict[str, Any]


def resolved(schema: Schema, entry: Schema) -> Schema:
    """Follow a reference, and take of alternatives the one that is something."""
    if '$ref' in entry:
        entry = {**schema['$defs'][entry['$ref'].split('/')[-1]], **entry}
    for choice in entry.get('oneOf', ()):
        if choice.get('type') != 'null':
            return {**resolved(schema, choice), 'nullable': True}
    return entry


def kind(schema: Schema, entry: Schema) -> str:
    """Name the type of an entry."""
    if 'const' in entry or 'enum' in entry:
        values = entry.get('enum', [entry.get('const')])
        return ' or '.join(f'`{json.dumps(value)}`' for value in values)
    types = entry['type'] if isinstance(entry['type'], list) else [entry['type']]
    types = [*types, 'null'] if 'nullable' in entry else types
    inner = resolved(schema, entry.get('items', {}))
    return ' or '.join(types) + (f' of {kind(schema, inner)}' if 'type' in inner else '')


def schema_rows(schema: Schema, entry: Schema, path: str) -> Iterator[list[str]]:
    """Walk a schema; lists of plain values are one row."""
    entry = resolved(schema, entry)
    names = {'minimum': 'at least', 'maximum': 'at most', 'minItems': 'min.', 'maxItems': 'max.'}
    limits = (f'{word} {entry[key]}' for key, word in names.items() if key in entry)
    what = kind(schema, entry)
    if path and 'description' in entry:
        yield [f'`{path}`', what, ', '.join(limits), entry.get('description', '')]
    if path in INNER:
        return
    for name, inner in entry.get('properties', {}).items():
        yield from schema_rows(schema, inner, f'{path}.{name}'.lstrip('.'))
    if isinstance(entry.get('additionalProperties'), dict):
        yield from schema_rows(schema, entry['additionalProperties'], f'{path}.*')
    if isinstance(entry.get('items'), dict):
        yield from schema_rows(schema, entry['items'], f'{path}[]')


def file_formats() -> Iterator[str]:
    """Describe recordings and model files."""
    yield FORMATS
    yield csv_columns()
    yield MODEL_FILE
    schema = json.loads(SCHEMA.read_text('utf-8'))
    yield table(('entry', 'type', 'allowed', 'what it is'), schema_rows(schema, schema, ''))
