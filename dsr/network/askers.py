"""Which of the requests that wait are worth an answer: the newest of each asker, of a bounded number of askers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol, TypeVar

from dsr.network.transport import MAX_ASKERS


class OpenRequest(Protocol):
    """A request that waits for an answer."""

    def drop(self) -> None:
        """Tell the asker that no answer comes."""


R = TypeVar("R", bound=OpenRequest)


def newest_of_each(
    receive: Callable[[], R], receive_now: Callable[[], R | None], asker: Callable[[R], str]
) -> Iterator[R]:
    """Requests in the order of their askers' first ones; one that its asker has followed by another is dropped.

    Args:
        receive: waits for the next request.
        receive_now: the next one, or None if none has come.
        asker: tells whose a request is.
    """
    waiting: dict[str, R] = {}
    while True:
        request = receive_now() if waiting else receive()
        if request is None:
            yield waiting.pop(next(iter(waiting)))
            continue
        name = asker(request)
        dropped = waiting.get(name) if name in waiting or len(waiting) < MAX_ASKERS else request
        if dropped is not request:
            waiting[name] = request
        if dropped is not None:
            dropped.drop()
