"""A thought: a generator that yields what-if questions and is sent the answers; and who asks them.

So the same thought serves a script, which waits, and an agent, which must not.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Generic, TypeVar

from dsr.errors import DsrError, TransportError
from dsr.vocabulary.what_if import Answer, Pending, Question, WhatIf

T = TypeVar("T")
Thought = Generator[Question, Answer, T]
"""Ends with its result. An answer that is `refused` says why."""


def think(thought: Thought[T], what_if: WhatIf) -> T:
    """The outcome of a thought; waits for each answer: for scripts.

    Raises:
        TransportError: if nobody answers.
        ImaginationError: if the thought comes to nothing.
    """
    answer: Answer | None = None
    while True:
        try:
            question = next(thought) if answer is None else thought.send(answer)
        except StopIteration as stop:
            result: T = stop.value
            return result
        try:
            answer = what_if.ask_and_wait(question)
        except TransportError as error:
            answer = Answer(refused=str(error))


class Thinking(Generic[T]):
    """A thought under way in an agent: `poll` it in every tick until it is done.

    Args:
        thought: not begun.
        what_if: asks.
    """

    def __init__(self, thought: Thought[T], what_if: WhatIf) -> None:
        self._thought = thought
        self._what_if = what_if
        self._pending: Pending | None = None
        self.result: T | None = None
        """What came of it."""
        self.failed = ""
        """Why nothing came of it."""
        self.done = False
        """Whether there is a result, or a failure."""

    def poll(self) -> bool:
        """Go on as far as there are answers; returns whether it is done."""
        while not self.done:
            if self._pending is not None and not self._pending.done:
                break
            pending, self._pending = self._pending, None
            try:
                if pending is None:
                    question = next(self._thought)
                else:
                    question = self._thought.send(pending.answer or Answer(refused=pending.failed))
                self._pending = self._what_if.ask(question)
            except StopIteration as stop:
                self.result, self.done = stop.value, True
            except DsrError as error:
                self.failed, self.done = str(error), True
        return self.done
