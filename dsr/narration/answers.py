"""Answers questions from the memory, each with evidence: what is read in a question is asked of graph and timeline."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec

from dsr.errors import DsrError
from dsr.imagining import Thought
from dsr.narration import deeds, present, properties, retrospect, staying
from dsr.narration.answer import Response, understood
from dsr.narration.grammar import EXAMPLES, TIMED
from dsr.narration.groups import ambiguous_in, answer_of_each, several_in
from dsr.narration.naming import UnknownNameError
from dsr.narration.questions import Misunderstanding, Query, parse_questions, similar_questions
from dsr.narration.statements import Moment
from dsr.narration.supposing import supposed
from dsr.vocabulary.relations import THINGS
from dsr.vocabulary.what_if import Answer

_ANSWERS: dict[str, Callable[[Moment, Query], Response]] = {
    "where": retrospect.where_at, "where_in": retrospect.where_at, "where_by": present.where_by,
    "contents": present.contents, "contents_by": present.contents_by, "is_so": present.is_so,
    "is_so_by": present.is_so_by,
    "knows": present.knows, "is_wrong": present.is_wrong, "is_there": present.is_there, "sees": present.sees,
    "is_visible": present.is_visible, "who_sees": present.who_sees, "what_sees": present.what_sees,
    "hides": present.hides, "holder": present.holder, "held": present.held, "is_holding": present.is_holding,
    "wants": present.wants, "doing": present.wants, "why_waits": present.wants, "count": present.which,
    "which": present.which, "last_seen": retrospect.last_seen,
    "last_seen_by": retrospect.last_seen_by, "when_was": retrospect.when_was, "since_when": retrospect.since_when,
    "how_long": retrospect.last_seen, "how_long_so": retrospect.since_when, "why_so": retrospect.why_so,
    "why_state": retrospect.why_state, "why_moved": retrospect.why_moved, "happened": deeds.happened,
    "who_did": deeds.who_did, "did_any": deeds.did_any, "was_done": deeds.was_done, "surprises": deeds.surprises,
    "any_so": present.any_so, "what_unseen": properties.what_unseen, "sure": properties.sure,
    "where_else": properties.where_else,
    "closest": properties.closest, "property": properties.property_of, "distance": properties.distance,
    "was_so": present.was_so, "any_sees": present.any_sees, "is_empty": present.is_empty,
    "any_state": properties.which_state, "which_state": properties.which_state, "unmoved": staying.unmoved,
    "how_long_there": staying.how_long_there, "why_not_so": staying.why_not_so, "did_by": deeds.did_by,
    "when_did": deeds.when_did, "which_did": deeds.which_did, "last_done": deeds.which_did,
    "deeds_of": deeds.deeds_of, "any_did": deeds.any_did, "has_seen": retrospect.has_seen,
    "any_held": present.any_held, "any_seen": present.any_seen, "extreme": properties.extreme,
    "which_on": properties.which_on, "any_on": properties.which_on,
}  # fmt: skip
"""Who answers each kind of question of the grammar; what-if questions are answered by a simulation."""


def answer(moment: Moment, question: str) -> Thought[Response]:
    """Answer a question in plain English: a generator that may ask the simulation handler, and ends with the response.

    Drive it with `dsr.imagining.think` in a script, with `Thinking` in an agent, or with `answer_alone` where no
    simulation handler can be asked. What is not understood is no error: the response says which part that is.
    """
    responses = []
    for query in parse_questions(question):
        responses.append((yield from _answered(moment, query, question)))
    if len(responses) == 1:
        return responses[0]
    told = [one for response in responses for one in response.evidence]
    whole = understood(
        " ".join(response.text for response in responses), told, question=question,
        names=dict.fromkeys(name for response in responses for name in response.names),
    )  # fmt: skip
    wrong = next((response for response in responses if not response.understood), None)
    if wrong is not None:
        whole = msgspec.structs.replace(whole, understood=False, part=wrong.part, similar=wrong.similar)
    return msgspec.structs.replace(whole, parts=tuple(responses))


def _answered(moment: Moment, query: Query | Misunderstanding, question: str) -> Thought[Response]:
    """Answer one of the questions that there are in a text."""
    if isinstance(query, Misunderstanding):
        similar = _with_names(moment, query.similar)
        return Response(question=question, text=query.why, part=query.part, similar=similar)
    said = query.when or (query.at if query.at is not None else query.since)
    if said is not None and said != "" and query.kind not in TIMED:
        text = f"That can be told of now only, not of {said!r}."
        similar = _with_names(moment, (EXAMPLES["where_then"],))
        return Response(question=question, text=text, part=str(said), similar=similar)
    try:
        if query.kind in ("what_if", "would"):
            response = yield from supposed(moment, query)
        else:
            response = _of_each(moment, query)
    except UnknownNameError as error:
        similar = _with_names(moment, similar_questions(question))
        return Response(question=question, text=f"Not understood: {error}.", part=error.asked, similar=similar)
    except DsrError as error:
        return understood(f"That cannot be told: {error}.", question=question)
    return msgspec.structs.replace(response, question=question)


def _of_each(moment: Moment, query: Query) -> Response:
    """Answer a question; one about several things for each of them."""
    several = several_in(moment, query)
    if several is None:
        try:
            return _ANSWERS[query.kind](moment, query)
        except UnknownNameError as error:
            several = ambiguous_in(error, query)
            if several is None:
                raise
            found = answer_of_each(query, several, lambda one: _of_each(moment, one))
            if found.verdict is None:
                raise
            return found
    return answer_of_each(query, several, lambda one: _of_each(moment, one))


def answer_alone(moment: Moment, question: str, why: str) -> Response:
    """Answer a question where no simulation handler can be asked: what-if questions are answered with `why` not."""
    thought = answer(moment, question)
    try:
        next(thought)
        while True:
            thought.send(Answer(refused=why))
    except StopIteration as stop:
        response: Response = stop.value
        return response


def example_questions(moment: Moment) -> tuple[str, ...]:
    """A question of each kind, about things of this memory."""
    return _with_names(moment, EXAMPLES.values())


def _with_names(moment: Moment, questions: Iterable[str]) -> tuple[str, ...]:
    """Examples with names that the memory knows, where it knows any."""
    things = sorted(node.name for node in moment.memory.nodes(THINGS)) or ["cube_3"]
    persons = sorted(node.name for node in moment.memory.nodes("person")) or ["sally"]
    return tuple(
        one.replace("THING", things[0]).replace("OTHER", things[-1]).replace("PERSON", persons[0]) for one in questions
    )
