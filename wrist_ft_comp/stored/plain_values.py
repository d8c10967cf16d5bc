"""Records to plain values and back, and JSON that no file can overload: what our files hold."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, MISSING
from functools import cache, partial
import json
import math
from pathlib import Path
import re
import sys
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, Literal, Union

import numpy as np

from wrist_ft_comp.errors import WristFtCompError

Document = dict[str, Any]
#: Most letters of a value that are quoted.
_QUOTED = 60
#: Most levels of brackets; our files have fewer.
_DEEPEST = 30
#: What no path holds: a NUL, or half of a character of two; bytes that are no text are others.
_IN_NO_PATH = re.compile('[\0\ud800-\udc7f\udd00-\udfff]')
#: What a single value may be by its annotation, and the words for it.
_SCALARS: dict[Any, tuple[tuple[type, ...], str]] = {
    float: ((int, float), 'a number'), int: ((int,), 'an integer'), str: ((str,), 'text'),
    bool: ((bool,), 'true or false'), Path: ((str,), 'a path'),
}  # fmt: skip


def to_plain(value: Any) -> Any:
    """Turn records and arrays into plain values; NaN and infinity become None."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [to_plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


def from_plain(kind: Any, value: Any, where: str = '', *, whole: bool = False) -> Any:
    """
    Turn plain values back into what an annotation names, such as a record.

    Numbers are finite; a single one may be null, which is NaN, and entries of a record that have
    a default may be absent. Not so where it is ``whole``: then only a default of None counts.

    Raises
    ------
    ValueError
        When a value has another type, an entry of a record is missing or unknown, or a record
        refuses its values; names the place.

    """
    origin, arguments, inner = get_origin(kind), get_args(kind), partial(from_plain, whole=whole)
    if origin in {Union, UnionType}:
        return None if value is None else inner(arguments[0], value, where)
    if is_dataclass(kind) or hasattr(kind, '_fields'):
        types, optional = _entries(kind, whole=whole)
        _require(isinstance(value, dict), 'named values', value, where)
        for name in sorted({*value, *types} - optional, key=str):
            _require(name in value, f'named values with {name}', list(value), where)
        for name in value:
            _require(name in types, f'none of {", ".join(types)}', name, f'{where}/{name}')
        items = {key: inner(types[key], item, f'{where}/{key}') for key, item in value.items()}
        try:
            return kind(**items)
        except WristFtCompError as error:
            raise ValueError(f'{_place(where)}: {error}') from error
    if origin in {dict, Mapping}:
        _require(isinstance(value, dict), 'named values', value, where)
        return {key: inner(arguments[1], item, f'{where}/{key}') for key, item in value.items()}
    if origin is np.ndarray:
        return _array(value, where)
    if origin in {tuple, Sequence, frozenset}:
        _require(isinstance(value, list), 'a list', value, where)
        kinds = arguments
        if origin is not tuple or arguments[-1] is ...:
            kinds = arguments[:1] * len(value)
        _require(len(kinds) == len(value), f'{len(kinds)} values', value, where)
        pairs = enumerate(zip(kinds, value, strict=True))
        members = [inner(each, item, f'{where}/{i}') for i, (each, item) in pairs]
        return frozenset(members) if origin is frozenset else tuple(members)
    if origin is Literal:
        _require(value in arguments, f'one of {", ".join(map(str, arguments))}', value, where)
    elif kind in _SCALARS:
        if kind is float and value is None and not whole:
            return math.nan
        types_of_value, words = _SCALARS[kind]
        _require(type(value) in types_of_value, words, value, where)
        if kind is Path:
            _require(not _IN_NO_PATH.search(value), words, value, where)
        elif kind is float:
            _require(abs(value) <= sys.float_info.max, 'a finite number', value, where)
        return kind(value)
    return value


@cache
def _entries(kind: Any, *, whole: bool) -> tuple[dict[str, Any], frozenset[str]]:
    """Give the annotations of a record's entries, and which of them may be absent."""
    defaults = getattr(kind, '_field_defaults', None)
    if defaults is None:
        defaults = {
            field.name: field.default
            for field in fields(kind)
            if field.default is not MISSING or field.default_factory is not MISSING
        }
    absent = [name for name, default in defaults.items() if default is None or not whole]
    return get_type_hints(kind), frozenset(absent)


def _array(value: Any, where: str) -> Any:
    """Turn nested lists of finite numbers into an array."""
    _require(isinstance(value, list), 'a list of numbers', value, where)
    rest = list(value)
    while rest:
        item = rest.pop()
        if isinstance(item, list):
            rest += item
        else:
            small = type(item) in {int, float} and abs(item) <= sys.float_info.max
            _require(small, 'finite numbers', item, where)
    try:
        return np.array(value, dtype=float)
    except ValueError as error:
        raise ValueError(f'{_place(where)} has rows that differ in length') from error


def _place(where: str) -> str:
    return where.strip('/') or 'the top level'


def _require(holds: bool, expected: str, value: Any, where: str) -> None:
    """Raise ValueError where a value is not what is expected."""
    if not holds:
        raise ValueError(f'{_place(where)} must be {expected}; got {repr(value)[:_QUOTED]}')


def parse_json(text: str | bytes) -> Any:
    """Read JSON of finite numbers, no deeper and with no longer integers than files have."""
    try:
        value = json.loads(text, parse_constant=_refuse, parse_int=_integer, parse_float=_finite)
    except RecursionError as error:
        raise ValueError('it is nested too deep') from error
    depth, level = 0, [value]
    while level := [item for item in level if isinstance(item, (dict, list))]:
        depth += 1
        if depth > _DEEPEST:
            raise ValueError('it is nested too deep')
        level = [v for item in level for v in (item.values() if isinstance(item, dict) else item)]
    return value


def _refuse(name: str) -> None:
    """Refuse NaN and infinities, which Python's JSON would take; ValueError."""
    raise ValueError(f'{name} stands in it')


def _finite(digits: str) -> float:
    """Read a number that is not so large that Python would take it for infinity."""
    value = float(digits)
    if not math.isfinite(value):
        _refuse(digits[:_QUOTED])
    return value


def _integer(digits: str) -> int:
    """Read an integer that fits 64 bits."""
    value = int(digits)
    if abs(value) >= 1 << 63:
        raise ValueError(f'an integer of {len(digits)} digits stands in it')
    return value
