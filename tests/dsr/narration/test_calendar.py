"""Times as people say them, on a calendar with changes of the clocks."""

from __future__ import annotations

from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr.errors import ConfigError
from dsr.narration.calendar import (
    MARK,
    TimeSpan,
    day_words,
    moment_words,
    span_words,
    time_span,
    without_times,
    zone_of,
)

MADRID = zone_of("Europe/Madrid")


def at(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=MADRID).timestamp()


NOW = at("2026-11-26 15:20")
"""A Thursday."""


def bounds(words: str, now: float = NOW) -> tuple[str, str]:
    span = time_span(words, now, MADRID)
    told = [datetime.fromtimestamp(time, MADRID).strftime("%Y-%m-%d %H:%M") for time in (span.begin, span.end)]
    return told[0], told[1]


@pytest.mark.parametrize(
    ("words", "begin", "end"),
    [
        ("today", "2026-11-26 00:00", "2026-11-26 15:20"),
        ("yesterday", "2026-11-25 00:00", "2026-11-26 00:00"),
        ("the day before yesterday", "2026-11-24 00:00", "2026-11-25 00:00"),
        ("last Tuesday", "2026-11-24 00:00", "2026-11-25 00:00"),
        ("on Thursday", "2026-11-19 00:00", "2026-11-20 00:00"),
        ("this morning", "2026-11-26 05:00", "2026-11-26 12:00"),
        ("yesterday evening", "2026-11-25 18:00", "2026-11-26 00:00"),
        ("last night", "2026-11-25 18:00", "2026-11-26 06:00"),
        ("on 12 November", "2026-11-12 00:00", "2026-11-13 00:00"),
        ("on the 12th of November 2025", "2025-11-12 00:00", "2025-11-13 00:00"),
        ("December 24", "2025-12-24 00:00", "2025-12-25 00:00"),
        ("2026-11-12", "2026-11-12 00:00", "2026-11-13 00:00"),
        ("two days ago", "2026-11-24 00:00", "2026-11-25 00:00"),
        ("a week ago", "2026-11-19 00:00", "2026-11-20 00:00"),
        ("three days ago at 3 pm", "2026-11-23 15:00", "2026-11-23 15:00"),
        ("half an hour ago", "2026-11-26 14:50", "2026-11-26 14:50"),
        ("between 3 and 4 pm", "2026-11-26 15:00", "2026-11-26 15:20"),
        ("between 3 and 4 pm on Tuesday", "2026-11-24 15:00", "2026-11-24 16:00"),
        ("between 11 and 12 on Friday", "2026-11-20 11:00", "2026-11-20 12:00"),
        ("between 11 and 1 pm", "2026-11-26 11:00", "2026-11-26 13:00"),
        ("yesterday from 15:00 to 16:30", "2026-11-25 15:00", "2026-11-25 16:30"),
        ("at 4 pm", "2026-11-25 16:00", "2026-11-25 16:00"),
        ("at 3pm", "2026-11-26 15:00", "2026-11-26 15:00"),
        ("after 3 pm yesterday", "2026-11-25 15:00", "2026-11-26 00:00"),
        ("last week", "2026-11-16 00:00", "2026-11-23 00:00"),
        ("last month", "2026-10-01 00:00", "2026-11-01 00:00"),
        ("since yesterday", "2026-11-25 00:00", "2026-11-26 15:20"),
        ("since noon", "2026-11-26 12:00", "2026-11-26 15:20"),
        ("since 3 pm yesterday", "2026-11-25 15:00", "2026-11-26 15:20"),
        ("in the last two hours", "2026-11-26 13:20", "2026-11-26 15:20"),
        ("29 February", "2024-02-29 00:00", "2024-03-01 00:00"),
        ("last Tuesday at noon", "2026-11-24 12:00", "2026-11-24 12:00"),
    ],
)
def test_what_words_mean(words: str, begin: str, end: str) -> None:
    assert bounds(words) == (begin, end)


@pytest.mark.parametrize(
    "words",
    ["", "soon", "tonight", "on 31 June", "on 12 November 2031", "yesterday maybe", "999999999 days ago", "at 25:00"],
)  # fmt: skip
def test_what_means_no_time_of_the_past_is_refused(words: str) -> None:
    with pytest.raises(ConfigError, match="time"):
        time_span(words, NOW, MADRID)


def test_days_on_which_the_clocks_change_are_shorter_and_longer() -> None:
    lengths = {"on 29 March": 23.0, "on 25 October": 25.0, "on 26 October": 24.0}
    for words, hours in lengths.items():
        span = time_span(words, NOW, MADRID)
        assert span.end - span.begin == hours * 3600.0, words
    noon = time_span("on 25 October at noon", NOW, MADRID).begin
    assert noon - time_span("on 24 October at noon", NOW, MADRID).begin == 25.0 * 3600.0
    assert bounds("yesterday", at("2026-03-30 00:30")) == ("2026-03-29 00:00", "2026-03-30 00:00")


def test_the_zone_decides_which_day_it_is() -> None:
    night = at("2026-11-26 00:30")
    assert time_span("today", night, MADRID).begin - time_span("today", night, zone_of("UTC")).begin == 23.0 * 3600.0
    assert zone_of(None) is None
    for nonsense in ("Nowhere/Land", "../etc/passwd", ""):
        with pytest.raises(ConfigError, match="no time zone"):
            zone_of(nonsense)


def test_times_are_found_in_questions() -> None:
    assert without_times("where was the cup last tuesday, and who moved it?")[1] == ("last tuesday",)
    assert without_times("where was it between 3 and 4 pm yesterday")[1] == ("between 3 and 4 pm yesterday",)
    for untimed in ("where was it at 9 s?", "what may cup_1 do on the table", "is march_cup on the second cup"):
        assert without_times(untimed) == (untimed, ())


def test_times_in_words() -> None:
    assert moment_words(at("2026-11-26 14:05"), NOW, MADRID) == "at 14:05"
    assert moment_words(at("2026-11-25 14:05"), NOW, MADRID) == "yesterday at 14:05"
    assert moment_words(at("2025-11-24 14:05"), NOW, MADRID) == "on Monday 24 November 2025 at 14:05"
    assert day_words(NOW, NOW, MADRID) == "Thursday 26 November"
    day = at("2026-11-24 00:00")
    assert span_words(day, day + 36000.0, NOW, MADRID) == "on Tuesday 24 November from 00:00 until 10:00"
    assert span_words(day, day + 86400.0, NOW, MADRID) == "on Tuesday 24 November from 00:00 until midnight"
    assert span_words(day, NOW, NOW, MADRID) == "on Tuesday 24 November from 00:00 until now"


@given(st.text(max_size=60), st.floats(0.0, 4e9))
def test_any_text_is_a_time_or_an_error(text: str, now: float) -> None:
    marked, times = without_times(text.lower())
    assert marked.count(MARK) >= len(times)
    try:
        span = time_span(text, now, MADRID)
    except ConfigError:
        return
    assert isinstance(span, TimeSpan) and span.begin <= span.end <= now


_SAID = """since on the last this tuesday yesterday morning night between from 3 and to 4 pm am at 15:30 12 november may
2026 two days hours ago week in noon half an before after of st tonight"""
_WORDS = st.sampled_from(_SAID.split())


@given(st.lists(_WORDS, max_size=9).map(" ".join), st.floats(1e9, 2e9))
def test_any_words_of_time_are_a_time_or_an_error(text: str, now: float) -> None:
    try:
        span = time_span(text, now, MADRID)
    except ConfigError:
        return
    assert span.begin <= span.end <= now
