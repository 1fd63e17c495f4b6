"""Attribute values of CORTEX graph files: by type code to ours and back, with a note of the rest."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import Any

import msgspec

from dsr.errors import WireError
from dsr.graph.schema import Kind, Value
from dsr.math3d.transforms import Pose
from dsr.network.decoding import decoded

STRING, INT32, FLOAT, FLOATS, BOOL, BYTES, UINT32, UINT64, DOUBLE, UINT64S = range(10)
_INTEGERS = (INT32, UINT32, UINT64)
_REALS = (FLOAT, DOUBLE)
_VECTORS = {FLOATS: None, 10: 2, 11: 3, 12: 4, 13: 6}
"""Codes of vectors, with their lengths."""

NOTE = "cortex"
"""Attribute with the content of a CORTEX file that our graph cannot hold, see `Note`."""
_DIGITS = re.compile(r"\s*[+-]?[0-9]{1,100}\s*")
PREFIX = "cortex."
"""Prefix of attribute names for values that the graph cannot hold: such values are kept as JSON text."""


class Origin(msgspec.Struct, frozen=True, omit_defaults=True):
    """The form that one attribute had in the CORTEX file."""

    code: int
    name: str | None = None
    """Name of the attribute in the CORTEX file, if it differs from ours."""
    text: bool = False
    """Whether our value is the JSON text of the one there."""
    extra: dict[str, Any] = {}
    """Members beside `type` and `value`."""


class Note(msgspec.Struct, frozen=True, omit_defaults=True):
    """The form that a node or link had in the CORTEX file; kept as compact JSON."""

    id: str = ""
    name: str | None = None
    type: str | None = None
    """Name and type (or label) there, if they are others."""
    attributes: dict[str, Origin] = {}
    """Origins of attributes, by our name; attributes that would be written in the same way without an origin are left
    out.
    """
    extra: dict[str, Any] = {}
    """Further members of the element in the CORTEX file, by name."""

    def encoded(self) -> str:
        """The note as the value of an attribute."""
        return msgspec.json.encode(self).decode()

    @staticmethod
    def decoded(text: object) -> Note:
        """The note in an attribute; an empty one if it is none (any more)."""
        try:
            return decoded(text, "note", _note_decoder.decode) if isinstance(text, str) else Note()
        except WireError:
            return Note()


_note_decoder = msgspec.json.Decoder(Note)


def to_ours(code: int, value: Any) -> tuple[Kind, Value | None]:
    """The kind that values of this code have, and the value; None for one that our graph cannot hold.

    Raises `ValueError` for a value that does not go with its code.
    """
    if code in _VECTORS:
        return "vector", _reals(value, _VECTORS[code])
    if code in _SCALARS:
        kind, convert = _SCALARS[code]
        return kind, convert(value)
    return "str", value if isinstance(value, str) and code != UINT64S else None


def _integer(value: Any) -> int | None:
    """Digits in a string (uint64), or a number without a fraction."""
    if (isinstance(value, str) and _DIGITS.fullmatch(value)) or (isinstance(value, float) and value.is_integer()):
        value = int(value)
    if type(value) is not int:
        raise ValueError(f"expected an integer, got {value!r:.80}")
    return value if -(1 << 63) <= value < (1 << 63) else None


def _real(value: Any) -> float | None:
    """A number, or a string of one with a decimal point or comma; None for null, nan, inf and huge integers."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"expected a number, got {value!r:.80}")
    try:
        number = float(value.replace(",", ".") if isinstance(value, str) else value)
    except OverflowError:
        return None
    except ValueError:
        raise ValueError(f"expected a number, got {value!r:.80}") from None
    exact = math.isfinite(number) and (not isinstance(value, int) or int(number) == value)
    return number if exact else None


def _reals(value: Any, length: int | None) -> tuple[float, ...] | None:
    if not isinstance(value, list) or len(value) != (length or len(value)):
        raise ValueError(f"expected a list of {length or 'any number of'} numbers, got {value!r:.80}")
    numbers = [_real(item) for item in value]
    return None if None in numbers else tuple(number for number in numbers if number is not None)


def _bool(value: Any) -> bool:
    found = {"true": True, "false": False, "1": True, "0": False}.get(str(value).lower())
    if found is None:
        raise ValueError(f"expected true or false, got {value!r:.80}")
    return found


def _bytes(value: Any) -> bytes:
    if not isinstance(value, list) or not all(type(item) is int and 0 <= item <= 255 for item in value):
        raise ValueError(f"expected a list of integers from 0 to 255, got {value!r:.80}")
    return bytes(value)


_SCALARS: dict[int, tuple[Kind, Callable[[Any], Value | None]]] = {
    **dict.fromkeys(_INTEGERS, ("int", _integer)),
    **dict.fromkeys(_REALS, ("float", _real)),
    BOOL: ("bool", _bool),
    BYTES: ("bytes", _bytes),
}


def to_theirs(value: Value, origin: Origin | None) -> dict[str, Any]:
    """One of our values as a CORTEX attribute, with the code that it came with if that still fits."""
    code = default_code(value)
    if origin is not None and origin.text and isinstance(value, str):
        try:
            plain = json.loads(value, parse_float=_finite, parse_constant=_finite)
            return {"type": origin.code, "value": plain, **origin.extra}
        except ValueError:  # somebody wrote another text
            return {"type": STRING, "value": value}
    if origin is not None and _fits(value, origin.code):
        code = origin.code
    return {"type": code, "value": _plain(value, code), **(origin.extra if origin is not None else {})}


def _finite(text: str) -> float | None:
    """A number in JSON text; None for nan and inf, which files cannot hold."""
    number = float(text)
    return number if math.isfinite(number) else None


def default_code(value: Value) -> int:
    """The code that a value gets which did not come from such a file."""
    if isinstance(value, bool):
        return BOOL
    if isinstance(value, int):
        if -(1 << 31) <= value < (1 << 31):
            return INT32
        return UINT64 if value >= 0 else STRING
    return {float: DOUBLE, str: STRING, bytes: BYTES}.get(type(value), FLOATS)


def _fits(value: Value, code: int) -> bool:
    if code in _INTEGERS:
        return type(value) is int or (type(value) is float and value.is_integer())
    if code in _REALS:
        return type(value) is float
    if code in _VECTORS:
        return isinstance(value, tuple) and _VECTORS[code] in (None, len(value))
    if code in (BOOL, BYTES):
        return isinstance(value, bool if code == BOOL else bytes)
    return isinstance(value, str) and code != UINT64S


def _plain(value: Value, code: int) -> Any:
    if isinstance(value, Pose):
        return [*value.t, *value.q, value.stamp]
    if isinstance(value, bytes | tuple):
        return list(value)
    if code in _INTEGERS:
        return str(int(value)) if code == UINT64 else int(value)
    return str(value) if code == STRING else value
