"""Questions about days that only summaries remember."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dsr import ManualClock, Memory
from dsr.narration import Basis, Moment, account
from dsr.narration.answer import Response
from dsr.narration.answers import answer_alone
from dsr.narration.calendar import zone_of
from dsr.timeline import SUMMARY, Chronicle, Consolidator
from dsr.timeline.recall import stored_summaries
from dsr.timeline.remembered import PeriodSummary, encoded_summary
from tests.dsr.narration.conftest import make_memory

ZONE = zone_of("Europe/Madrid")
DAY = 86400.0
MONDAY = 1_763_938_800.0
"""s, Monday 24 November 2025, 0:00 in Madrid"""


class House:
    """A cup that goes from a table to a shelf and back each working day, and days that go by."""

    def __init__(self) -> None:
        self.memory: Memory = make_memory()
        assert isinstance(self.memory.clock, ManualClock)
        self.clock = self.memory.clock
        self.chronicle = Chronicle(self.memory, "chronicler")
        self.consolidator = Consolidator(self.memory)
        for name, kind in (("table", "table"), ("shelf", "table"), ("cup", "cup"), ("ball", "ball")):
            self.memory.add_node(name, kind)

    def at(self, day: int, hour: float) -> None:
        """Go to an hour of a day after `MONDAY`, and let the timeline be looked after each hour until then."""
        until = MONDAY + day * DAY + hour * 3600.0
        while self.clock.now() < until:
            self.clock.advance_to(min(until, max(MONDAY, self.clock.now() + 3600.0)))
            self.consolidator.consolidate()
            self.chronicle.forget()

    def move(self, thing: str, old: str, new: str, who: str) -> None:
        for entry in self.chronicle.query(kind="on", participants=(thing, old), open=True):
            self.chronicle.end(entry.name)
        self.chronicle.happened("Pick", (thing, who), confidence=0.95)
        self.chronicle.begin("on", (thing, new), source="contact")

    def ask(self, question: str) -> Response:
        return answer_alone(Moment(self.memory, self.clock.now(), zone=ZONE), question, "nobody simulates")


@pytest.fixture(scope="module")
def house() -> Iterator[House]:
    """It is Wednesday 3 December, 11:00. On Tuesday 25 November ben moved the cup, on all other days anne."""
    house = House()
    house.at(0, 0.0)
    house.move("cup", "", "table", "anne")
    house.chronicle.begin("on", ("lost_key", "shelf"), source="contact")
    for day in range(9):
        who = "ben" if day == 1 else "anne"
        house.at(day, 10.0)
        house.move("cup", "table", "shelf", who)
        house.at(day, 15.5)
        house.move("cup", "shelf", "table", who)
        if day == 2:
            house.chronicle.happened("explained", "cup", explanation="moved(cup)", text="moved(cup)")
    house.at(9, 11.0)
    assert len(house.memory.nodes(SUMMARY)) > 5
    yield house


@pytest.mark.parametrize(
    ("question", "names"),
    [
        ("where was the cup last Tuesday?", ("table", "shelf")),
        ("where was the cup on 25 November at noon?", ("shelf",)),
        ("where was the cup yesterday at 4 pm", ("table",)),
        ("where was the cup between 11 and 12 on Friday", ("shelf",)),
        ("who moved the cup on 25 November?", ("ben",)),
        ("who took the cup yesterday?", ("anne",)),
        ("what was on the shelf on 25 November at 11:00", ("cup", "lost_key")),
        ("where was the lost key yesterday", ("shelf",)),
        ("where is the cup, and who moved it on 25 November?", ("ben",)),
        ("what was surprising on 26 November?", ("cup",)),
    ],
)
def test_the_past_is_answered_from_summaries(house: House, question: str, names: tuple[str, ...]) -> None:
    response = house.ask(question)
    assert response.understood and set(names) <= set(response.names), response
    assert len(response.names) == len(names), response


def test_where_and_who_in_one_question(house: House) -> None:
    response = house.ask("Where was the cup last Tuesday, and who moved it?")
    where, who = response.parts
    assert where.names == ("table", "shelf") and who.names == ("anne",)
    assert where.basis is Basis.BELIEVED and who.confidence == 0.95
    assert "cup rested on shelf" in where.text and "from 10:00 until 15:30" in where.text
    assert "remembered to within" in house.ask("where was the cup on 25 November").text


@pytest.mark.parametrize(
    ("question", "verdict"),
    [
        ("was the cup on the shelf yesterday?", True),
        ("was the cup on the shelf yesterday at 7 pm?", False),
        ("did anybody move the cup on 25 November?", True),
        ("did anybody move the ball yesterday?", False),
        ("was the cup picked up on Friday?", True),
    ],
)
def test_yes_and_no_of_the_past(house: House, question: str, verdict: bool) -> None:
    assert house.ask(question).verdict is verdict


def test_when_in_a_time(house: House) -> None:
    response = house.ask("when was the cup picked up on 25 November?")
    assert response.time == pytest.approx(MONDAY + DAY + 15.5 * 3600.0, abs=60.0)
    assert "on Tuesday 25 November at 15:30" in response.text.replace("On", "on")


def test_what_happened_yesterday_and_since(house: House) -> None:
    response = house.ask("what happened yesterday?")
    assert "anne picked cup up" in response.text and "ben" not in response.text
    told = account(Moment(house.memory, house.clock.now(), zone=ZONE), since=MONDAY, about=["cup"])
    assert any("ben picked cup up" in one.text for one in told)
    assert all(one.basis in (Basis.BELIEVED, Basis.OWN) for one in told if one.time is not None)


@pytest.mark.parametrize(
    ("question", "words"),
    [
        ("what does sally see yesterday", "of now only"),
        ("where was the cup tomorrow", "tomorrow"),
        ("where was the cup on 31 November", "31 november"),
        ("where was the cup tonight", "future"),
        ("where was the cup on 3 March", "does not tell"),
        ("where was the cup at 9 s", "ask for 9 s ago"),
    ],
)
def test_what_cannot_be_told(house: House, question: str, words: str) -> None:
    response = house.ask(question)
    assert words in response.text and not response.names


def test_of_many_things_the_newest_are_told_and_the_rest_is_counted(house: House) -> None:
    response = house.ask("what happened since 25 November?")
    assert len(response.evidence) > 20 and "more things happened, with cup" in response.text
    newest = response.evidence[-1].text
    assert newest in response.text and "the robot concluded" in response.text
    assert sum(one.text in response.text for one in response.evidence) < 20


@pytest.mark.parametrize("time", [9e11, -9e11, 2.6e11])
def test_times_that_no_calendar_has_are_passed_over(time: float) -> None:
    """Whoever may write events could end every account of the past otherwise."""
    house = House()
    house.at(3, 12.0)
    house.memory.add_node("event_evil", "event", kind="Pick", participants="cup,somebody", time=time)
    house.memory.add_node("situation_evil", "situation", kind="on", participants="cup,somebody", begin=time)
    house.memory.add_node("situation_odd", "situation", kind="on", participants="cup,shelf", begin=9.0, end=time)
    house.memory.add_node("summary_evil", SUMMARY, kind="day", order=2**60, content=encoded_summary(PeriodSummary()))
    for question in ("what happened yesterday?", "where was the cup yesterday?", "when was the cup picked up?"):
        assert "somebody" not in house.ask(question).text
    moment = Moment(house.memory, house.clock.now(), zone=ZONE)
    assert "somebody" not in " ".join(statement.text for statement in account(moment, since=0.0))
    house.consolidator.consolidate()
    assert all(stored.name != "summary_evil" for stored in stored_summaries(house.memory))
