"""What a person may choose for a calibration, checked once where it is chosen."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import get_args, Literal

from wrist_ft_comp.drift.features import FeatureKind
from wrist_ft_comp.errors import check_range, SettingsError
from wrist_ft_comp.recording import Reference

Method = Literal['pcr', 'pls', 'filtered_pls', 'arx_pls', 'arx_pls_oe', 'auto']
METHODS: tuple[Method, ...] = get_args(Method)


def _check_choice(name: str, choice: str, choices: Sequence[str]) -> None:
    if choice not in choices:
        raise SettingsError(f'Unknown {name} {choice!r}; expected one of {", ".join(choices)}.')


@dataclass(frozen=True)
class Orders:
    """Orders of one latent's ARX, determined before its coefficients (last sentence of 3.2)."""

    #: n, how many past outputs of its own it feeds back, and m, how many inputs it takes.
    n: int = 0
    m: int = 1
    #: d_r, cells: the newest input is t(k-d-1) ...
    d: int = 0
    #: ... or t(k-d), as a model without delay needs it.
    direct: bool = False

    def __post_init__(self) -> None:
        for name, least in (('n', 0), ('m', 1), ('d', 0)):
            check_range(name, getattr(self, name), least)

    def __str__(self) -> str:
        return f'n {self.n}, m {self.m}, d {self.d}{", direct" if self.direct else ""}'

    @property
    def first_lag(self) -> int:
        """Cells between the output and the newest input: d + 1, or d with a direct term."""
        return self.d if self.direct else self.d + 1


#: u_r = b_r t_r (eq. 10): no memory.
STATIC = Orders(direct=True)


@dataclass(frozen=True)
class IdentificationSettings:
    """What a person chose about the model's structure."""

    method: Method = 'auto'
    features: FeatureKind = 'powers'
    #: Highest power of temperature, 1 to 4; auto and arx_pls_oe also try the lower ones. None
    #: means 3 for auto, which shrinks gains of high powers, and 2 for the others.
    degree: int | None = None
    #: Orders of each latent of arx_pls, or one for all; empty lets held-out folds choose.
    orders: tuple[Orders, ...] = ()

    def __post_init__(self) -> None:
        _check_choice('method', self.method, METHODS)
        _check_choice('features', self.features, get_args(FeatureKind))
        if self.degree not in {None, 1, 2, 3, 4}:
            raise SettingsError(f'The degree must be between 1 and 4; got {self.degree}.')

    @property
    def highest_degree(self) -> int:
        """The degree that was chosen, or else the default of the method."""
        return self.degree or (3 if self.method == 'auto' else 2)


@dataclass(frozen=True)
class CalibrationSettings:
    """What a person chose for a calibration."""

    #: What the true wrench was: unloaded (zero), constant (unknown), that of an unknown payload
    #: whose specific force was recorded, or recorded beside the raw one.
    reference: Reference = 'unloaded'
    #: Refuse when no thermometer spans at least this much, K.
    min_temperature_span_k: float = 3.0
    identification: IdentificationSettings = field(default_factory=IdentificationSettings)

    def __post_init__(self) -> None:
        _check_choice('reference', self.reference, get_args(Reference))
        check_range('min_temperature_span_k', self.min_temperature_span_k, 0.0)
