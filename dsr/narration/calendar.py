"""Reads times as people say them: yesterday, last Tuesday, this morning, on 12 November, between 3 and 4 pm; pure.

The time zone is given, or that of the machine. Days are counted on its calendar, so a day of a change of the clocks has
23 or 25 hours.
"""

from __future__ import annotations

import math
import re
from datetime import date, datetime, timedelta, tzinfo
from typing import NamedTuple
from zoneinfo import ZoneInfo

from dsr.errors import ConfigError

WEEKDAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
MONTHS = (
    "january", "february", "march", "april", "may", "june", "july", "august", "september", "october", "november",
    "december",
)  # fmt: skip
_MONTHS = {name: number for number, long in enumerate(MONTHS, 1) for name in (long, long[:3])}
NUMBERS = {
    word: float(number)
    for number, word in enumerate(
        ["zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
    )
} | {"a": 1.0, "an": 1.0, "half": 0.5}  # fmt: skip
"""Numbers as words; "half an hour" is read as half of one."""
_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hour", "hours"), 3600.0),
}
_DAYS = {"day": 1, "days": 1, "week": 7, "weeks": 7}
_PARTS = {"morning": (5, 12), "afternoon": (12, 18), "evening": (18, 24), "night": (18, 30)}
"""Hours of the day from which to which a part of it lasts: the night until six of the next day."""
_WORD = re.compile(r"\d{4}-\d{2}-\d{2}|\d{1,2}:\d{2}|\d+(?:\.\d+)?|[^\s,?!\"\d][^\s,?!\"]*")
MARK = "\x02"
"""Stands in a question where a time was; no name has it."""


class TimeSpan(NamedTuple):
    """A stretch of time that words mean."""

    begin: float
    """s"""
    end: float
    """s; the same as `begin` for an instant"""
    words: str
    """The words that mean it."""

    @property
    def is_instant(self) -> bool:
        """Whether it has no length."""
        return self.begin == self.end


class _Clock(NamedTuple):
    begin: float
    """h since midnight"""
    end: float | None
    """h; None for an instant, infinite for the rest of the day"""


class _Day(NamedTuple):
    """A day or several, as they are said."""

    kind: str
    """`before` today, `weekday`, `date`, `week` or `month`"""
    number: int = 0
    """Days before today; of a weekday 0 to 6; the year, 0 if it is unsaid; weeks or months before this one"""
    month: int = 0
    day: int = 0


class _Said(NamedTuple):
    """Parts of a time, as they are said."""

    since: bool = False
    ago: float | None = None
    """s before now, of an instant"""
    lately: float | None = None
    """s before now, until now; infinite for `ever`"""
    day: _Day | None = None
    part: str = ""
    clock: _Clock | None = None


_Read = tuple[_Said, int] | None


def zone_of(name: str | None) -> tzinfo | None:
    """The time zone of a name such as `Europe/Madrid`; None, that of the machine, for none. Raises `ConfigError`."""
    if name is None:
        return None
    try:
        return ZoneInfo(name)
    except (ValueError, OSError, KeyError) as error:
        raise ConfigError(f"no time zone {name!r}: expected a name such as Europe/Madrid or UTC") from error


def without_times(text: str) -> tuple[str, tuple[str, ...]]:
    """A text in lower case with `MARK` where it names times, and the words of these times in their order."""
    found, kept, end = [], [], 0
    words = _words(text)
    index = 0
    while index < len(words):
        read = _time(words, index)
        if read is None:
            index += 1
            continue
        begin = words[index].start()
        kept.append(text[end:begin] + f" {MARK} ")
        end = words[read[1] - 1].end()
        found.append(text[begin:end])
        index = read[1]
    return "".join([*kept, text[end:]]), tuple(found)


def time_span(text: str, now: float, zone: tzinfo | None = None) -> TimeSpan:
    """The stretch of time that a text means at time `now` (s), such as `last Tuesday between 3 and 4 pm`.

    A day of the week is the last one before today, a date without a year the last one until today, and a time of day
    without a day the last one until now. What has not passed yet ends now.

    Raises:
        ConfigError: for other words, a day that the calendar does not have, and what lies in the future.
    """
    low = text.lower()
    words = _words(low)
    read = _time(words, 0) if words else None
    if read is None or read[1] != len(words):
        example = "yesterday, last Tuesday, this morning, on 12 November, two days ago, between 3 and 4 pm"
        raise ConfigError(f"time {text!r}: expected one such as {example}")
    try:
        begin, end = _resolved(read[0], now, zone)
    except (ValueError, OverflowError, OSError) as error:
        raise ConfigError(f"time {text!r}: {error}") from error
    if not begin >= 0.0:
        raise ConfigError(f"time {text!r} is before all that anybody remembers")
    if begin > now:
        raise ConfigError(f"time {text!r} lies in the future")
    return TimeSpan(begin, now if read[0].since else min(end, now), text)


def moment_words(time: float, now: float, zone: tzinfo | None = None) -> str:
    """A time (s) in words, as of `now` (s): `at 14:05`, `yesterday at 14:05`, `on Tuesday 24 November at 14:05`."""
    then, today = datetime.fromtimestamp(time, zone), datetime.fromtimestamp(now, zone).date()
    days = (today - then.date()).days
    if days == 0:
        return f"at {then:%H:%M}"
    if days == 1:
        return f"yesterday at {then:%H:%M}"
    return f"on {day_words(time, now, zone)} at {then:%H:%M}"


def span_words(begin: float, end: float, now: float, zone: tzinfo | None = None) -> str:
    """A stretch of time in words, as of `now` (s): `yesterday from 10:00 until 15:00`; of the last moment `now`."""
    first, last = datetime.fromtimestamp(begin, zone), datetime.fromtimestamp(end, zone)
    until = "now" if end >= now else f"{last:%H:%M}"
    days = (datetime.fromtimestamp(now, zone).date() - first.date()).days
    day = "today" if days == 0 else "yesterday" if days == 1 else f"on {day_words(begin, now, zone)}"
    if first.date() == last.date() or end >= now:
        return f"{day} from {first:%H:%M} until {until}"
    midnight = first.date() + timedelta(days=1) == last.date() and f"{last:%H:%M}" == "00:00"
    return f"{day} from {first:%H:%M} until {'midnight' if midnight else moment_words(end, now, zone)}"


def day_words(time: float, now: float, zone: tzinfo | None = None) -> str:
    """The day of a time: `Tuesday 24 November`, with the year if that is another one."""
    then, today = datetime.fromtimestamp(time, zone), datetime.fromtimestamp(now, zone)
    year = "" if then.year == today.year else f" {then.year}"
    return f"{WEEKDAYS[then.weekday()].capitalize()} {then.day} {MONTHS[then.month - 1].capitalize()}{year}"


def _words(text: str) -> list[re.Match[str]]:
    return list(_WORD.finditer(text))


def _at(words: list[re.Match[str]], index: int) -> str:
    """The word there without a full stop behind it; empty beyond the end."""
    return words[index][0].rstrip(".:;") if index < len(words) else ""


def _time(words: list[re.Match[str]], index: int) -> _Read:
    """A time that begins at a word, and the index behind it."""
    since = _at(words, index) == "since"
    at = index + 1 if since else index
    if _at(words, at) == "ever":
        return _Said(lately=math.inf, since=since), at + 1
    read = _relative(words, at)
    if read is None:
        said, end = _Said(), at
        while (more := _more(words, end, said)) is not None:
            said, end = more
        read = None if end == at else (said, end)
    return None if read is None else (read[0]._replace(since=since), read[1])


def _more(words: list[re.Match[str]], index: int, said: _Said) -> _Read:
    """One more part of a time, of those that are not said yet."""
    if said.clock is None and (clock := _clock(words, index, bool(said.day or said.part))) is not None:
        return said._replace(clock=clock[0]), clock[1]
    if not said.part and (part := _part(words, index, bool(said.day))) is not None:
        return (part[0] if said.day is None else part[0]._replace(day=said.day))._replace(clock=said.clock), part[1]
    if said.day is None and (day := _day(words, index)) is not None:
        return said._replace(day=day[0].day), day[1]
    return None


def _relative(words: list[re.Match[str]], index: int) -> _Read:
    """`2 hours ago`, `half an hour ago`, `in the last five minutes`, `three days ago`."""
    if _at(words, index) in ("in", "within", "during", "over", "for"):
        at = index + 1 + (_at(words, index + 1) == "the")
        if _at(words, at) not in ("last", "past"):
            return None
        number, at = _number(words, at + 1)
        unit = _at(words, at)
        seconds = _UNITS.get(unit) or 86400.0 * _DAYS.get(unit, 0)
        return (_Said(lately=seconds * (1.0 if number is None else number)), at + 1) if seconds else None
    number, at = _number(words, index)
    unit = _at(words, at)
    if number is None or _at(words, at + 1) != "ago":
        return None
    if unit in _UNITS:
        return _Said(ago=number * _UNITS[unit]), at + 2
    if unit in _DAYS and number.is_integer():
        return _with_clock(_Said(day=_Day("before", int(number) * _DAYS[unit])), words, at + 2)
    return None


def _with_clock(said: _Said, words: list[re.Match[str]], index: int) -> _Read:
    while (more := _more(words, index, said)) is not None:
        said, index = more
    return said, index


def _number(words: list[re.Match[str]], index: int) -> tuple[float | None, int]:
    """A number in digits or words, and the index behind it; `half an hour` is half of one."""
    word = _at(words, index)
    number = NUMBERS.get(word)
    if number is None and re.fullmatch(r"\d+(\.\d+)?", word):
        number = float(word)
    if number is None:
        return None, index
    return number, index + 1 + (word == "half" and _at(words, index + 1) in ("a", "an"))


def _day(words: list[re.Match[str]], index: int) -> _Read:
    word, following = _at(words, index), _at(words, index + 1)
    if word in ("today", "yesterday"):
        return _Said(day=_Day("before", int(word == "yesterday"))), index + 1
    if [_at(words, at) for at in range(index, index + 4)] == ["the", "day", "before", "yesterday"]:
        return _Said(day=_Day("before", 2)), index + 4
    if word in ("last", "this") and following in ("week", "month"):
        return _Said(day=_Day(following, int(word == "last"))), index + 2
    led = word in ("on", "last", "this", "from", "of")
    at = index + led + (word == "on" and following in ("last", "the"))
    if _at(words, at) in WEEKDAYS:
        return _Said(day=_Day("weekday", WEEKDAYS.index(_at(words, at)))), at + 1
    return _date(words, at) if word == "on" or not led else None


def _date(words: list[re.Match[str]], index: int) -> _Read:
    """`12 November`, `12th of November 2026`, `November 12`, `2026-11-12`."""
    if found := re.fullmatch(r"(\d{4})-(\d\d)-(\d\d)", _at(words, index)):
        return _Said(day=_Day("date", *map(int, found.groups()))), index + 1
    at, number, month = index, 0, 0
    for _ in range(2):
        word = _at(words, at)
        if not month and word in _MONTHS:
            month, at = _MONTHS[word], at + 1
        elif not number and word.isdecimal() and int(word) <= 31:
            number, at = int(word), at + 1
            at += _at(words, at) in ("st", "nd", "rd", "th")
            at += not month and _at(words, at) == "of"
    if not (month and number):
        return None
    year = _at(words, at)
    is_year = re.fullmatch(r"\d{4}", year) is not None
    return _Said(day=_Day("date", int(year) if is_year else 0, month, number)), at + is_year


def _part(words: list[re.Match[str]], index: int, has_day: bool) -> _Read:
    """`this morning`, `tonight`, `last night`; behind a day also `morning`."""
    word, following = _at(words, index), _at(words, index + 1)
    if word == "tonight":
        return _Said(part="night", day=_Day("before")), index + 1
    if word == "last" and following == "night":
        return _Said(part="night", day=_Day("before", 1)), index + 2
    if word == "this" and following in _PARTS:
        return _Said(part=following, day=_Day("before")), index + 2
    if word == "in" and following == "the" and _at(words, index + 2) in _PARTS:
        return _Said(part=_at(words, index + 2)), index + 3
    if has_day and word in _PARTS:
        return _Said(part=word), index + 1
    return None


def _clock(words: list[re.Match[str]], index: int, has_day: bool) -> tuple[_Clock, int] | None:
    """`at 3 pm`, `at 15:30`, `at noon`, `between 3 and 4 pm`, `after 3 pm`; behind `since` also `3 pm`."""
    word = _at(words, index)
    if word in ("between", "from"):
        return _range(words, index + 1, ("and",) if word == "between" else ("to", "until", "till"), has_day)
    is_led = word in ("at", "around", "about", "after", "before")
    if not is_led and (index == 0 or _at(words, index - 1) != "since"):
        return None
    read = _hour(words, index + is_led)
    if read is None or not read[1]:
        return None
    hour, _, end = read
    if word == "after":
        return _Clock(hour, float("inf")), end
    return _Clock(0.0 if word == "before" else hour, hour if word == "before" else None), end


def _range(
    words: list[re.Match[str]], index: int, joints: tuple[str, ...], has_day: bool
) -> tuple[_Clock, int] | None:
    first = _hour(words, index)
    if first is None or _at(words, first[2]) not in joints:
        return None
    second = _hour(words, first[2] + 1)
    if second is None:
        return None
    has_day = has_day or _day(words, second[2]) is not None or _part(words, second[2], False) is not None
    if not (first[1] or second[1] or has_day):
        return None
    begin, end = first[0], second[0]
    if not first[1] and second[1] and begin < 12.0 <= end and begin + 12.0 <= end:
        begin += 12.0  # between 3 and 4 pm: both are
    return (_Clock(begin, end), second[2]) if begin < end else None


def _hour(words: list[re.Match[str]], index: int) -> tuple[float, bool, int] | None:
    """Hours since midnight, whether it is certain that a time of day is meant, and the index behind it."""
    word, half = _at(words, index), _at(words, index + 1)
    if word in ("noon", "midnight"):
        return 12.0 * (word == "noon"), True, index + 1
    found = re.fullmatch(r"(\d{1,2})(?::(\d\d))?", word)
    if found is None:
        return None
    hour, minutes = int(found[1]), int(found[2] or 0)
    if half.replace(".", "") in ("am", "pm") and 1 <= hour <= 12:
        return hour % 12 + 12 * half.startswith("p") + minutes / 60.0, True, index + 2
    if hour > 24 or minutes > 59:
        return None
    return hour + minutes / 60.0, found[2] is not None or half == "o'clock", index + 1 + (half == "o'clock")


def _resolved(said: _Said, now: float, zone: tzinfo | None) -> tuple[float, float]:
    """Begin and end, s."""
    if said.ago is not None:
        return now - said.ago, now - said.ago
    if said.lately is not None:
        return 0.0 if math.isinf(said.lately) else now - said.lately, now
    today = datetime.fromtimestamp(now, zone).date()
    begin, end = _days(said.day, today)
    if said.clock is None and not said.part:
        return _stamp(begin, 0.0, zone), _stamp(end, 0.0, zone)
    first, last = (0.0, 24.0) if not said.part else map(float, _PARTS[said.part])
    if said.clock is not None:
        late = 12.0 if said.part in ("afternoon", "evening") and said.clock.begin < 12.0 else 0.0
        first = said.clock.begin + late
        last = first if said.clock.end is None else min(said.clock.end + late, 24.0)
    if said.day is None and _stamp(today, first, zone) > now:
        begin -= timedelta(days=1)
    return _stamp(begin, first, zone), _stamp(begin, last, zone)


def _days(day: _Day | None, today: date) -> tuple[date, date]:
    """The first day, and the one behind the last; today if none is said."""
    said = day or _Day("before")
    if said.kind == "week":
        begin = today - timedelta(days=today.weekday() + 7 * said.number)
        return begin, begin + timedelta(days=7)
    if said.kind == "month":
        end = today.replace(day=1)
        before = (end - timedelta(days=1)).replace(day=1)
        return (before, end) if said.number else (end, today + timedelta(days=1))
    if said.kind == "weekday":
        begin = today - timedelta(days=(today.weekday() - said.number - 1) % 7 + 1)
    elif said.kind == "date":
        begin = _date_of(said, today)
    else:
        begin = today - timedelta(days=said.number)
    return begin, begin + timedelta(days=1)


def _date_of(said: _Day, today: date) -> date:
    """A date; without a year the last such until today. Raises `ValueError` for one that no calendar has."""
    if said.number:
        return date(said.number, said.month, said.day)
    date(2000, said.month, said.day)
    for year in range(today.year, today.year - 9, -1):
        try:
            found = date(year, said.month, said.day)
        except ValueError:  # 29 February
            continue
        if found <= today:
            return found
    raise ValueError("there was no such day lately")


def _stamp(day: date, hours: float, zone: tzinfo | None) -> float:
    """The time (s) of hours since midnight, as a clock on the wall shows them."""
    days, hours = divmod(hours, 24.0)
    minutes = round(hours * 60.0)
    wall = datetime(day.year, day.month, day.day, minutes // 60, minutes % 60, tzinfo=zone) + timedelta(days=days)
    return wall.timestamp()
