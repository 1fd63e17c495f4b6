"""The page in words: the sentences of `dsr tell`, about once a second."""

from __future__ import annotations

from typing import Any

from agents.assistant.acting import Acts
from agents.viewer.proposals import ProposalsWatch
from agents.viewer.told import PAGE, told_page
from dsr.narration import Moment, account
from dsr.vocabulary.proposed_acts import ACTS_SERVICE


def fill(stage: Any) -> None:
    memory = stage.memory
    memory.add_node("gripper", "gripper")
    memory.add_node("cube_3", "cube", perceived=False, last_seen=stage.clock.now())
    memory.add_node("cube_4", "cube")
    memory.add_edge("cube_3", "cube_4", "on")


def test_the_page_holds_every_sentence_and_beliefs_in_italics(stage: Any) -> None:
    fill(stage)
    page = told_page(Moment.of(stage.memory), [])
    assert page.splitlines()[0] == "**Where things are**"
    assert r"*cube\_3 is believed to rest on cube\_4: unseen for 0.0 s.*" in page
    assert "\ngripper holds nothing." in page
    assert page.count("\n\n") == len(account(Moment.of(stage.memory))) + 1


def test_nothing_is_known_at_first(stage: Any) -> None:
    assert told_page(Moment.of(stage.memory), []) == "*Nothing is known.*"


def test_the_viewer_logs_the_page_once_a_second(stage: Any) -> None:
    fill(stage)
    stage.start_viewer()
    stage.run(3.0)
    pages = stage.finish().values(f"/{PAGE}", "TextDocument:text")
    assert 3 <= len(pages) <= 4 and "gripper holds nothing" in pages[-1][0]


def test_what_an_assistant_proposes_stands_first_until_it_is_decided(stage: Any) -> None:
    memory, acts = stage.memory, Acts(stage.memory.clock)
    service = memory.transport.serve(memory.keys.service(ACTS_SERVICE), lambda _key, payload: acts.answer(payload))
    act = acts.propose("mission: on(a,b) `rm -rf` [x](y)", ["The robot would bring about: *a* on b."], lambda: "begun")
    stage.start_viewer()
    stage.run(3.0)
    acts.decide(act.id, accept=False, shown="")
    stage.run(5.0)
    service.close()
    pages = [page for (page,) in stage.finish().values(f"/{PAGE}", "TextDocument:text")]
    shown = [page for page in pages if page.startswith("**An assistant proposes")]
    assert shown and f"`dsr assist confirm {act.id}`" in shown[0] and "void in" in shown[0]
    assert r"\`rm \-rf\` \[x\]" in shown[0] or r"\`rm -rf\` \[x\]" in shown[0]
    assert "An assistant proposes" not in pages[-1]


def test_answers_that_are_no_proposals_are_dropped(stage: Any) -> None:
    memory, watch = stage.memory, ProposalsWatch()
    service = memory.transport.serve(memory.keys.service(ACTS_SERVICE), lambda _key, _payload: b"nonsense")
    assert watch.waiting(memory, 0.0) == []
    stage.run(1.0)
    assert watch.waiting(memory, 2.0) == []
    service.close()
