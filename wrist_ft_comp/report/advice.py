"""What to record next: what the recordings of a calibration leave open, most important first."""

from collections.abc import Iterator, Mapping, Sequence

from wrist_ft_comp.report.coverage import Coverage, unseen_temperatures
from wrist_ft_comp.report.verdict import Level
from wrist_ft_comp.signals import AXES, Reference

#: A recording should last this many times the slowest time constant, and at least so long, s.
_TIME_CONSTANTS = 4.0
_SHORT_S = 3600.0
#: One direction counts as missing when it holds less than this share of the other.
_ONE_WAY = 0.2
#: Temperatures closer than this are the same, K.
_SAME_K = 0.5


def what_to_record_next(  # noqa: PLR0913 -- what a calibration knows, each a plain value
    coverage: Coverage,
    levels: Mapping[str, Level],
    reference: Reference,
    durations_s: Sequence[float],
    slowest_s: float,
    *,
    chamber: bool = False,
) -> list[str]:
    """Say what another recording should hold; in a chamber, heat has but one source and no way."""
    advice = [*_temperatures(coverage)]
    if not chamber:
        advice += [*_thermometers_and_ways(coverage, levels), *_lengths(durations_s, slowest_s)]
        if missing := [axis for axis in AXES if axis not in levels]:
            names = _names(missing)
            advice.append(f'No recording holds {names}; what is not recorded is passed through.')
    if reference not in {'recorded', 'payload'} or not coverage.loads:
        advice.append(
            'The drift of the gain is not known. If the sensor works under large loads, record '
            'changing loads with a reference beside them (reference "recorded").'
        )
    return [
        *advice,
        'Judge this model on a recording that it has not seen: wrist_ft_comp evaluate.',
    ]


def what_was_not_learnt(coverage: Coverage, learnt_c: Sequence[tuple[float, float]]) -> str:
    """Say where a recording left the ranges, °C, that a model's thermometers were learnt at."""
    outside = [
        f'thermometer {number + 1}'
        for number, (seen, known) in enumerate(zip(coverage.range_c, learnt_c, strict=True))
        if seen[0] < known[0] - _SAME_K or seen[1] > known[1] + _SAME_K
    ]
    if not outside:
        return 'Nothing: the model was learnt at all the temperatures of these recordings.'
    return (
        f'Here {" and ".join(outside)} left the temperatures that the model was learnt at. '
        'Calibrate again with these recordings among the others.'
    )


def _temperatures(coverage: Coverage) -> Iterator[str]:
    """Name the temperatures that are missing."""
    low, high = coverage.range_c[coverage.leading]
    where = f' at thermometer {coverage.leading + 1}' if len(coverage.range_c) > 1 else ''
    unseen = unseen_temperatures(coverage)
    for start, end in unseen:
        if end <= low or start >= high:
            yield (
                f'You have not seen {start:.0f} to {end:.0f} °C{where}: there the correction is a '
                'guess, a straight line. If the robot gets there, record it there.'
            )
    holes = [f'{start:.0f} to {end:.0f}' for start, end in unseen if low < end <= high > start]
    if holes:
        yield (
            f'Between {low:.0f} and {high:.0f} °C you have not seen {", ".join(holes)} °C{where}: '
            'there the correction is a guess between its neighbours. Record some of these.'
        )


def _thermometers_and_ways(coverage: Coverage, levels: Mapping[str, Level]) -> Iterator[str]:
    """Ask for a second thermometer where one explains little, and for the way that is missing."""
    poor = [axis for axis, level in levels.items() if level in {'weak', 'harmful'}]
    if len(coverage.range_c) == 1 and poor:
        yield (
            f'One thermometer does not explain {_names(poor)} well. Heat that comes from two '
            'sides needs two: put another one at the side of the motor, or of the room.'
        )
    up, down = coverage.risen_k, coverage.fallen_k
    if min(up, down) < _ONE_WAY * max(up, down):
        missing, action = ('cooled', 'cool down') if down < up else ('warmed', 'warm up')
        yield (
            f'The sensor {missing} by {min(up, down):.1f} K only, and went {max(up, down):.1f} K '
            f'the other way: let it {action} while recording. A lag shows where both ways differ.'
        )


def _lengths(durations_s: Sequence[float], slowest_s: float) -> Iterator[str]:
    """Ask for longer, or for more recordings."""
    longest_s = max(durations_s)
    wanted_s = max(_TIME_CONSTANTS * slowest_s, _SHORT_S)
    if longest_s < wanted_s:
        why = f', as the slowest lag is {slowest_s / 60:.0f} min' if slowest_s > 0 else ''
        yield (
            f'The longest recording lasts {longest_s / 3600:.1f} h; record '
            f'{wanted_s / 3600:.1f} h or more{why}.'
        )
    if len(durations_s) == 1:
        yield 'Record on a second day: a model is then judged on whole days that it has not seen.'


def _names(axes: Sequence[str]) -> str:
    """Enumerate axes for people."""
    words = [axis.replace('_', ' ') for axis in axes]
    return words[0] if len(words) == 1 else f'{", ".join(words[:-1])} and {words[-1]}'
