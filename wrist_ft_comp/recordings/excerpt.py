"""A part of a recording: from, until, and without some stretches, in seconds since it began."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
import math
import re

import numpy as np

from wrist_ft_comp.channels import AXES
from wrist_ft_comp.errors import SettingsError
from wrist_ft_comp.recording import Samples
from wrist_ft_comp.series import CLOCK_NS, NANOSECONDS
from wrist_ft_comp.stream.clock import NO_TIME

_UNITS_S = {'': 1.0, 's': 1.0, 'min': 60.0, 'h': 3600.0}


@dataclass(frozen=True)
class Excerpt:
    """What of a recording counts."""

    #: Seconds since the first stamp of the file.
    begin_s: float = 0.0
    end_s: float = math.inf
    #: Beginning and end of stretches whose wrenches are left out; temperatures go on.
    excluded_s: tuple[tuple[float, float], ...] = ()

    def select(self, blocks: Iterable[Samples], name: str) -> Iterator[Samples]:
        """Leave out what does not count of a recording; SettingsError where nothing is left."""
        first_ns, lasts_s = None, 0.0
        came: set[str] = set()
        left: set[str] = set()
        for block in blocks:
            timed = block.stamps_ns != NO_TIME  # the first messages may have no stamp yet
            if first_ns is None and timed.any():
                first_ns = int(block.stamps_ns[timed][0])
            since_s = np.where(timed, block.stamps_ns - (first_ns or 0), 0) / NANOSECONDS
            kind = 'wrench' if set(block.channels) & set(AXES) else block.channels[0].split('_')[0]
            counts = (since_s >= self.begin_s) & (since_s <= self.end_s)
            for begin_s, end_s in self.excluded_s if kind == 'wrench' else ():
                counts &= (since_s < begin_s) | (since_s > end_s)
            lasts_s = max(lasts_s, float(since_s.max(initial=0.0)))
            came |= {kind} if timed.any() else set()
            left |= {kind} if counts.any() else set()
            yield Samples(block.channels, block.stamps_ns[counts], block.values[counts])
        if first_ns is None:
            return
        lasts = f'{name}, which {_beginning(first_ns)}lasts {lasts_s:.0f} s'
        if not left:
            raise SettingsError(
                f'Nothing is left of {lasts}: what counts begins at {self.begin_s:.0f} s. Give an '
                'earlier --from.'
            )
        if gone := {'wrench', 'temperature'} & (came - left):
            raise SettingsError(
                f'Every {min(gone)} of {lasts}, is left out by --from, --until and --exclude. '
                'Leave some in.'
            )


def _beginning(first_ns: int) -> str:
    """Say when a recording begins, where its stamps are of a clock."""
    if first_ns < CLOCK_NS:
        return ''
    return f'begins at {np.datetime64(first_ns // NANOSECONDS, "s")} UTC and '.replace('T', ' ', 1)


def parse_excerpt(begin: str, end: str, exclude: Iterable[str]) -> Excerpt:
    """Understand ``--from``, ``--until`` and ``--exclude``, or refuse them by a SettingsError."""
    stretches = []
    for text in exclude:
        first, dots, last = text.partition('..')
        if not dots:
            raise SettingsError(
                f'A stretch is A..B, such as 4790..4830 or 79min..81min; got {text!r}.'
            )
        stretches.append((_seconds(first), _seconds(last)))
    excerpt = Excerpt(_seconds(begin or '0'), _seconds(end or 'inf'), tuple(stretches))
    for begin_s, end_s in (*excerpt.excluded_s, (excerpt.begin_s, excerpt.end_s)):
        if not begin_s < end_s:
            raise SettingsError(
                f'A part must end after it begins; got {begin_s:g} to {end_s:g} s.'
            )
    return excerpt


def _seconds(text: str) -> float:
    """Read a time since the beginning: 4800, 80min, 1.5h or 1:20:00."""
    if match := re.fullmatch(r'(inf|\d+\.?\d*|\.\d+)(s|min|h|)', text.strip()):
        return float(match[1]) * _UNITS_S[match[2]]
    if re.fullmatch(r'\d+(:\d\d){1,2}(\.\d+)?', text.strip()):
        hours, minutes, seconds = (*map(float, text.strip().split(':')), 0.0)[:3]
        return 3600 * hours + 60 * minutes + seconds
    raise SettingsError(f'A time is written 4800, 80min, 1.5h or 1:20:00; got {text!r}.')
