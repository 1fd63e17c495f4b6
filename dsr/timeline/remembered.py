"""What is remembered of an event or a situation that was over, and how a summary of many is written; pure.

Names are written once, and times as seconds since the earliest. The JSON is compressed (DEFLATE, RFC 1951, as text in
base 85), as much in it is alike: a page holds some thousands of them.
"""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Iterable
from typing import Annotated, Any

import msgspec

from dsr.clock import is_time
from dsr.errors import WireError
from dsr.network.decoding import decoded
from dsr.timeline.entries import EVENT, SITUATION, Entry
from dsr.timeline.kinds import INTENTION

MOST_BYTES = 8192
"""Bytes of what a summary holds: some thousands of things remembered, more than a person tells of a week"""
_MOST_UNPACKED = 16 * MOST_BYTES
"""Bytes of the JSON of a summary: what malformed text unpacks to is no more. Summaries shrink to a third"""
_MOST_JSON = _MOST_UNPACKED - 1024
"""Bytes of the JSON of the things in a summary: beside them stand three numbers"""
_DECIMALS = 1
"""Of times, s: a chronicler looks ten times a second"""


class Remembered(msgspec.Struct, frozen=True):
    """An event or a situation that was over, as it is remembered."""

    begin: float
    """s, to a tenth; of an event, when it happened"""
    kind: str
    """As of the entry: `on`, `Pick`, `explained`."""
    participants: tuple[str, ...]
    """As of the entry, the first eight."""
    end: float | None = None
    """s, to a tenth; None for an event"""
    text: str = ""
    """A sentence, of what cannot be told from kind and participants."""
    source: str = ""
    confidence: float = 1.0
    """Probability (0 to 1) that it is true."""

    @property
    def is_event(self) -> bool:
        """Whether it happened at an instant."""
        return self.end is None

    @property
    def last(self) -> float:
        """Time (s) when it was over."""
        return self.begin if self.end is None else self.end

    def entry(self, name: str) -> Entry:
        """The entry that it was, by the name of the summary that holds it."""
        details = {"summary": name}
        if self.kind == INTENTION:
            details["status"], _, details["goal"] = self.text.partition(": ")
        return Entry(
            name=name, type=EVENT if self.is_event else SITUATION, kind=self.kind, participants=self.participants,
            begin=self.begin, end=self.last, text=self.text, confidence=self.confidence, source=self.source,
            details=details,
        )  # fmt: skip

    @property
    def order(self) -> tuple[float, float, str, tuple[str, ...], str, str, float, bool]:
        """By which things remembered are sorted, the times of being over first; equal for equal things alone."""
        what = self.kind, self.participants, self.text, self.source, self.confidence
        return self.last, self.begin, *what, self.is_event


class PeriodSummary(msgspec.Struct, frozen=True):
    """What is remembered of a period."""

    resolution: float = 0.0
    """s; of what is alike and shorter, the last within it is remembered: no finer than that of the level"""
    complete_from: float = 0.0
    """s; of what was over before and not surprising, some is lost"""
    surprises_from: float = 0.0
    """s; of the surprises that were over before, some are lost"""
    items: tuple[Remembered, ...] = ()
    """In the order in which they were over."""


_Number = Annotated[int, msgspec.Meta(ge=0)]
"""Of a name"""


class _Row(msgspec.Struct, frozen=True, array_like=True):
    """Something remembered as it is written: numbers of names, and times since the earliest."""

    begin: float
    kind: _Number
    participants: tuple[_Number, ...] = ()
    end: float | None = None
    source: _Number = 0
    confidence: float = 1.0
    text: str = ""


class _Page(msgspec.Struct, frozen=True):
    """A summary as it is written."""

    since: float = 0.0
    names: tuple[str, ...] = ("",)
    resolution: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    complete_from: float = 0.0
    surprises_from: float = 0.0
    items: tuple[_Row, ...] = ()


_decoder = msgspec.json.Decoder(_Page)
_DEFAULTS: tuple[Any, ...] = (None, None, (), None, 0, 1.0, "")
"""What need not be written at the end of a row"""


def _encoded_items(items: Iterable[Remembered]) -> dict[str, Any]:
    """Things remembered as plain data: `since` (s), `names`, and `items` with numbers of names."""
    rows = list(items)
    since = float(int(min((item.begin for item in rows), default=0.0)))
    numbers: dict[str, int] = {"": 0}

    def number(name: str) -> int:
        return numbers.setdefault(name, len(numbers))

    written = [
        _trimmed([
            _shifted(item.begin, since), number(item.kind), tuple(map(number, item.participants)),
            None if item.end is None else _shifted(item.end, since), number(item.source), item.confidence, item.text,
        ])
        for item in rows
    ]  # fmt: skip
    return {"since": since, "names": list(numbers), "items": written}


def encoded_summary(summary: PeriodSummary) -> str:
    """A summary as text."""
    limits = {name: getattr(summary, name) for name in ("resolution", "complete_from", "surprises_from")}
    return _packed(msgspec.json.encode(_encoded_items(summary.items) | limits)).decode()


def written_size(items: Iterable[Remembered]) -> int:
    """Bytes that things remembered take as they are written; more where they could not be read again."""
    plain = msgspec.json.encode(_encoded_items(items))
    return max(len(_packed(plain)), math.ceil(len(plain) * MOST_BYTES / _MOST_JSON))


def decoded_summary(text: str) -> PeriodSummary:
    """The summary of a text. Raises `WireError`, also for one that is far too long."""
    if len(text) > 2 * MOST_BYTES:
        raise WireError(f"malformed summary: {len(text)} characters, expected at most {2 * MOST_BYTES}")
    return decoded(text, "summary", _decode)


def _packed(plain: bytes) -> bytes:
    return base64.b85encode(zlib.compress(plain, zlib.Z_BEST_COMPRESSION))


def _unpacked(text: str) -> bytes:
    """The JSON of a text. Raises `ValueError`, also for what unpacks to more than any summary."""
    unpacking = zlib.decompressobj()
    try:
        plain = unpacking.decompress(base64.b85decode(text), _MOST_UNPACKED)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if not unpacking.eof:
        raise ValueError(f"expected an end within {_MOST_UNPACKED} bytes of JSON")
    return plain


def _decode(text: str) -> PeriodSummary:
    page = _decoder.decode(_unpacked(text))
    names = page.names

    def time(shifted: float) -> float:
        return round(_checked_time(page.since + shifted), _DECIMALS)

    return PeriodSummary(
        resolution=page.resolution, complete_from=_checked_time(page.complete_from),
        surprises_from=_checked_time(page.surprises_from),
        items=tuple(
            Remembered(
                begin=time(row.begin), kind=names[row.kind],
                participants=tuple(names[number] for number in row.participants),
                end=None if row.end is None else time(row.end), text=row.text,
                source=names[row.source], confidence=row.confidence,
            )
            for row in page.items
        ),
    )  # fmt: skip


def _checked_time(time: float) -> float:
    """The time. Raises `ValueError` for one that no calendar has."""
    if not is_time(time):
        raise ValueError(f"expected a time, got {time:g} s")
    return time


def _shifted(time: float, since: float) -> float:
    """Seconds since then, without a fraction if there is none."""
    shifted = round(time - since, _DECIMALS)
    return int(shifted) if shifted.is_integer() else shifted


def _trimmed(row: list[Any]) -> list[Any]:
    while row[-1] == _DEFAULTS[len(row) - 1]:
        row.pop()
    return row
