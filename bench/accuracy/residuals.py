"""
Residual drift on recordings that the fit never saw, against what is usual today.

``python bench/accuracy/residuals.py [SEEDS]``, 6 by default. Per scenario and method: median and
worst residual over the seeds, in % of the uncompensated drift, both tared on the first minute and
averaged over 10 s. "the truth" is what noise leaves, of the tare above all, of a model that knows
the sensor. Then a real load cell.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

from judging import tared_rms
import numpy as np
from peers import BANKS, Day, described, fold, parts, Peer, PEERS, solved, STRENGTHS
from scenarios import drift, LEARNT_H, LOAD_CELL, load_cell, SCENARIOS, Z

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.signals import FloatArray, Recording
from wrist_ft_comp.stream.offline import simulate_drift

#: Predicts the drift of force z on a day that loads push, (N,), from other recordings.
Method = Callable[[Sequence[Recording], Recording], FloatArray]
TRUTH = 'the truth'


def by_package(method: str, recordings: Sequence[Recording], day: Recording) -> FloatArray:
    """Use one of the package's methods; a refusal leaves the sensor as it is."""
    identification = IdentificationSettings(method=method)  # type: ignore[arg-type] # a name
    settings = CalibrationSettings(reference='recorded', identification=identification)
    try:
        model = calibrate(recordings, settings).model
    except WristFtCompError:
        return np.zeros(len(day))
    zero, sensitivity = simulate_drift(model, day)
    return np.asarray(zero[:, Z] + sensitivity[:, Z] * day.reference[:, Z])


def by_peer(peer: Peer, recordings: Sequence[Recording], day: Recording) -> FloatArray:
    """Use a peer on whole cells; it knows zero drift only."""
    days = [
        Day(one.temperature_c, one.wrench - one.reference, np.zeros_like(one.wrench), one.period_s)
        for one in (*recordings, day)
    ]
    return peer(days[:-1], days[-1])[:, Z]


def ridge_bank(days: Sequence[Day], judged: Day) -> FloatArray:
    """Fit ridge on a bank; its strength leaves the least variance of days, or thirds, left out."""
    bank = BANKS[1]
    pieces = [fold(bank, piece, Z) for piece in parts(days)]
    variances = []
    for strength in STRENGTHS[2:]:
        variance = 0.0
        for out in pieces:
            gains = solved([piece for piece in pieces if piece is not out], strength)
            variance += float(np.var(out.drift - out.columns @ gains))
        variances.append(variance)
    strength = STRENGTHS[2:][int(np.argmin(variances))]
    result = np.zeros_like(judged.drift)
    gains = solved([fold(bank, day, Z) for day in days], strength)
    result[:, Z] = described(bank, judged)[0] @ gains
    return result


METHODS: dict[str, Method] = {
    'tare only': partial(by_peer, PEERS['nothing']),
    'straight line': partial(by_peer, PEERS['line']),
    'cubic': partial(by_peer, PEERS['cubic']),
    'PLS on lags': partial(by_peer, PEERS['PLS on lags']),
    'ridge bank': partial(by_peer, ridge_bank),
    'arx_pls': partial(by_package, 'arx_pls'),
    'auto': partial(by_package, 'auto'),
}


def residual(day: Recording, prediction: FloatArray) -> float:
    """Root mean square of what is left, tared on the first minute, in bins of 10 s."""
    return float(tared_rms((drift(day) - prediction)[:, np.newaxis])[0])


def print_table(seeds: range) -> None:
    """Print residuals by scenario and method, and how auto stands to the straight line."""
    print(f'residual drift, % of uncompensated: median (worst) of {len(seeds)} seeds')
    columns = (*METHODS, TRUTH)
    print(f'{"":22}' + ''.join(f'{name:>15}' for name in columns) + f'{"auto / line":>15}')
    for title, scenario in SCENARIOS.items():
        shares: dict[str, list[float]] = {name: [] for name in columns}
        for seed in seeds:
            training, test, truth = scenario(seed)
            before = residual(test, np.zeros(len(test)))
            for name, method in METHODS.items():
                shares[name].append(100 * residual(test, method(training, test)) / before)
            shares[TRUTH].append(100 * residual(test, truth) / before)
        ratios = np.array(shares['auto']) / np.array(shares['straight line'])
        cells = [f'{np.median(s):.2f} ({max(s):.2f})' for s in shares.values()]
        cells.append(f'{np.median(ratios):.2f} ({ratios.max():.2f})')
        print(f'{title:22}' + ''.join(f'{cell:>15}' for cell in cells), flush=True)


def print_load_cell() -> None:
    """Print the spread of the load cell's hours that were not fitted."""
    both = load_cell()
    if both is None:
        print(f'\nload cell: skipped, {LOAD_CELL.name} is not beside the project')
        return
    learnt, rest = both
    measured = np.isfinite(drift(rest))
    time_s = rest.elapsed_s[measured]
    print(f'\nload cell, learnt from {LEARNT_H:g} h, the other {rest.duration_s / 3600:.1f} h:')
    print(f'{"":15}{"spread, g":>12}{"around its creep, g":>22}{"creep, g/day":>15}')
    for name, method in METHODS.items():
        error = (drift(rest) - method([learnt], rest))[measured]
        creep = np.polynomial.Polynomial.fit(time_s, error, 1).convert()
        around = np.std(error - creep(time_s))
        print(f'{name:15}{np.std(error):12.1f}{around:22.1f}{86400 * creep.coef[1]:15.1f}')


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('seeds', nargs='?', type=int, default=6)
    seeds = range(parser.parse_args().seeds)
    print_table(seeds)
    print_load_cell()


if __name__ == '__main__':
    main()
