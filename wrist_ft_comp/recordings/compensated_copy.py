"""A recording copied with its wrench corrected."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import OutputError
from wrist_ft_comp.recording import Correction, Topics
from wrist_ft_comp.recordings.bag import decode
from wrist_ft_comp.recordings.column_map import COMPENSATED
from wrist_ft_comp.recordings.read import backend, open_recording, OpenBag, OpenTable
from wrist_ft_comp.recordings.table import STAMP_NS
from wrist_ft_comp.series import Progress
from wrist_ft_comp.stored.recording_writer import ORIGIN
from wrist_ft_comp.stored.safe_file import Output, writing
from wrist_ft_comp.wire import cdr

#: Topic of the corrected wrench in the copy of a bag.
OUTPUT = '/wrench_without_drift'


def rewrite_recording(
    source: Path | str,
    target: Path | str,
    correct: Correction,
    *,
    topics: Topics | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """
    Copy a recording with its wrench corrected; says what was left out.

    A table becomes a CSV recording with this package's columns and units; a bag stays a bag and
    gets the corrected wrench on a topic of its own, OUTPUT. The target must not exist;
    for a bag it is a folder, not compressed. ``correct`` gets consecutive pieces, NaN for absent
    axes, which it leaves NaN. RecordingError when the source cannot be read or the target cannot
    be made; a failure leaves nothing behind.
    """
    source, target, topics = Path(source), Path(target), topics or Topics()
    copy = check_copy(source, topics, target)
    with (
        writing(target),
        TemporaryDirectory(prefix=f'.{target.name}.', dir=target.parent) as folder,
        open_recording(source, topics) as opened,
    ):
        made = Path(folder) / target.name
        if isinstance(opened, OpenTable):
            _write_table(opened, made, correct, progress)
        else:
            _write_bag(opened, made, correct, progress)
        copy.check_target(target)
        made.rename(target)
        return opened.warnings


def check_copy(source: Path, topics: Topics, target: Path, others: Sequence[Path] = ()) -> Output:
    """Refuse a target of a copy, or a copy of a copy, before anything is read."""
    copy = Output(name='copy', endings='.csv')
    with open_recording(source, topics) as opened:
        if isinstance(opened, OpenBag):
            copy = Output(name='copy of a bag (a folder)', endings='nothing')
            if opened.bag.named(OUTPUT):
                raise OutputError(f'{opened.name} holds {OUTPUT} already. Name the raw recording.')
    copy.check_target(target, [source, *others])
    return copy


def _write_bag(
    source: OpenBag, target: Path, correct: Correction, progress: Progress | None
) -> None:
    """Copy every message into the same storage; add wrenches at the times of the raw one."""
    bag = source.bag
    wrenches = bag.find(source.options.topics.wrench, cdr.WRENCH, 'raw wrench')
    numbers = {wrench.id for wrench in wrenches}
    with backend().write_bag(target, bag.storage) as (add, write):
        copies = {c.id: add(c, c.topic, c.msgtype) for c in bag.connections}
        added = add(wrenches[0], OUTPUT, cdr.WRENCH)
        for batch in bag.batches(bag.connections, progress):
            of_wrench = [(ns, data) for connection, ns, data in batch if connection.id in numbers]
            messages = [data for _, data in of_wrench]
            stamps_ns, raw = decode(bag, wrenches[0], messages)
            arrived_ns = np.array([ns for ns, _ in of_wrench], np.int64)
            # Without a stamp, it drifted as when it came, not as in 1970.
            wrench = correct(np.where(stamps_ns, stamps_ns, arrived_ns), raw)
            corrected = iter(cdr.encode_many(messages, wrench))
            for connection, time_ns, data in batch:
                write(copies[connection.id], time_ns, data)
                if connection.id in numbers:
                    write(added, time_ns, next(corrected))


def _write_table(
    source: OpenTable, target: Path, correct: Correction, progress: Progress | None
) -> None:
    """Write our own columns; an empty one says that they are compensated."""
    import pandas  # noqa: PLC0415 -- a bag is copied without it

    source.require('stamp', 'raw wrench')
    channels = [column.channel for placed in source.columns for column in placed.channels]
    empty = [*(name for name in source.names if name.startswith(ORIGIN)), COMPENSATED]
    for number, rows in enumerate(source.rows(progress)):
        # Of tables that are joined, each fills its own columns.
        frame = rows.reindex(columns=[STAMP_NS, *channels, *empty])
        raw = frame.reindex(columns=AXES).to_numpy(float)
        wrench = correct(frame[STAMP_NS].to_numpy(), raw)
        for axis in {*AXES} & {*channels}:
            frame[axis] = wrench[:, AXES.index(axis)]
        frame.to_csv(target, mode='a', index=False, header=not number, lineterminator='\n')
    if len(source.tables) > 1:
        frame = pandas.read_csv(target, float_precision='round_trip', dtype={STAMP_NS: np.int64})
        frame.sort_values(STAMP_NS, kind='stable').to_csv(target, index=False)
