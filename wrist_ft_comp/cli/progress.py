"""How far a command is, on standard error where that is a terminal."""

from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

from wrist_ft_comp.series import Progress


@contextmanager
def progress_bar(what: str) -> Iterator[Progress]:
    """Show a bar, which is wiped away in the end; yields what is told the share that is done."""
    form = '{desc} {percentage:3.0f}%|{bar}| {elapsed}'
    with tqdm(total=1.0, desc=what, disable=None, leave=False, bar_format=form) as bar:

        def report(share: float) -> None:
            bar.update(max(share - bar.n, 0.0))

        yield report
