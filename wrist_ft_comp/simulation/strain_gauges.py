"""
The strain gauges of a simulated force/torque sensor: six full bridges, and how they drift.

Gauges differ a little in their temperature coefficient and in their place, so the zero drifts
with temperature and with its gradient (eq. 1 of the paper), and the piezoresistive coefficient
falls with temperature, so the gain drifts (eq. 2).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrist_ft_comp.signals import FloatArray
from wrist_ft_comp.simulation.heat_flow import FtSensorSettings, interpolation

#: Temperature at which the gauges' nominal values and the gain hold, °C.
NOMINAL_C = 25.0
#: Sign of each gauge's strain, and of its share in the bridge's output.
GAUGE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Gauges:
    """The gauges that a seed has drawn: six bridges of four."""

    #: Their temperatures from the M node temperatures of HeatFlow, shape (6, 4, M).
    weights: FloatArray
    #: Relative change of resistance with temperature, 1/K and 1/K², shape (6, 4).
    per_k: FloatArray
    per_k2: FloatArray


def draw_gauges(settings: FtSensorSettings, rng: np.random.Generator) -> Gauges:
    """Draw the places and coefficients of one specimen."""
    s = settings
    axes = s.gauge_position + s.axis_position_spread * rng.uniform(-1, 1, (6, 1))
    places = axes + s.gauge_position_spread * rng.uniform(-1, 1, (6, 4))
    per_k = _gauge_coefficients(s, rng)
    per_k2 = s.gauge_coefficient_per_k2 + s.gauge_mismatch_per_k2 * rng.standard_normal((6, 4))
    return Gauges(interpolation(s.cells, places), per_k, per_k2)


def _gauge_coefficients(settings: FtSensorSettings, rng: np.random.Generator) -> FloatArray:
    """Draw the linear temperature coefficients, 1/K, shape (6, 4), sorted into bridges."""
    drawn = settings.gauge_mismatch_per_k * rng.standard_normal((6, 4))
    smallest, largest = settings.zero_coefficient_per_k
    wanted = rng.uniform(smallest, largest, 6) * rng.choice((-1.0, 1.0), 6)
    # Near balance, eq. 1 is V = (δ1 - δ2 + δ3 - δ4) / 4, δ the relative changes of resistance.
    excess = wanted - drawn @ GAUGE_SIGNS / 4
    return np.asarray(settings.gauge_coefficient_per_k + drawn + excess[:, None] * GAUGE_SIGNS)


def bridge_output(resistances: FloatArray, changes: FloatArray) -> FloatArray:
    """Compute V/V of Wheatstone bridges of R1 to R4 and their changes, (..., 4), by eq. 1."""
    r1, r2, r3, r4 = np.moveaxis(resistances + GAUGE_SIGNS * changes, -1, 0)
    return np.asarray((r1 * r3 - r2 * r4) / ((r1 + r2) * (r3 + r4)))  # eq. 1


def bridge_wrench(
    settings: FtSensorSettings, gauges: Gauges, nodes_c: FloatArray, wrench: ArrayLike
) -> FloatArray:
    """Compute what bridges show of wrenches, (..., 6), at nodes_c, °C, (..., M), without noise."""
    s = settings
    warm = np.einsum('agm,...m->...ag', gauges.weights, nodes_c) - NOMINAL_C
    resistances = 1.0 + gauges.per_k * warm + gauges.per_k2 * warm**2
    falling = 1.0 + s.piezoresistive_per_k * warm + s.piezoresistive_per_k2 * warm**2
    stiffness = per_axis(s.force_stiffness_n, s.torque_stiffness_nm)
    strain = (np.asarray(wrench) / stiffness)[..., None]
    changes = resistances * s.piezoresistive_coefficient * falling * strain  # ΔR/R = πσ, eq. 2
    shown = stiffness / s.piezoresistive_coefficient
    return np.asarray(bridge_output(resistances, changes) * shown)


def per_axis(force: float, torque: float) -> FloatArray:
    """Spread a value for forces and one for torques over AXES, shape (6,)."""
    return np.repeat([force, torque], 3)
