"""
Thermometers that die or freeze: replaced by what the others predict of them.

Bins of a minute are judged. A thermometer that is silent, or stands still while its prediction
moves, is surely wrong. Its prediction replaces it from the bin in which that began, and the model
goes on with all of its thermometers. Where thermometers contradict each other, because one came
loose or two were exchanged, it is not sure which of them is wrong: this is only reported.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from wrist_ft_comp.drift.drift_model import Drift, DriftModel, start, step
from wrist_ft_comp.drift.prediction import AVERAGED_BINS, bin_cells, EARLIER_BINS
from wrist_ft_comp.signals import AXES, BoolArray, differ, FloatArray, IntArray, NANOSECONDS

#: Bins that are kept: a thermometer is replaced for at most this long back.
_MOST_BINS = 360
#: A thermometer that has agreed for this many bins is believed again.
_AGREED_BINS = 30
#: A thermometer agrees again where its error is below this share of its limit.
_AGREES_SHARE = 0.4
#: A thermometer that is believed again is approached with this time constant, s.
_APPROACH_S = 300.0
#: What is left of that is dropped below this, K.
_APPROACHED_K = 1e-3
#: Bins in a row without another mean before a thermometer counts as standing still.
_STILL_BINS = 3
#: Lost thermometers are predicted from each other up to this gain of the loop. With two of three
#: or four dead in twelve drawn worlds, predictions ran away at gains of 1.00 and more, and were of
#: use at 0.94 and less.
_LARGEST_LOOP_GAIN = 0.95
#: Outside the calibrated range predictions are extrapolated. A limit of errors grows by this many
#: times itself for every calibrated range that a thermometer is beyond it.
_GROWTH_BEYOND = 3.0


class Rewrite(NamedTuple):
    """What replaces the readings of a thermometer in the newest n cells, °C, (n,)."""

    thermometer: int
    predicted_c: FloatArray

    def apply(self, temperature_c: FloatArray, heard: BoolArray) -> None:
        """Write over the end of temperatures, (N, J), and count them as heard; n may exceed N."""
        count = min(len(self.predicted_c), len(temperature_c))
        newest = slice(len(temperature_c) - count, None), self.thermometer
        temperature_c[newest] = self.predicted_c[len(self.predicted_c) - count :]
        heard[newest] = True


class _Bins(NamedTuple):
    """Bins that were run through, shapes (n, J), and the relaxed temperatures behind, (K, J)."""

    believed_c: FloatArray
    predicted_c: FloatArray
    relaxed_c: FloatArray
    #: What the last bin was predicted from, (J,).
    entered_c: FloatArray


class Agreement:
    """Judges J thermometers by their predictions; without predictions it believes all."""

    def __init__(self, model: DriftModel | None, thermometers: int) -> None:
        period_ns = NANOSECONDS if model is None else model.period_ns
        self._axis = None if model is None else next(iter(model.axes.values()), None)
        self._prediction = None if model is None or self._axis is None else model.prediction
        #: Cells of a bin, and its length, s.
        self.cells = bin_cells(period_ns)
        self._bin_s = self.cells * period_ns / NANOSECONDS
        #: Why thermometers, counted from 0, are replaced by their predictions.
        self.replaced: dict[int, str] = {}
        #: Which thermometers contradict each other; empty where none do.
        self.doubt = ''
        self._thermometers, self._judging = thermometers, True
        #: For how many bins each that is replaced has agreed.
        self._agreeing: IntArray = np.zeros(thermometers, np.int64)
        #: What is still added to a thermometer that is believed again, K.
        self._approach_k: FloatArray = np.zeros(thermometers)
        self.forget()

    def forget(self) -> None:
        """Begin with no bins."""
        self._sums, self._counts = np.zeros((2, self._thermometers))
        self._filled = self._unheard = 0
        #: Means of the heard cells of bins, NaN where there are none, shape (n, J).
        self._readings: FloatArray = np.zeros((0, self._thermometers))
        #: Whose readings are believed, shape (n, J).
        self._trusted: BoolArray = np.zeros((0, self._thermometers), dtype=bool)
        #: Predicted from the thermometers that are believed, and from all that report.
        self._bins = self._together = _Bins(*(self._readings,) * 2, *np.zeros((2, 0, 0)))
        #: Average error before it jumped, K; NaN where it did not.
        self._before_jump_k: FloatArray = np.full(self._thermometers, np.nan)

    @property
    def able(self) -> bool:
        """Whether thermometers can be compared."""
        return self._prediction is not None

    @property
    def room(self) -> int:
        """Count the cells that are missing in the present bin."""
        return self.cells - self._filled

    def add(
        self, temperature_c: FloatArray, heard: BoolArray
    ) -> tuple[FloatArray, Rewrite | None]:
        """
        Take cells, (n, J), n <= ``room``: give what is believed of them, and what has changed.

        With the last cell of a bin the thermometers are judged; a rewrite includes this cell.
        """
        if not self.able:
            return temperature_c, None
        if self._unheard > 1 and heard.any():  # the body has soaked, as at a start
            self.forget()
        believed_c = self._believe(temperature_c)
        self._sums += np.where(heard, temperature_c, 0.0).sum(axis=0)
        self._counts += heard.sum(axis=0)
        self._filled += len(temperature_c)
        return believed_c, self._close() if self._filled == self.cells else None

    def replay(self, temperature_c: FloatArray, heard: BoolArray) -> None:
        """Take cells of the past, (N, J), without judging them."""
        self._judging = False
        begin = 0
        while begin < len(temperature_c):
            part = slice(begin, begin + self.room)
            self.add(temperature_c[part], heard[part])
            begin = part.stop
        self._judging = True

    def _believe(self, readings_c: FloatArray) -> FloatArray:
        """Replace thermometers by the straight line through their last two predictions."""
        cells = np.arange(len(readings_c))[:, np.newaxis]
        believed_c = readings_c + 0.0
        if self._approach_k.any():
            pole = np.exp(-self._bin_s / self.cells / _APPROACH_S)
            believed_c += self._approach_k * pole ** (cells + 1)
            self._approach_k = self._approach_k * pole ** len(cells)
            self._approach_k[np.abs(self._approach_k) < _APPROACHED_K] = 0.0
        if self.replaced:
            columns, predicted_c = list(self.replaced), self._bins.predicted_c[-2:]
            if not len(predicted_c):
                trusted = np.ones((1, self._thermometers), dtype=bool)
                trusted[:, columns] = False
                predicted_c = self._run(readings_c[:1], trusted, None).predicted_c
            slope = (predicted_c[-1] - predicted_c[0]) / self.cells
            ahead = self._filled + cells + (1 + self.cells) / 2
            believed_c[:, columns] = (predicted_c[-1] + slope * ahead)[:, columns]
        return believed_c

    def _close(self) -> Rewrite | None:
        """End a bin, and judge."""
        heard = self._counts > 0
        if not self._judging:  # what is kept of those that are replaced are predictions
            heard[list(self.replaced)] = False
        reading_c = np.where(heard, self._sums / np.maximum(self._counts, 1), np.nan)
        self._sums, self._counts = np.zeros((2, len(heard)))
        self._filled = 0
        if not heard.any():
            self._unheard += 1
            return None
        self._unheard = 0
        trusted = heard.copy()
        trusted[list(self.replaced)] = False
        last = slice(-_MOST_BINS + 1, None)
        self._readings = np.concatenate((self._readings[last], reading_c[np.newaxis]))
        self._trusted = np.concatenate((self._trusted[last], trusted[np.newaxis]))
        self._bins = self._go_on(self._bins, trusted)
        if self.replaced:
            reporting = np.array([self._reports(j) for j in range(self._thermometers)])
            self._together = self._go_on(self._together, trusted | reporting)
        else:
            self._together = self._bins
        return self._judge(heard) if self._judging else None

    def _go_on(self, before: _Bins, trusted: BoolArray) -> _Bins:
        """Run on through the newest bin, in which some are trusted, (J,)."""
        new, last = self._run(self._readings[-1:], trusted[np.newaxis], before), -_MOST_BINS + 1
        believed_c = np.concatenate((before.believed_c[last:], new.believed_c))
        predicted_c = np.concatenate((before.predicted_c[last:], new.predicted_c))
        return new._replace(believed_c=believed_c, predicted_c=predicted_c)

    def _run(self, readings_c: FloatArray, trusted: BoolArray, before: _Bins | None) -> _Bins:
        """Run through bins, (n, J), from rest, or on from other bins; prediction is belief."""
        assert self._prediction is not None  # noqa: S101 -- looked at by ``able``
        believed, predicted = np.empty_like(readings_c), np.empty_like(readings_c)
        if before is None or not len(before.predicted_c):
            bin_c = np.where(trusted[0], readings_c[0], np.nanmean(readings_c[0]))
            relaxed_c = guess_c = bin_c
        else:
            guess_c, relaxed_c, bin_c = before.predicted_c[-1], before.relaxed_c, before.entered_c
        for k, (reading_c, true) in enumerate(zip(readings_c, trusted, strict=True)):
            runs_away = self._runs_away(~true)
            if runs_away:  # they move along with the others
                moved_k = np.where(true, reading_c - bin_c, 0.0).sum() / max(true.sum(), 1)
                guess_c = bin_c + moved_k
            # What is replaced depends on the others of this bin: two rounds.
            for _ in range(1 if true.all() or runs_away else 2):
                bin_c = np.where(true, reading_c, guess_c)
                after_c = self._prediction.relax(relaxed_c, bin_c, self._bin_s)
                guess_c = self._bounded(self._prediction.predict(after_c))
            believed[k], predicted[k] = np.where(true, reading_c, guess_c), guess_c
            relaxed_c = after_c
        return _Bins(believed, predicted, relaxed_c, bin_c)

    def _runs_away(self, lost: BoolArray) -> bool:
        """Whether the lost of J thermometers, (J,), run away when predicted from each other."""
        assert self._prediction is not None  # noqa: S101 -- looked at by ``able``
        if np.count_nonzero(lost) < 2:
            return False
        gains = self._prediction.gains.sum(axis=1)[np.ix_(lost, lost)]
        return bool(np.abs(np.linalg.eigvals(gains)).max() > _LARGEST_LOOP_GAIN)

    def _bounded(self, temperature_c: FloatArray) -> FloatArray:
        """Keep predictions within a calibrated range of the calibrated range."""
        assert self._axis is not None  # noqa: S101 -- looked at by ``able``
        low_c, high_c = self._axis.lower_c, self._axis.upper_c
        span_k = high_c - low_c
        above_c = np.maximum(temperature_c, low_c - span_k)
        return np.asarray(np.minimum(above_c, high_c + span_k))

    def _errors(self, bins: _Bins) -> tuple[FloatArray, FloatArray]:
        """Average the newest errors, and those before them, K, (J,); NaN where not heard."""
        error_k = self._readings - bins.predicted_c
        before = slice(-AVERAGED_BINS - EARLIER_BINS, -AVERAGED_BINS)
        return _mean(error_k[-AVERAGED_BINS:]), _mean(error_k[before])

    def _judge(self, heard: BoolArray) -> Rewrite | None:
        """Find thermometers that are wrong, and those that are to be believed again."""
        prediction = self._prediction
        assert prediction is not None and self._axis is not None  # noqa: S101, PT018 -- ``able``
        growth = 1.0 + _GROWTH_BEYOND * self._axis.beyond_range(self._bins.believed_c[-1])
        self._believe_again(growth * prediction.limit_k)
        error_k, before_k = self._errors(self._bins)
        share = np.abs(error_k) / (growth * prediction.limit_k)
        others = [j for j in np.flatnonzero(heard).tolist() if j not in self.replaced]
        for j in range(len(heard)):
            if j in self.replaced or not set(others) - {j}:
                continue
            silent, still = self._quiet(j)
            moved_k = float(np.ptp(self._bins.predicted_c[-still - 1 :, j]))
            frozen = still >= _STILL_BINS and moved_k > prediction.still_k[j]
            if frozen or silent * self._bin_s > prediction.silence_s[j]:
                why = (
                    f'stands still at {self._readings[-1, j]:.1f} °C while the others show that '
                    f'it moved by {moved_k:.1f} K'
                )
                return self._replace(j, still + 1, 'is silent' if silent else why)
        if len(self._readings) < AVERAGED_BINS + EARLIER_BINS:
            return None
        steady = np.isnan(self._before_jump_k)
        before_k = np.where(steady, before_k, self._before_jump_k)
        jump_k = np.where(steady, growth, growth * _AGREES_SHARE) * prediction.jump_k
        jumped = np.abs(error_k - before_k) > jump_k
        self._before_jump_k = np.where(jumped, before_k, np.nan)
        alarmed = np.flatnonzero((share > 1) | jumped).tolist()
        self.doubt = ''
        if set(alarmed) & set(others) and len(self.replaced) < 2:
            self.doubt = (
                f'thermometers {numbered(alarmed)} contradict what all showed when the model was '
                'learnt: one is loose, or two are exchanged'
            )
        return None

    def _quiet(self, j: int) -> tuple[int, int]:
        """Count the bins since a thermometer was heard, and since it read the same as before."""
        column, last = self._readings[:, j], len(self._readings) - 1
        heard = np.flatnonzero(np.isfinite(column))
        if not len(heard):
            return last + 1, last
        other = np.flatnonzero(differ(column[heard], column[heard[-1]]))
        return last - int(heard[-1]), last - int(heard[other.max(initial=-1) + 1])

    def _reports(self, j: int) -> bool:
        """Whether a thermometer was heard in the newest bin, and does not stand still."""
        heard = np.isfinite(self._readings[-1:, j]).any()
        return bool(heard) and self._quiet(j)[1] < _STILL_BINS

    def _believe_again(self, limit_k: FloatArray) -> None:
        """
        Count the bins in which replaced thermometers agree; believe those that did for long.

        Each agrees with those that are believed, or with all that report: of several that were
        lost, each may need the others to be told.
        """
        errors_k = [np.abs(self._errors(bins)[0]) for bins in (self._bins, self._together)]
        close = np.fmin(*errors_k) < _AGREES_SHARE * limit_k
        for j in list(self.replaced):
            agrees = self._reports(j) and close[j]
            self._agreeing[j] = self._agreeing[j] + 1 if agrees else 0
            if self._agreeing[j] >= _AGREED_BINS:
                del self.replaced[j]
                self._approach_k[j] = -self._errors(self._bins)[0][j]
                self._trusted[-_AGREED_BINS:, j] = True
                self._bins = self._run(self._readings, self._trusted, None)
                self._before_jump_k[:] = np.nan

    def _replace(self, j: int, bins: int, why: str) -> Rewrite:
        """Put predictions in the place of a thermometer, from some bins before on."""
        self.replaced[j], self.doubt = why, ''
        self._before_jump_k = np.full(self._thermometers, np.nan)
        self._agreeing[j], self._approach_k[j] = 0, 0.0
        self._trusted[len(self._trusted) - bins :, j] = False
        self._bins = self._together = self._run(self._readings, self._trusted, None)
        middles = (np.arange(len(self._readings)) + 0.5) * self.cells
        places = np.arange(bins * self.cells) + 0.5 + (len(self._readings) - bins) * self.cells
        predicted_c = np.interp(places, middles, self._bins.predicted_c[:, j])
        return Rewrite(j, predicted_c)

    @property
    def findings(self) -> list[str]:
        """Say which thermometers are replaced and why, in half sentences."""
        return [f'thermometer {j + 1} {why}' for j, why in sorted(self.replaced.items())]

    @property
    def sentences(self) -> list[str]:
        """Say which thermometers are not believed or contradict, and what the drift follows."""
        said = [f'{finding}; what the others predict of it is used' for finding in self.findings]
        for k, j in enumerate(sorted(self.replaced)):
            (silent, still), now = self._quiet(j), said[k]
            past = now if silent else now.replace('is silent', 'was silent')
            past = past if still >= _STILL_BINS else past.replace('stands still', 'stood still')
            said[k] = now if past == now else f'{past} until it has agreed for 30 min'
        return [*said, f'{self.doubt}; the drift follows them'] if self.doubt else said


def _mean(error_k: FloatArray) -> FloatArray:
    """Average errors of bins, (n, J), over those that are not NaN; NaN where there are none."""
    heard = np.isfinite(error_k)
    mean_k = np.where(heard, error_k, 0.0).sum(axis=0) / np.maximum(heard.sum(axis=0), 1)
    return np.where(heard.any(axis=0), mean_k, np.nan)


@dataclass(frozen=True, eq=False)
class Offsets:
    """What keeps the drift from stepping where a thermometer was replaced: (2, 6), N and N m."""

    #: The difference that the sensor's first rest makes; tares were taken with it.
    kept: FloatArray = field(default_factory=lambda: np.zeros((2, len(AXES))))
    #: What the wrong readings had moved the drift by since then; it is let go slowly.
    released: FloatArray = field(default_factory=lambda: np.zeros((2, len(AXES))))

    def on(self, drift: Drift, seconds: FloatArray | float) -> Drift:
        """Add the offsets to drifts, (…, 6), some seconds, (…, 1), after the replacement."""
        share = np.exp(-seconds / _APPROACH_S)
        parts = zip(drift, self.kept, self.released, strict=True)
        return Drift(*(part + kept + share * released for part, kept, released in parts))

    def going_on(
        self,
        model: DriftModel,
        rests_c: tuple[FloatArray, FloatArray],
        before: Drift,
        now: Drift,
    ) -> 'Offsets':
        """Go on from a drift; now is the model's. Rests are as read and as believed, °C, (J,)."""
        old, new = (np.stack(step(model, start(model, rest), rest)[1]) for rest in rests_c)
        kept = self.kept + old - new
        return Offsets(kept, np.stack(before) - np.stack(now) - kept)

    def after(self, seconds: float) -> 'Offsets':
        """Give what they are some seconds later."""
        return Offsets(self.kept, self.released * np.exp(-seconds / _APPROACH_S))


def numbered(thermometers: Iterable[int]) -> str:
    """Write thermometers as numbers from 1."""
    return ', '.join(str(j + 1) for j in thermometers)
