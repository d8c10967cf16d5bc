"""A recording of any kind read onto the thermal grid."""

from collections.abc import Iterator
from dataclasses import replace
import hashlib
from pathlib import Path

from wrist_ft_comp.drift.drift_model import order_problem
from wrist_ft_comp.errors import RecordingError
from wrist_ft_comp.recording import Recording, Samples, Topics
from wrist_ft_comp.recordings.bag import SUFFIXES
from wrist_ft_comp.recordings.open_recording import open_recording, OpenTable
from wrist_ft_comp.recordings.read_options import Excerpt
from wrist_ft_comp.series import Progress
from wrist_ft_comp.stream.batch_grid import grid_samples
from wrist_ft_comp.stream.clock import NO_TIME

#: Bytes of a file that are hashed at once.
_HASHED_AT_ONCE = 1 << 20


def read_recording(
    path: Path | str,
    *,
    period_s: float = 1.0,
    topics: Topics | None = None,
    max_bad_share: float = 0.01,
    progress: Progress | None = None,
) -> Recording:
    """
    Read a recording of any kind onto thermal cells of ``period_s``.

    Memory grows with the number of cells only. Topics of a bag are the node's own names by
    default. The recording's warnings say what was left out. RecordingError when it cannot be read,
    when more than ``max_bad_share`` of a channel cannot be used, or when a channel is missing.
    """
    topics = topics or Topics()
    origin_ns: int | None = None
    with open_recording(Path(path), topics) as source:
        if isinstance(source, OpenTable):
            source.require()

        def blocks() -> Iterator[Samples]:
            """Read, and note the first stamp of all, from which times count."""
            nonlocal origin_ns
            for block in source.samples(progress):
                timed = block.stamps_ns[block.stamps_ns != NO_TIME]
                if origin_ns is None and len(timed):
                    origin_ns = int(timed[0])
                yield block

        excerpt = source.options.excerpt
        recording = grid_samples(
            blocks() if excerpt == Excerpt() else excerpt.select(blocks(), source.name),
            name=source.name,
            period_s=period_s,
            max_bad_share=max_bad_share,
            temperatures=source.sources,
        )
        sensor = source.sensor
        if problem := order_problem({'temperature_topics': topics.temperatures}, sensor):
            raise RecordingError(f'{source.name} has its thermometers in another order: {problem}')
        warnings = *source.warnings, *recording.warnings
        return replace(recording, warnings=warnings, sensor=sensor, origin_ns=origin_ns)


def hash_recording(path: Path) -> str:
    """
    Hash a file's bytes, or those of a bag's storage files in order: SHA-256, hexadecimal.

    What else lies in the folder may change: metadata.yaml, notes, a database's journal.
    """
    digest, files = hashlib.sha256(), [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if {*SUFFIXES} & {*file.suffixes})
    for file in filter(Path.is_file, files):
        with file.open('rb') as content:
            while part := content.read(_HASHED_AT_ONCE):
                digest.update(part)
    return digest.hexdigest()
