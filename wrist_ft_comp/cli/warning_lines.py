"""What a person should know besides the result: lines on standard error."""

from collections.abc import Iterable
import sys

import numpy as np

from wrist_ft_comp.core.recording import Recording
from wrist_ft_comp.files.model_file import StoredModel


def print_warnings(sentences: Iterable[str]) -> None:
    """
    Print warnings to standard error, each once.

    Parameters
    ----------
    sentences : iterable of str
        Of two that begin alike the longer one is printed.

    """
    distinct = dict.fromkeys(sentences)
    for sentence in distinct:
        if not any(other != sentence and other.startswith(sentence) for other in distinct):
            print(f'warning: {sentence}', file=sys.stderr)


def range_warnings(stored: StoredModel, recording: Recording) -> tuple[str, ...]:
    """
    Say where a recording is colder or hotter than what a model was learnt from.

    Parameters
    ----------
    stored : StoredModel
        With the range of every thermometer.
    recording : Recording
        With the same thermometers.

    Returns
    -------
    tuple of str
        One sentence per thermometer that leaves its range.

    """
    found = []
    for number, column in enumerate(recording.temperature_c.T):
        low, high = stored.document['thermometers'][number]['range_c']
        share = float(np.mean((column < low) | (column > high)))
        if share > 0:
            found.append(
                f'Thermometer {number + 1} of {recording.name} goes from {column.min():.1f} to '
                f'{column.max():.1f} °C; the model was learnt from {low:.1f} to {high:.1f} °C. '
                f'For {100 * share:.2g} % of the time the correction is a guess.'
            )
    return tuple(found)
