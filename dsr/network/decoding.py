"""Decodes messages of others: whatever is wrong with the bytes, the only error is `WireError`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import msgspec

from dsr.errors import WireError

T = TypeVar("T")
B = TypeVar("B")


def decoded(payload: B, what: str, decode: Callable[[B], T]) -> T:
    """Decode `payload` by `decode`; `what` names the message in the error. Raises `WireError`.

    Decoders of msgspec raise more than their own error: text that is no UTF-8, numbers out of range, nesting
    without end.
    """
    try:
        return decode(payload)
    except (msgspec.MsgspecError, ValueError, IndexError, OverflowError, RecursionError) as error:
        raise WireError(f"malformed {what}: {error}") from error
