"""Reads questions in plain English by a small grammar; what is not understood is told, with similar questions."""

from __future__ import annotations

import difflib
import re
from functools import cache
from typing import Any, NamedTuple

import msgspec
from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

_WORDS = {
    "BE": "is are was were be being been", "DO": "do does did", "CAN": "can could", "WILL": "will would",
    "HAS": "has have had", "WHERE": "where", "WHAT": "what which", "WHO": "who", "WHEN": "when", "WHY": "why",
    "HOW": "how", "LONG": "long", "MANY": "many", "IF": "if", "THERE": "there", "AGO": "ago", "AT": "at",
    "SINCE": "since", "LAST": "last", "LATELY": "lately recently", "NOW": "now currently",
    "DET": "the a an my your this that", "ON": "on onto upon", "IN": "in into inside within",
    "UNDER": "under beneath underneath", "BY": "by", "TO": "to", "OF": "of", "FOR": "for", "NOT": "not",
    "ABOVE": "above over", "BELOW": "below", "NEAR": "near beside", "NEXT": "next", "SEE": "see sees seeing",
    "SEEN": "seen", "VISIBLE": "visible", "UNSEEN": "unseen hidden invisible", "HIDE": "hide hides hiding",
    "HOLD": "hold holds holding", "HELD": "held", "THINK": "think thinks believe believes",
    "BELIEVED": "believed thought", "KNOW": "know knows", "LOOK": "look search", "WRONG": "wrong mistaken",
    "SURPRISING": "surprising surprised", "GONE": "gone missing", "WANT": "want wants", "WAIT": "wait waits waiting",
    "DOING": "doing", "GOAL": "goal mission task plan", "HAPPEN": "happen happens happened",
    "MOVE": "move moves moved", "FALL": "fall falls fell fallen", "STAY": "stay stays stand stands",
    "REST": "rest rests lie lies", "APPEAR": "appear appeared", "VANISH": "disappear disappeared vanish vanished",
    "PICK": "pick picked take took taken lift lifted grab grabbed", "PUT": "put place placed lay laid",
    "DROP": "drop dropped release released", "UP": "up", "DOWN": "down", "AWAY": "away", "REMOVE": "remove removed",
    "STOP": "stop stopped standing", "COME": "come came get got", "UNIT": r"s sec seconds second(?=\s+ago)",
    "MINUTE": "min minute minutes",
}  # fmt: skip
"""The words of each terminal. None of them can be the name of a thing."""
_GRAMMAR = r"""
start: question NOW?

question: where_now | where_then | where_by | last_seen | last_seen_by | contents | contents_by | is_so | is_so_by
    | knows | is_wrong | is_there | sees | is_visible | who_sees | what_sees | hides | holder | held | is_holding
    | when_was | since_when | how_long | how_long_so | why_so | why_state | why_waits | why_moved | happened | who_did
    | what_if | would | wants | doing | count | which

where_now: WHERE BE thing
where_then: WHERE BE thing when
where_by: WHERE DO thing THINK (DET? thing) BE | WHERE WILL thing LOOK FOR thing
    | WHERE BE thing BE? BELIEVED BY thing
last_seen: WHEN BE thing LAST? SEEN | WHEN BE thing SEEN LAST
last_seen_by: WHEN DO thing LAST SEE thing | WHEN BE thing LAST SEEN BY thing
contents: WHAT BE relation thing when? | WHAT REST relation thing
contents_by: WHAT DO thing THINK BE relation thing
is_so: BE thing relation thing when?
is_so_by: DO thing THINK that? thing BE relation thing
that: DET
knows: DO thing KNOW WHERE thing BE
is_wrong: BE thing WRONG OF? ABOUT? thing
is_there: BE THERE thing | BE thing THERE | BE thing state
sees: (CAN | DO) thing SEE thing
is_visible: BE thing VISIBLE (TO thing)?
who_sees: WHO CAN? SEE thing | WHO BE SEE thing
what_sees: WHAT (CAN | DO) thing SEE | WHAT BE thing SEE
hides: WHAT (BE)? HIDE thing
holder: WHO (BE)? (HOLD | HELD) thing when? | WHO HAS thing when? | WHO BE HOLD thing when | WHERE BE thing HELD
held: WHAT BE thing HOLD | WHAT DO thing (HOLD | HAS)
is_holding: BE thing HOLD thing | DO thing (HOLD | HAS) thing
when_was: WHEN (BE | DO) thing did
since_when: SINCE WHEN BE thing relation thing | WHEN DO thing COME relation thing
how_long: HOW LONG HAS thing BE UNSEEN | HOW LONG BE thing UNSEEN
how_long_so: HOW LONG HAS thing BE relation thing | HOW LONG BE thing relation thing
why_so: WHY BE thing (BE? BELIEVED TO? BE?)? relation thing | WHY DO thing THINK that? thing BE relation thing
why_state: WHY BE thing state | WHY BE NOT thing (VISIBLE | SEEN)
    | WHY CAN thing NOT SEE thing
why_waits: WHY DO thing (WAIT | STOP | NOT MOVE) | WHY BE thing (WAIT | STOP | NOT did)
why_moved: WHY DO thing (MOVE | FALL) | WHY BE thing did
happened: WHAT HAPPEN (TO thing)? since? | WHAT HAS HAPPEN (TO thing)? since?
who_did: WHO did_what thing | WHO did_what thing (UP | DOWN | AWAY)
what_if: WHAT WILL? HAPPEN? IF change
would: WILL thing (FALL | MOVE | STAY) IF change
wants: WHAT DO thing WANT | WHAT BE DET? GOAL (OF thing)? | WHAT DO thing WAIT FOR | WHAT BE thing WAIT FOR
doing: WHAT BE thing DOING
count: HOW MANY thing BE THERE
which: WHAT thing BE THERE | WHAT BE THERE

change: thing BE (REMOVE | PICK AWAY | GONE) -> remove
    | thing (REMOVE | PICK AWAY?) thing AWAY? -> remove_by
    | thing BE HELD -> hold
    | thing BE (PUT | MOVE) ON thing -> put
    | thing PUT thing ON thing -> put
did: MOVE | PICK UP? | PICK AWAY | PUT DOWN? | DROP | FALL | APPEAR | VANISH | REMOVE
did_what: MOVE | PICK (UP | AWAY)? | PUT DOWN? | DROP | REMOVE
state: SURPRISING | GONE | UNSEEN | THERE | VISIBLE | NOT VISIBLE | NOT SEEN
relation: ON | IN | UNDER | ABOVE | BELOW | NEAR | NEXT TO
when: NUMBER unit AGO -> ago | AT NUMBER unit? -> at
since: SINCE NUMBER unit AGO? -> ago | IN DET? LAST NUMBER? unit -> ago | LATELY -> lately | SINCE AT? NUMBER -> at
unit: UNIT -> seconds | MINUTE -> minutes
thing: DET? WORD+

NUMBER: /\d+(\.\d+)?/
WORD: /[^\W\d][\w.\-]*/
ABOUT.2: /about(?![\w.\-])/
%ignore /[\s?!.,"]+/
"""
EXAMPLES = {
    "where": "where is the THING?", "where_then": "where was the THING 10 s ago?",
    "where_by": "where does PERSON think the THING is?", "last_seen": "when was the THING last seen?",
    "last_seen_by": "when did PERSON last see the THING?", "contents": "what is on the table?",
    "contents_by": "what does PERSON think is in the THING?", "is_so": "is the THING on the table?",
    "is_so_by": "does PERSON believe that the THING is on the table?", "knows": "does PERSON know where the THING is?",
    "sees": "can PERSON see the THING?", "is_visible": "is the THING visible?", "who_sees": "who sees the THING?",
    "what_sees": "what does PERSON see?", "hides": "what hides the THING?", "holder": "who holds the THING?",
    "held": "what does the gripper hold?", "when_was": "when was the THING picked up?",
    "since_when": "since when is the THING on the table?", "how_long": "how long has the THING been unseen?",
    "why_so": "why is the THING on the table?", "why_state": "why is the THING surprising?",
    "why_waits": "why does the robot wait?", "why_moved": "why did the THING move?",
    "happened": "what happened to the THING in the last 10 s?", "who_did": "who picked the THING up?",
    "what_if": "what if the THING were removed?", "would": "would the THING fall if the OTHER were removed?",
    "wants": "what does the robot want?", "count": "how many cubes are there?", "which": "what is there?",
}  # fmt: skip
"""A question of each kind, to show when another is not understood."""
_LONGEST = 300
"""Characters of a question: several times the longest example. The work of reading grows with the cube of the words"""
_YOU = re.compile(r"\byou\b")
_SIMILAR = 3
"""Questions that are shown instead of one that is not understood: those that fit on a few lines."""


class Query(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """What is asked for, with names as they were asked."""

    kind: str
    """Name of the rule of the grammar: `where`, `is_so`, ..."""
    things: tuple[str, ...] = ()
    """Things, persons and robots in the order of the question."""
    relation: str = ""
    """`on`, `in`, `under`, `above`, `below`, `near` or `next`."""
    word: str = ""
    """What was done, or a state: `pick`, `gone`, ..."""
    ago: float | None = None
    """s before now"""
    at: float | None = None
    """s since the beginning of what is told of"""


class Misunderstanding(NamedTuple):
    """What of a question is not understood."""

    part: str
    """The part, empty where the question ends too early."""
    why: str
    """A sentence."""
    similar: tuple[str, ...]
    """Questions that are understood."""


def parse_question(text: str) -> Query | Misunderstanding:
    """Read a question; names in it are not looked up yet."""
    if len(text) > _LONGEST:
        why = f"A question has at most {_LONGEST} characters, not {len(text)}."
        return Misunderstanding(text[_LONGEST:], why, similar_questions(text[:_LONGEST]))
    plain = _plain(text)
    try:
        query: Query = _Reader().transform(_parser().parse(plain))
    except UnexpectedInput as error:
        return _misunderstood(plain, error)
    except VisitError as error:
        return Misunderstanding(text, f"That makes no question: {error.orig_exc}.", similar_questions(plain))
    return query


def similar_questions(text: str) -> tuple[str, ...]:
    """Questions of the grammar that are most like a text."""
    words = _plain(text)
    rated = sorted(EXAMPLES.values(), key=lambda example: difflib.SequenceMatcher(None, words, example.lower()).ratio())
    return tuple(rated[: -_SIMILAR - 1 : -1])


def _plain(text: str) -> str:
    """A question in lower case, without short forms."""
    plain = " ".join(text.lower().split())
    for short, long in (("'s ", " is "), ("’s ", " is "), ("n't ", " not ")):
        plain = plain.replace(short, long)
    return _YOU.sub("the robot", plain)


@cache
def _parser() -> Lark:
    """Reading the grammar takes tens of milliseconds, which only who asks needs."""
    words = (f"{name}.2: /(?:{'|'.join(known.split())})(?![\\w.\\-])/" for name, known in _WORDS.items())
    return Lark("\n".join([_GRAMMAR, *words]), parser="earley", lexer="basic", maybe_placeholders=False)


def _misunderstood(text: str, error: UnexpectedInput) -> Misunderstanding:
    similar = similar_questions(text)
    if isinstance(error, UnexpectedToken) and isinstance(error.token, Token) and error.token.type != "$END":
        begin = error.token.start_pos or 0
        return Misunderstanding(text[begin:], f"{text[begin:]!r} is not understood there.", similar)
    if isinstance(error, UnexpectedCharacters):
        part = text[error.pos_in_stream :]
        return Misunderstanding(part, f"{part!r} is not understood there.", similar)
    if isinstance(error, UnexpectedEOF | UnexpectedToken):
        return Misunderstanding("", f"The question ends too early, after {text!r}.", similar)
    return Misunderstanding(text, f"{text!r} is not understood.", similar)


class _Thing(NamedTuple):
    name: str


class _Time(NamedTuple):
    ago: float | None = None
    at: float | None = None


class _Part(NamedTuple):
    """A relation, a state, or what was done."""

    field: str
    value: str


class _Changed(NamedTuple):
    word: str
    things: tuple[str, ...]


class _Reader(Transformer[Token, Query]):
    """Makes a query of a tree."""

    def start(self, children: list[Any]) -> Query:
        """The one question."""
        query: Query = children[0]
        return query

    @v_args(tree=True)
    def question(self, tree: Any) -> Query:
        """The one kind of question that fits."""
        (rule,) = tree.children
        return _query(str(rule.data), rule.children)

    def thing(self, children: list[Token]) -> _Thing:
        """The words of a name without its article."""
        return _Thing(" ".join(str(word) for word in children if word.type == "WORD"))

    def relation(self, children: list[Token]) -> _Part:
        """The name of the relation is that of its word's terminal."""
        return _Part("relation", children[0].type.lower())

    def did(self, children: list[Token]) -> _Part:
        """What was done."""
        return _Part("word", "remove" if children[-1].type == "AWAY" else children[0].type.lower())

    did_what = did

    def state(self, children: list[Token]) -> _Part:
        """A state, `unseen` also for `not visible`."""
        kind = children[-1].type.lower()
        return _Part("word", "unseen" if children[0].type == "NOT" else kind)

    def seconds(self, _: list[Token]) -> float:
        """S in the unit"""
        return 1.0

    def minutes(self, _: list[Token]) -> float:
        """S in the unit"""
        return 60.0

    def ago(self, children: list[Any]) -> _Time:
        """A time before now."""
        return _Time(ago=_seconds(children))

    def at(self, children: list[Any]) -> _Time:
        """A time since the beginning."""
        return _Time(at=_seconds(children))

    def lately(self, _: list[Any]) -> _Time:
        """No time: what is lately, the account says."""
        return _Time()

    def remove(self, children: list[Any]) -> _Changed:
        """Something is taken away."""
        return _Changed("remove", _names(children)[-1:])

    remove_by = remove

    def hold(self, children: list[Any]) -> _Changed:
        """Something is held where it is."""
        return _Changed("hold", _names(children))

    def put(self, children: list[Any]) -> _Changed:
        """Something is put onto something."""
        return _Changed("put", _names(children)[-2:])


def _query(rule: str, children: list[Any]) -> Query:
    """The query of a rule with what was read within it."""
    parts = {part.field: part.value for part in children if isinstance(part, _Part)}
    time = next((part for part in children if isinstance(part, _Time)), _Time())
    changes = [part for part in children if isinstance(part, _Changed)]
    word = changes[0].word if changes else parts.get("word", "there" if rule == "is_there" else "")
    things = (*_names(children), *(name for change in changes for name in change.things))
    return Query(
        kind=rule, things=things, relation=parts.get("relation", ""), word=word, ago=time.ago, at=time.at
    )  # fmt: skip


def _names(children: list[Any]) -> tuple[str, ...]:
    return tuple(child.name for child in children if isinstance(child, _Thing))


def _seconds(children: list[Any]) -> float:
    """A number with its unit; 1 without a number, s without a unit."""
    number = next((float(part) for part in children if isinstance(part, Token) and part.type == "NUMBER"), 1.0)
    return number * next((part for part in children if isinstance(part, float)), 1.0)
