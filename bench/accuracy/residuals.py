"""
Residual drift on recordings that the fit never saw, against what is usual today.

``python bench/accuracy/residuals.py [SEEDS]``, 6 by default. Per scenario and method: median and
worst residual over the seeds, in % of the uncompensated drift, both tared on the first minute and
averaged over 10 s. "the truth" is what noise leaves, of the tare above all, of a model that knows
the sensor. Then a real load cell.

Last, contacts on a sensor that drifts, and what people do about it today. The heat-conducting
wrist works for 2.5 h with duty cycles that no method has seen. Every ten minutes it touches
something for 60 s with 20 N along z; in the last hour it holds 20 N all the time. Learning methods
were given four other, unloaded days. The error is measured minus true force, in N.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial

from judging import block_means, tared_rms
import numpy as np
from peers import BANKS, Day, described, fold, parts, Peer, PEERS, solved, STRENGTHS
from scenarios import drift, LEARNT_H, LOAD_CELL, load_cell, SCENARIOS, wrist, Z
from scipy.signal import butter, lfilter

from wrist_ft_comp.errors import WristFtCompError
from wrist_ft_comp.fit.calibrate import calibrate
from wrist_ft_comp.fit.settings import CalibrationSettings, IdentificationSettings
from wrist_ft_comp.signals import FloatArray, Recording
from wrist_ft_comp.stream.offline import simulate_drift

#: Predicts the drift of force z on a day that loads push, (N,), from other recordings.
Method = Callable[[Sequence[Recording], Recording], FloatArray]
TRUTH = 'the truth'

CONTACT_N = 20.0
#: When a short contact begins, and how long it lasts, s.
STARTS_S = tuple(range(600, 5400, 600))
CONTACT_S = 60
#: When the long contact begins and ends, s.
HOLD_S = (5400, 9000)
#: A sensor is zeroed on this time before a contact, s.
REZERO_S = 5
#: Which run of the wrist is judged; the first four are learnt from.
JUDGED_RUN = 99
#: Estimates the true force of a day, shape (N,), from its readings and other days.
Practice = Callable[[Sequence[Recording], Recording], FloatArray]


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


def median_worst(values: Sequence[float] | FloatArray) -> str:
    """Write the median and the worst of all seeds."""
    return f'{np.median(values):.2f} ({np.max(values):.2f})'


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
        cells = map(median_worst, (*shares.values(), ratios))
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


def contacts() -> FloatArray:
    """Draw the contact force, N, shape (N,)."""
    force: FloatArray = np.zeros(HOLD_S[1])
    for start in STARTS_S:
        force[start : start + CONTACT_S] = CONTACT_N
    force[slice(*HOLD_S)] = CONTACT_N
    return force


def zeroed(force: FloatArray) -> FloatArray:
    """Zero on the first minute."""
    return np.asarray(force - force[:60].mean())


def zero_once(_: Sequence[Recording], day: Recording) -> FloatArray:
    """Zero at the start of the day only."""
    return zeroed(day.wrench[:, Z])


def rezero(_: Sequence[Recording], day: Recording) -> FloatArray:
    """Zero on the last seconds before every contact, as sensor vendors advise."""
    force = zeroed(day.wrench[:, Z])
    for start in (*STARTS_S, HOLD_S[0]):
        force[start:] -= force[start - REZERO_S : start].mean()
    return force


def high_pass(cut_off_hz: float, _: Sequence[Recording], day: Recording) -> FloatArray:
    """Pass the force through a first-order high-pass."""
    b, a = butter(1, cut_off_hz, 'highpass', fs=1.0)
    return np.asarray(lfilter(b, a, zeroed(day.wrench[:, Z])))


def cubic(training: Sequence[Recording], day: Recording) -> FloatArray:
    """Subtract a cubic polynomial of the thermometer in the sensor."""
    return zeroed(day.wrench[:, Z] - by_peer(PEERS['cubic'], training, day))


def ours(training: Sequence[Recording], day: Recording) -> FloatArray:
    """Calibrate with this package, by default settings."""
    zero, sensitivity = simulate_drift(calibrate(training).model, day)
    return zeroed((day.wrench[:, Z] - zero[:, Z]) / (1.0 + sensitivity[:, Z]))


PRACTICES: dict[str, Practice] = {
    'zeroed once': zero_once,
    'zeroed before every contact': rezero,
    'high-pass, 0.01 Hz': partial(high_pass, 0.01),
    'high-pass, 0.001 Hz': partial(high_pass, 0.001),
    'high-pass, 0.0001 Hz': partial(high_pass, 0.0001),
    'cubic polynomial': cubic,
    'this package': ours,
}


def contact_errors(estimate: FloatArray, day: Recording) -> list[float]:
    """Measure RMS in short contacts, RMS in between, and the worst of the long one, N."""
    error = estimate - day.reference[:, Z]
    touching, hold = contacts() > 0, slice(*HOLD_S)
    short = touching & (np.arange(len(error)) < HOLD_S[0])
    # Means of 10 s, because noise is no drift.
    in_contact, free, held = (
        block_means(error[rows, np.newaxis], 10) for rows in (short, ~touching, hold)
    )
    rms = [float(np.sqrt(np.mean(means**2))) for means in (in_contact, free)]
    return [*rms, float(np.max(np.abs(held)))]


def print_contacts(seeds: range) -> None:
    """Print the errors of practices during contacts."""
    found: dict[str, list[list[float]]] = {name: [] for name in PRACTICES}
    for seed in seeds:
        training = [wrist(seed, run, 2) for run in range(4)]
        test = wrist(seed, JUDGED_RUN, 2, contact_n=contacts())
        for name, practice in PRACTICES.items():
            found[name].append(contact_errors(practice(training, test), test))
    print(f'\nerror of force z, contacts of {CONTACT_N:g} N, N: median (worst)')
    titles = ('60 s contacts, RMS', 'free, RMS', '1 h contact, worst')
    print(f'{"":28}' + ''.join(f'{title:>20}' for title in titles))
    for name, rows in found.items():
        print(
            f'{name:28}'
            + ''.join(f'{median_worst(of_kind):>20}' for of_kind in zip(*rows, strict=True))
        )


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('seeds', nargs='?', type=int, default=6)
    seeds = range(parser.parse_args().seeds)
    print_table(seeds)
    print_load_cell()
    print_contacts(seeds)


if __name__ == '__main__':
    main()
