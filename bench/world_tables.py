"""Statistics of what is left, as tables and as a picture."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrist_ft_comp.signals import FloatArray

#: Statistics over axes, NaN left out.
STATISTICS: dict[str, Callable[[FloatArray], float]] = {
    'median': lambda shares: float(np.nanmedian(shares)),
    'mean': lambda shares: float(np.nanmean(shares)),
    '95 %': lambda shares: float(np.nanquantile(shares, 0.95)),
    'worst': lambda shares: float(np.nanmax(shares)),
}
_DRAWS = 1000


@dataclass(frozen=True, eq=False)
class Result:
    """
    What a method left in the worlds of a family.

    Attributes
    ----------
    left : ndarray, shape (worlds, 6)
        Of the drift of each axis; NaN where there was none.
    kept : ndarray, shape (worlds, 6)
        What was left by what had been claimed; NaN without a claim.
    seconds : ndarray, shape (worlds,)
        Time it took.

    """

    left: FloatArray
    kept: FloatArray
    seconds: FloatArray


def intervals(
    statistic: Callable[[FloatArray], float], *shares: FloatArray
) -> tuple[float, float]:
    """Draw worlds again and again: 95 % of a statistic, or of its ratio between two methods."""
    rng = np.random.default_rng(0)
    worlds = len(shares[0])
    drawn = []
    for _ in range(_DRAWS):
        rows = rng.integers(worlds, size=worlds)
        values = [statistic(each[rows]) for each in shares]
        drawn.append(values[0] / values[1] if len(values) > 1 else values[0])
    low, high = np.quantile(drawn, (0.025, 0.975))
    return float(low), float(high)


def print_family(
    title: str, results: Mapping[str, Result], peer: str, ours: Sequence[str]
) -> None:
    """Print one family: every method, and how ours stand to the family's best peer."""
    worlds = len(next(iter(results.values())).left)
    print(f'\n{title}: drift left in {worlds} worlds, as a share of the uncompensated')
    print(f'{"":16}{"median":>21}{"mean":>21}{"95 %":>21}{"worst":>8}{"s":>7}')
    for name, result in results.items():
        cells = ''
        for key in ('median', 'mean', '95 %'):
            low, high = intervals(STATISTICS[key], result.left)
            cells += f'{STATISTICS[key](result.left):7.3f} ({low:.3f}–{high:.3f})'.rjust(21)
        cells += f'{STATISTICS["worst"](result.left):8.2f}{np.median(result.seconds):7.1f}'
        print(f'{name:16}{cells}')
    for name in ours:
        if name in results and peer in results:
            print(f'{name} by {peer}: ' + ratios(results[name].left, results[peer].left))
        if name in results and np.isfinite(results[name].kept).any():
            print(f'{name}, left by claimed: ' + claims(results[name].kept))


def ratios(ours: FloatArray, peers: FloatArray) -> str:
    """Say how the statistics stand to a peer's."""
    words = []
    for key in ('median', 'mean', '95 %'):
        low, high = intervals(STATISTICS[key], ours, peers)
        ratio = STATISTICS[key](ours) / STATISTICS[key](peers)
        words.append(f'{key} {ratio:.2f} ({low:.2f}–{high:.2f})')
    return ', '.join(words)


def claims(kept: FloatArray) -> str:
    """Say how much more is left than was claimed."""
    there = kept[np.isfinite(kept)]
    return f'median {np.median(there):.2f}, below 2: {np.mean(there < 2):.0%}'


def pooled(families: Sequence[Mapping[str, Result]]) -> dict[str, Result]:
    """Put the worlds of several families together."""
    return {
        name: Result(
            np.concatenate([each[name].left for each in families]),
            np.concatenate([each[name].kept for each in families]),
            np.concatenate([each[name].seconds for each in families]),
        )
        for name in families[0]
    }


def draw(families: Mapping[str, Mapping[str, Result]], target: Path) -> None:
    """Draw the share of axes below a drift left, one panel per family."""
    import matplotlib as mpl  # noqa: PLC0415 -- needed for a picture only

    mpl.use('Agg')
    import matplotlib.pyplot as plt  # noqa: PLC0415

    rows = -(-len(families) // 3)
    figure, axes = plt.subplots(rows, 3, figsize=(15, 4 * rows), squeeze=False, sharex=True)
    for panel in axes.flat[len(families) :]:
        panel.axis('off')
    for panel, (title, results) in zip(axes.flat, families.items(), strict=False):
        for name, result in results.items():
            shares = np.sort(result.left[np.isfinite(result.left)])
            part = np.arange(1, len(shares) + 1) / len(shares)
            width = 2.5 if name.startswith('auto') else 1.0
            panel.step(np.maximum(shares, 1e-3), part, where='post', label=name, linewidth=width)
        panel.set(xscale='log', title=title, ylabel='share of axes', xlabel='drift left / raw')
        panel.grid(alpha=0.3)
    axes.flat[0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(target, dpi=110)
