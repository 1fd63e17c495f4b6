"""Holds the response to a question: a text, its evidence, and what programs need of both."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from dsr.narration.statements import Basis, Statement


class Response(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """What came of a question."""

    question: str
    """As it was asked."""
    text: str
    """The answer in one or several sentences; where the question is not understood, why not."""
    understood: bool = False
    """Whether the question is understood; the answer may still be that nothing is known."""
    verdict: bool | None = None
    """The answer to a question of yes or no; None for others, and where nobody knows."""
    names: tuple[str, ...] = ()
    """Names of nodes that the answer consists of: where, who, which."""
    time: float | None = None
    """s, the answer to a question of when"""
    since: float | None = None
    """s, the earliest time that the answer may be, where nobody saw it until `time`; else None"""
    basis: Basis | None = None
    """What the answer rests on: the weakest basis of its evidence."""
    confidence: float = 1.0
    """Probability (0 to 1) that those gave who inferred it: the least of the evidence."""
    evidence: tuple[Statement, ...] = ()
    """The statements that the answer is made from, each with its percepts, relations or events."""
    parts: tuple[Response, ...] = ()
    """The responses to each of several questions in one."""
    part: str = ""
    """What of the question is not understood."""
    similar: tuple[str, ...] = ()
    """Questions that are understood, most like this one."""


def understood(
    text: str,
    evidence: Iterable[Statement] = (),
    *,
    question: str = "",
    verdict: bool | None = None,
    names: Iterable[str] = (),
    time: float | None = None,
    since: float | None = None,
) -> Response:
    """A response to a question that is understood; its basis and confidence are the weakest of the evidence."""
    given = tuple(evidence)
    bases = [one.basis for one in given]
    basis = next((basis for basis in (Basis.BELIEVED, Basis.PERCEIVED, Basis.OWN) if basis in bases), None)
    return Response(
        question=question, text=text, understood=True, verdict=verdict, names=tuple(names), time=time, since=since,
        basis=basis, confidence=min((one.confidence for one in given), default=1.0), evidence=given,
    )  # fmt: skip


def joined(statements: Iterable[Statement]) -> str:
    """The sentences of statements, one after the other, each beginning with a capital unless with a name."""
    return " ".join(statement.text for statement in statements)
