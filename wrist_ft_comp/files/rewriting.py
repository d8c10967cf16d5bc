"""
Copies of recordings with the wrench corrected: each kind of file into the same kind.

These functions write where they are told to; that nothing half-written is left behind is the
front door's part (recordings.py).
"""

from collections.abc import Callable, Iterable
from contextlib import suppress
import csv
from pathlib import Path

import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores

from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.files import cdr
from wrist_ft_comp.files.bag import Bag, Topics, unpack, WRENCH_TYPE
from wrist_ft_comp.files.chamber_table import read_chamber_table, write_chamber_table
from wrist_ft_comp.files.csv_file import CsvChunk, CsvText, numbers, sound_chunks, stamps_ns
from wrist_ft_comp.model.signals import AXES, FloatArray, IntArray

#: Takes stamps_ns (n,) and raw wrenches (n, 6), N and N m; returns corrected wrenches (n, 6).
Correction = Callable[[IntArray, FloatArray], FloatArray]


Progress = Callable[[float], None]


_COMPRESSION = {
    '': CompressionMode.NONE,
    'file': CompressionMode.FILE,
    'message': CompressionMode.MESSAGE,
}


def _correct_chunk(text: CsvText, chunk: CsvChunk, correct: Correction) -> list[list[str]]:
    """Return the chunk's columns, those of the wrench corrected where there are values."""
    columns = list(chunk.columns)
    wrench = np.full((len(chunk.lines), len(AXES)), np.nan)
    filled = np.zeros(wrench.shape, bool)
    present = [axis for axis in AXES if axis in text.layout.columns]
    for axis in present:
        column = AXES.index(axis)
        wrench[:, column], filled[:, column] = numbers(text.layout, chunk, axis)
    rows = filled.any(axis=1)
    corrected = wrench.copy()
    if rows.any():
        corrected[rows] = correct(stamps_ns(text.layout, chunk)[rows], wrench[rows])
    for axis in present:
        column, at = AXES.index(axis), text.layout.columns.index(axis)
        values, here = corrected[:, column].tolist(), filled[:, column].tolist()
        columns[at] = [
            repr(value) if has else cell
            for value, has, cell in zip(values, here, columns[at], strict=True)
        ]
    return columns


def rewrite_csv(
    source: Path, target: Path, correct: Correction, progress: Progress | None = None
) -> tuple[str, ...]:
    """
    Copy a CSV recording, its wrench columns corrected and everything else verbatim.

    Parameters
    ----------
    source : Path
        CSV recording.
    target : Path
        The file to make.
    correct : callable
        Called with consecutive pieces of the recording.
    progress : callable, optional
        Given the fraction done, 0 to 1.

    Returns
    -------
    tuple of str
        What was left out, in sentences.

    """
    text = CsvText(source)
    text.layout.require('raw wrench', AXES)
    with target.open('x', encoding='utf-8', newline='') as file:
        file.write(f'{text.header}\n')
        writer = csv.writer(file, delimiter=text.layout.delimiter, lineterminator='\n')
        for chunk, _ in sound_chunks(text, progress):
            columns = _correct_chunk(text, chunk, correct)
            writer.writerows(zip(*columns, strict=True))
    return tuple(text.warnings)


def rewrite_table(source: Path, target: Path, correct: Correction) -> tuple[str, ...]:
    """
    Copy a chamber table with its outputs corrected as force z, without columns left out.

    Parameters
    ----------
    source : Path
        Chamber table.
    target : Path
        The file to make.
    correct : callable
        Called once, with the table's nominal times.

    Returns
    -------
    tuple of str
        Which columns were left out, in sentences.

    """
    table = read_chamber_table(source)
    stamps = table.reading_stamps_ns.T.ravel()
    wrench = np.full((len(stamps), len(AXES)), np.nan)
    wrench[:, AXES.index('force_z')] = table.output.T.ravel()
    corrected = correct(stamps, wrench)[:, AXES.index('force_z')]
    steps = len(table.load)
    write_chamber_table(source, target, table.with_output(corrected.reshape(-1, steps).T))
    return tuple(reason for _, reason in table.left_out)


def _definition(connection: Connection) -> tuple[str, str]:
    """Find a topic's message definition and its hash, which older and bare bags lack."""
    kind, text = connection.msgtype, connection.msgdef.data
    digest = connection.digest
    if text and digest:
        return text, digest
    parsers = {
        MessageDefinitionFormat.MSG: lambda: get_types_from_msg(text, kind),
        MessageDefinitionFormat.IDL: lambda: get_types_from_idl(text),
    }
    store = get_typestore(Stores.ROS2_JAZZY)
    with suppress(Exception):  # a type that nobody can describe is copied without description
        if kind not in store.types:
            store.register(parsers[connection.msgdef.format]())
        digest = digest or store.hash_rihs01(kind)
        text = text or store.generate_msgdef(kind, ros_version=2)[0]
    return text, digest or f'RIHS01_{0:064}'


def _add_topic(writer: Writer, like: Connection, topic: str) -> Connection:
    """Add a topic with the type, definition and quality of service of another."""
    text, digest = _definition(like)
    extra = like.ext
    qos = extra.offered_qos_profiles if isinstance(extra, ConnectionExtRosbag2) else []
    return writer.add_connection(
        topic, like.msgtype, msgdef=text, rihs01=digest, offered_qos_profiles=qos
    )


def rewrite_bag(  # noqa: PLR0913, PLR0917 - the front door's settings, passed through
    bag: Bag,
    folder: Path,
    correct: Correction,
    topics: Topics,
    output_topic: str,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """
    Copy a bag with every message, and add the corrected wrench on a topic of its own.

    Parameters
    ----------
    bag : Bag
        An open bag.
    folder : Path
        The bag folder to make; storage and compression are those of the source.
    correct : callable
        Called with consecutive pieces of the raw wrench.
    topics : Topics
        Where the raw wrench is.
    output_topic : str
        Where the corrected one goes; recorded at the raw one's times.
    progress : callable, optional
        Given the fraction done, 0 to 1.

    Returns
    -------
    tuple of str
        What was lost, in sentences.

    """
    raw = {connection.id for connection in bag.find(topics.wrench, WRENCH_TYPE, 'raw wrench')}
    if any(c.topic.strip('/') == output_topic.strip('/') for c in bag.connections):
        raise RecordingError(
            f'{bag.name} holds {output_topic} already; name another topic for the output.'
        )
    total, seen = sum(connection.msgcount for connection in bag.connections), 0
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin[bag.storage.upper()])
    writer.set_compression(_COMPRESSION[bag.compression], CompressionFormat.ZSTD)
    with writer:
        copies = {c.id: _add_topic(writer, c, c.topic) for c in bag.connections}
        first = next(c for c in bag.connections if c.id in raw)
        output = _add_topic(writer, first, f'/{output_topic.strip("/")}')
        for batch in bag.batches(bag.connections):
            messages = [data for connection, _, data in batch if connection.id in raw]
            added = iter(_correct_messages(bag, first.topic, messages, correct))
            for connection, stamp, data in batch:
                writer.write(copies[connection.id], stamp, data)
                if connection.id in raw:
                    writer.write(output, stamp, next(added))
            seen += len(batch)
            if progress:
                progress(min(seen / total, 1.0))
    return bag.warnings


def _correct_messages(
    bag: Bag, topic: str, messages: list[bytes], correct: Correction
) -> Iterable[bytes]:
    """Correct raw messages of the wrench in bulk."""
    if not messages:
        return []
    stamps, wrench = unpack(bag, topic, messages, cdr.WRENCH_DOUBLES)
    return cdr.encode_many(messages, correct(stamps, wrench))
