"""What identification finds for one axis: the records that candidates and the winner end in."""

from dataclasses import dataclass
from typing import Literal

from wrist_ft_comp.core.axis_model import AxisModel
from wrist_ft_comp.core.held_out import HeldOut

Output = Literal['zero', 'sensitivity']
OUTPUTS: tuple[Output, ...] = ('zero', 'sensitivity')


@dataclass(frozen=True)
class Candidate:
    """
    One competitor and how it did on held-out blocks.

    Attributes
    ----------
    name : str
        For people.
    rms : float
        Root mean square error of the free run on held-out blocks, N or N m.

    """

    name: str
    rms: float


@dataclass(frozen=True)
class Term:
    """
    One gain of a fitted model.

    Attributes
    ----------
    output : {'zero', 'sensitivity'}
        Which drift.
    time_constant_s : float
        Of the relaxation behind which the feature is taken, s; 0 is static.
    feature : str
        Such as ``θ1`` or ``θ2²``, or the knot of a hat.
    gain : float
        N or N m (zero drift), or 1 (sensitivity drift), per unit of the feature.
    error : float
        Its standard error; NaN behind a regularised regression, which has none.

    """

    output: Output
    time_constant_s: float
    feature: str
    gain: float
    error: float


@dataclass(frozen=True, eq=False)
class Fitted:
    """
    A candidate, fitted.

    Attributes
    ----------
    model : AxisModel or None
        Up to constants; None is "no compensation".
    time_constants_s, time_constant_errors_s : tuple of float
        Those that were searched, increasing, with their standard errors, s.
    terms : tuple of Term
        Gains, where the method determines them one by one.
    notes : tuple of str
        What had to be mended.
    doubts : tuple of str
        What a person should be warned of.

    """

    model: AxisModel | None
    time_constants_s: tuple[float, ...] = ()
    time_constant_errors_s: tuple[float, ...] = ()
    terms: tuple[Term, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class AxisFit:
    """
    What was found for one axis.

    Attributes
    ----------
    model : AxisModel or None
        None is "no compensation".
    chosen : str
        Name of the winning candidate.
    candidates : tuple of Candidate
        All that were tried, simplest first.
    rms_before, rms_after : float
        Held-out root mean square error without and with compensation, in the unit.
    time_constants_s : tuple of float
        Of the model's relaxations, increasing, s.
    notes : tuple of str
        What had to be mended, and what could not be learnt.
    reason : str
        Why this candidate, in a sentence with its numbers.
    time_constant_errors_s : tuple of float
        Standard errors of the time constants, s; NaN where they were not searched.
    terms : tuple of Term
        Gains with standard errors, where the method determines them one by one.
    doubts : tuple of str
        What a person should be warned of, such as better candidates that could not be trusted.
    refusal : str
        Why this axis could not be learnt although it drifts; empty when it was.
    held_out : HeldOut or None
        The errors behind rms_before and rms_after, for pictures.
    unit : str
        N, N m, or what the recordings are in.

    """

    model: AxisModel | None
    chosen: str
    candidates: tuple[Candidate, ...]
    rms_before: float
    rms_after: float
    time_constants_s: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    reason: str = ''
    time_constant_errors_s: tuple[float, ...] = ()
    terms: tuple[Term, ...] = ()
    doubts: tuple[str, ...] = ()
    refusal: str = ''
    held_out: HeldOut | None = None
    unit: str = ''
