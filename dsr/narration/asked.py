"""Finds the time that a question means."""

from __future__ import annotations

from dsr.errors import ConfigError
from dsr.narration.calendar import TimeSpan, time_span
from dsr.narration.questions import Query
from dsr.narration.statements import Moment


def span_asked(moment: Moment, query: Query) -> TimeSpan | None:
    """The time that a question names; None for now.

    Raises:
        ConfigError: for a time that does not exist or lies in the future, and one that counts from a beginning where
            nothing has begun.
    """
    if query.when:
        return time_span(query.when, moment.now, moment.zone)
    counted = query.at if query.since is None else query.since
    if counted is None:
        return None
    if moment.origin is None:
        raise ConfigError(f"a running system has no beginning from which to count: ask for {counted:g} s ago")
    begin = moment.origin + counted
    if begin > moment.now:
        raise ConfigError(f"{counted:g} s is after the end, {moment.now - moment.origin:.1f} s")
    return TimeSpan(begin, begin if query.since is None else moment.now, f"at {counted:g} s")
