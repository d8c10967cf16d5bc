"""Stamps of tables to nanoseconds: numbers in a unit exactly, dates and times of day by form."""

from collections.abc import Sequence
from contextlib import suppress
from decimal import Decimal
from typing import Any

import numpy as np

from wrist_ft_comp.recordings.column_map import TIME_UNITS_NS
from wrist_ft_comp.recordings.table_header import MISSING, NUMBER
from wrist_ft_comp.series import IntArray, NANOSECONDS

#: Forms that are understood without a word. Day and month are told by what makes times follow.
_FORMS = (
    'iso', '%d.%m.%Y %H:%M:%S', '%d.%m.%Y %H:%M:%S.%f', '%d.%m.%Y %H:%M', '%d.%m.%y %H:%M:%S',
    '%m/%d/%Y %H:%M:%S', '%d/%m/%Y %H:%M:%S', '%m/%d/%Y %H:%M', '%d/%m/%Y %H:%M',
    '%m/%d/%Y %H:%M:%S.%f', '%d/%m/%Y %H:%M:%S.%f', '%m/%d/%Y %I:%M:%S %p',
    '%Y/%m/%d %H:%M:%S', '%Y/%m/%d %H:%M:%S.%f', '%d-%b-%Y %H:%M:%S', '%H:%M:%S', '%H:%M:%S.%f',
    '%H:%M', '%I:%M:%S %p',
)  # fmt: skip
#: Stamps that are looked at for their form.
_LOOKED_AT = 500
_DAY_NS = 86_400 * NANOSECONDS
#: Stamps from 2001 on have at least this size in seconds, and up to 9.2 times as much, where
#: nanoseconds of 64 bits end; in a smaller unit they are as much larger.
_EPOCH_S, _EPOCH_RANGE = 1e9, 9.2


class StampReader:
    """Converts the stamps of consecutive rows; the form is found where nobody said it."""

    def __init__(self, form: str, factor: float | None = None) -> None:
        self.form, self._factor = form, factor
        #: How often a time of day passed midnight, and the last one, ns.
        self._days, self._last_ns = 0, 0

    def read(self, stamps: Any) -> IntArray:
        """Convert texts, or whole ns; raises as exact_ns."""
        self.form = self.form or find_form(stamps) or 's'
        stamps_ns = exact_ns(stamps, self.form)
        if self._factor is not None:
            stamps_ns = np.rint(stamps_ns * self._factor).astype(np.int64)
        if self.form.startswith(('%H', '%I')) and len(stamps_ns):
            stamps_ns = stamps_ns % _DAY_NS
            has_passed = np.diff(stamps_ns, prepend=self._last_ns) < -_DAY_NS // 2
            self._last_ns = int(stamps_ns[-1])
            days = self._days + np.cumsum(has_passed)
            self._days = int(days[-1])
            stamps_ns = stamps_ns + days * _DAY_NS
        return stamps_ns


def exact_ns(stamps: Any, form: str) -> IntArray:
    """Convert stamps of a form; ValueError, ArithmeticError or TypeError where one is bad."""
    if form == 'ns' and getattr(stamps, 'dtype', None) == np.int64:
        return np.asarray(stamps)
    if unit_ns := TIME_UNITS_NS.get(form):
        if any('_' in stamp for stamp in stamps):
            raise ValueError('1_000 is no number of a table')
        numbers = (Decimal(stamp.replace(',', '.')) * unit_ns for stamp in stamps)
        return np.fromiter(map(round, numbers), np.int64, len(stamps))
    import pandas  # noqa: PLC0415 -- what reads no table does not wait for it

    texts = [stamp.strip().replace(',', '.').removesuffix(' UTC') for stamp in stamps]
    times = pandas.to_datetime(texts, format='ISO8601' if form == 'iso' else form, utc=True)
    if times.hasnans:
        raise ValueError('a stamp is missing')
    return np.asarray(times.as_unit('ns').asi8)


def find_form(stamps: Sequence[str]) -> str:
    """Find the unit of numbers by their size, or the form of dates; empty where there is none."""
    some = stamps[:: max(len(stamps) // _LOOKED_AT, 1)]
    filled = [text for text in some if text.lower() not in MISSING]
    if not filled:
        return ''
    if all(map(NUMBER.fullmatch, filled)):
        size = abs(float(filled[0].replace(',', '.'))) / _EPOCH_S
        units = 's', 'ms', 'us', 'ns'
        return next((u for k, u in enumerate(units) if 1 <= size / 1000**k < _EPOCH_RANGE), 's')
    disorder: dict[str, int] = {}
    for form in _FORMS if filled[0][:1].isdigit() else ():
        with suppress(ValueError, ArithmeticError):
            stamps_ns = exact_ns(filled, form)
            runs_back = int(np.count_nonzero(np.diff(stamps_ns) < 0))
            disorder[form] = runs_back * 10**19 + int(np.ptp(stamps_ns))
    return min(disorder, key=disorder.__getitem__) if disorder else ''
