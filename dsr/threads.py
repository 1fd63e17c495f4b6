"""Makes threads that work for whoever makes them: what they log is said in the name of the same agent."""

from __future__ import annotations

import contextlib
import contextvars
import threading
from collections.abc import Callable, Iterator

_agent: contextvars.ContextVar[str] = contextvars.ContextVar("agent", default="")


def acting_agent() -> str:
    """Name of the agent for which this thread works; empty if for none."""
    return _agent.get()


@contextlib.contextmanager
def acting_for(agent: str) -> Iterator[None]:
    """Within it, this thread and those that it makes by `new_thread` work for `agent`."""
    token = _agent.set(agent)
    try:
        yield
    finally:
        _agent.reset(token)


def new_thread(target: Callable[[], None], name: str) -> threading.Thread:
    """Make a daemon thread, yet to be started, that works for the same agent as this one."""
    context = contextvars.copy_context()
    return threading.Thread(target=lambda: context.run(target), name=name, daemon=True)
