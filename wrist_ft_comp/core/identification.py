"""
Identification of one axis: candidates compete on blocks that they did not see.

Every method ends in the same type, so whatever was chosen runs by the same free run.
"""

from wrist_ft_comp.core.axis_fit import AxisFit, Candidate, Term
from wrist_ft_comp.core.problem import AxisProblem
from wrist_ft_comp.core.relaxations import identify_relaxations
from wrist_ft_comp.core.settings import IdentificationSettings, Method, METHODS
from wrist_ft_comp.core.two_step import identify_two_step

__all__ = [
    'METHODS',
    'AxisFit',
    'Candidate',
    'IdentificationSettings',
    'Method',
    'Term',
    'identify_axis',
]


def identify_axis(problem: AxisProblem, settings: IdentificationSettings) -> AxisFit:
    """
    Identify one axis by the method that was chosen.

    Parameters
    ----------
    problem : AxisProblem
        Drift observations.
    settings : IdentificationSettings
        Method and structure.

    Returns
    -------
    AxisFit
        The winner, and everything that was tried.

    Raises
    ------
    TooShortError
        When an ARX does not find enough consecutive samples.

    """
    method = settings.method
    if method != 'arx_pls_oe' and method != 'auto':  # noqa: PLR1714 -- mypy narrows only this
        return identify_two_step(problem, settings, (method,))
    if method == 'auto' and settings.features == 'hats':
        # Knots follow the temperatures that are left when a block is held out, so moments that
        # were summed once cannot serve all candidates.
        return identify_two_step(problem, settings, ('none', 'pls'))
    return identify_relaxations(problem, settings)
