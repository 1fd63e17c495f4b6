"""Reads questions in plain English by a small grammar; what is not understood is told, with similar questions."""

from __future__ import annotations

import difflib
import re
from functools import cache
from typing import Any, NamedTuple

import msgspec
from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

from dsr.narration.calendar import MARK, without_times
from dsr.narration.grammar import EXAMPLES, GRAMMAR, TIMED, WORDS

_LONGEST = 300
"""Characters of a question: several times the longest example. The work of reading grows with the cube of the words"""
_MOST_PARTS = 4
"""Questions in one: more are an interrogation, and each takes time to read."""
_POLITE = re.compile(
    r"^((please|hey|hi|hello|ok|okay|so|then|um|well|and|but|tell|show|say|me|us|do you know|any idea|i wonder"
    r"|(can|could|would|will) you|i (want|would like|need) to know)\b[ ,]*)+"
    r"(?=(where|what|which|who|when|why|how|is|are|was|were|did|does|has|have|in|on|under|behind)\b)"
)
"""What people say before a question that asks for nothing."""
_FILLERS = re.compile(
    r"(?<![\w.\-])(please|still|just|actually|exactly|really|already|again|right(?= now)|any ?more|any longer"
    r"|at all|at the moment|yet|earlier(?= \w)"
    r"|back(?= (on|in|at|under|to)\b)|most recently(?= )|perhaps|maybe)(?![\w.\-])"
)
"""Words that change nothing in a question about what is so."""
_SHORT = (
    ("can't ", "can not "), ("can’t ", "can not "), ("won't ", "will not "), ("n't ", " not "), ("n’t ", " not "),
    ("'s ", " is "), ("’s ", " is "),
)  # fmt: skip
_ALSO = (
    (" on top of ", " on "), (" on the top of ", " on "), (" inside of ", " in "), (" in side ", " in "),
    ("how come ", "why "), ("which of ", "which "), (" on top?", " on the top?"), ("no longer ", "not "),
    ("same spot", "same place"), ("same position", "same place"),
    (" most recently", " last"), ("what makes you think ", "why do you think "),
)
_TAG = re.compile(
    r",\s*(right|correct|yes|no|ok|(is|are|was|were|do|does|did|has|have)( not)? (it|they|he|she|there))\s*\??$"
)
"""What people say behind a question that asks for nothing: `isn't it?`."""
_TOLD = re.compile(r"^((?:the |a |an )?[\w.\-]+(?: [\w.\-]+)??) (is|are|was|were|has|have|can) (?:not )?(.+)$")
"""A statement that is asked whether it is so: `the cup is on the table, isn't it?`."""
_NOT_SO = re.compile(r"^(is|are|was|were|do|does|did|has|have|can|could|will|would) not ")
"""Begin of a question that asks the same without its `not`."""
_VIEW = re.compile(r"from ([\w.\-]+)['’]s (point of view|perspective|view|side|viewpoint|place)")
_AND = re.compile(
    r"[,;]?\s+(?:and|or|but)\s+(?=(?:who|what|where|when|why|how|which|did|does|is|was|are|were|has|can)\b)"
)
"""Between two questions in one."""
_SIDES = ("behind", "front", "left", "right")
_QUANTIFIERS = {"SOME_OF": "any", "ALL_OF": "all"}
_EXTREMES = ("TOP", "BOTTOM", "LARGEST", "SMALLEST", "HEAVIEST", "LIGHTEST")
_PROPERTIES = ("COLOUR", "LARGE", "HEAVY")
_BODIES = ("anyone", "anybody", "someone", "somebody", "nobody")
_IT = ("it", "they", "them")
_YOU = re.compile(r"\byou\b")
_SIMILAR = 3
"""Questions that are shown instead of one that is not understood: those that fit on a few lines."""


class Query(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """What is asked for, with names as they were asked."""

    kind: str
    """Name of the rule of the grammar: `where`, `is_so`, ..."""
    things: tuple[str, ...] = ()
    """Things, persons and robots in the order of the question; several as `a and b`, `any WORDS` or `all WORDS`."""
    relation: str = ""
    """`on`, `in`, `under`, `above`, `below`, `near`, `next`, `behind`, `front`, `left` or `right`."""
    view: str = ""
    """From where `behind`, `front`, `left` and `right` are seen; the robot chooses if it is empty."""
    word: str = ""
    """What was done, or a state: `pick`, `gone`, ..."""
    when: str = ""
    """Words of a time, see `dsr.narration.calendar`: `last tuesday`, `10 s ago`."""
    at: float | None = None
    """s since the beginning of what is told of"""
    since: float | None = None
    """s since the beginning of what is told of, from which on until now"""


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
    plain, times = _timeless(_plain(text))
    if len(times) > 1:
        why = f"There are two times in it: {' and '.join(map(repr, times))}."
        return Misunderstanding(times[1], why, similar_questions(plain))
    try:
        query: Query = _Reader().transform(_parser().parse(plain))
    except UnexpectedInput as error:
        return _misunderstood(plain, error, times[0] if times else "")
    except VisitError as error:
        return Misunderstanding(text, f"That makes no question: {error.orig_exc}.", similar_questions(plain))
    return msgspec.structs.replace(query, when=times[0]) if times else query


def parse_questions(text: str) -> list[Query | Misunderstanding]:
    """Read one question, or several in one: `where was the cup last Tuesday, and who moved it?`.

    A later one takes from the one before what "it" is, and the time.
    """
    whole = parse_question(text)
    parts = _AND.split(text.strip())
    if not isinstance(whole, Misunderstanding) or not 1 < len(parts) <= _MOST_PARTS:
        return [whole]
    found: list[Query | Misunderstanding] = []
    for part in parts:
        query, before = parse_question(part), found[-1] if found else None
        if isinstance(query, Query) and isinstance(before, Query):
            things = tuple(before.things[-1] if name in _IT and before.things else name for name in query.things)
            is_timed = query.when or query.at is not None or query.since is not None
            when = query.when if is_timed or query.kind not in TIMED else before.when
            query = msgspec.structs.replace(query, things=things, when=when)
        found.append(query)
    return found


def similar_questions(text: str) -> tuple[str, ...]:
    """Questions of the grammar that are most like a text."""
    words = _plain(text)
    rated = sorted(EXAMPLES.values(), key=lambda example: difflib.SequenceMatcher(None, words, example.lower()).ratio())
    return tuple(rated[: -_SIMILAR - 1 : -1])


def _plain(text: str) -> str:
    """A question in lower case, without short forms, and without words that ask for nothing."""
    plain = _VIEW.sub(r"from \1", " ".join(text.lower().replace(MARK, " ").split()))
    for short, long in _SHORT:
        plain = plain.replace(short, long)
    for several, one in _ALSO:
        plain = plain.replace(several, one)
    untagged = _TAG.sub("", plain)
    if untagged != plain:
        untagged = _TOLD.sub(r"\2 \1 \3", untagged)
    plain = " ".join(_FILLERS.sub(" ", _POLITE.sub("", untagged)).split()).rstrip(".!? ")
    plain = _NOT_SO.sub(r"\1 ", plain)
    return _YOU.sub("the robot", plain)


def _timeless(plain: str) -> tuple[str, tuple[str, ...]]:
    """A question with one mark at its end for the times in it, and their words."""
    marked, times = without_times(plain)
    return (f"{' '.join(marked.replace(MARK, ' ').split()).strip(' ,?')} {MARK}" if times else plain), times


@cache
def _parser() -> Lark:
    """Reading the grammar takes tens of milliseconds, which only who asks needs."""
    words = (f"{name}.2: /(?:{'|'.join(known.split())})(?![\\w.\\-])/" for name, known in WORDS.items())
    return Lark("\n".join([GRAMMAR, *words]), parser="earley", lexer="basic", maybe_placeholders=False)


def _misunderstood(text: str, error: UnexpectedInput, time: str) -> Misunderstanding:
    """What is wrong with a question in which the mark stands for the words of a time."""

    def with_time(part: str) -> str:
        return part.replace(MARK, time)

    similar = similar_questions(text)
    if isinstance(error, UnexpectedToken) and isinstance(error.token, Token) and error.token.type != "$END":
        part = with_time(text[error.token.start_pos or 0 :])
        return Misunderstanding(part, f"{part!r} is not understood there.", similar)
    if isinstance(error, UnexpectedCharacters):
        part = with_time(text[error.pos_in_stream :])
        return Misunderstanding(part, f"{part!r} is not understood there.", similar)
    whole = with_time(text)
    if isinstance(error, UnexpectedEOF | UnexpectedToken):
        return Misunderstanding("", f"The question ends too early, after {whole!r}.", similar)
    return Misunderstanding(whole, f"{whole!r} is not understood.", similar)


class _Thing(NamedTuple):
    name: str


class _Time(NamedTuple):
    at: float | None = None
    since: float | None = None


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
        """The one question, with its time."""
        time = next((part for part in children if isinstance(part, _Time)), _Time())
        view = next((part.value for part in children if isinstance(part, _Part)), "")
        query: Query = msgspec.structs.replace(children[0], at=time.at, since=time.since, view=view)
        return query

    def view(self, children: list[Any]) -> _Part:
        """From where somebody looks."""
        return _Part("view", _names(children)[0])

    @v_args(tree=True)
    def question(self, tree: Any) -> Query:
        """The one kind of question that fits."""
        (rule,) = tree.children
        return _query(str(rule.data), rule.children)

    def single(self, children: list[Token]) -> str:
        """The words of a name without its article; before those of several, `any` or `all`."""
        words = [_QUANTIFIERS.get(word.type, str(word)) for word in children if word.type not in ("DET", "OF")]
        return " ".join(words)

    def thing(self, children: list[Any]) -> _Thing:
        """One name, or several joined by `and`."""
        return _Thing(" and ".join(child for child in children if not isinstance(child, Token)))

    def relation(self, children: list[Token]) -> _Part:
        """The name of the relation is that of the terminal of its word."""
        kinds = [child.type.lower() for child in children]
        return _Part("relation", next((kind for kind in kinds if kind in _SIDES), kinds[0]))

    def did(self, children: list[Token]) -> _Part:
        """What was done."""
        kind = "remove" if children[-1].type == "AWAY" else children[0].type.lower()
        return _Part("word", "move" if kind == "bump" else kind)

    did_what = placed = did

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

    def span(self, _: list[Token]) -> _Time:
        """A time whose words are known already."""
        return _Time()

    def since(self, children: list[Any]) -> _Time:
        """All since a time from the beginning on."""
        return _Time(since=_seconds(children))

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
    changes = [part for part in children if isinstance(part, _Changed)]
    word = changes[0].word if changes else parts.get("word", "there" if rule == "is_there" else "")
    if rule == "any_so" and any(isinstance(child, Token) and str(child) in _BODIES for child in children):
        word = "body"
    if rule == "extreme":
        word = next(child.type.lower() for child in children if isinstance(child, Token) and child.type in _EXTREMES)
    if rule == "property":
        word = next(child.type.lower() for child in children if isinstance(child, Token) and child.type in _PROPERTIES)
    things = (*_names(children), *(name for change in changes for name in change.things))
    relation = parts.get("relation", "")
    if any(isinstance(child, Token) and child.type == "CONTAIN" for child in children):
        relation, things = "in", things[::-1] if rule == "is_so" else things
    return Query(kind=rule, things=things, relation=relation, word=word)


def _names(children: list[Any]) -> tuple[str, ...]:
    return tuple(child.name for child in children if isinstance(child, _Thing))


def _seconds(children: list[Any]) -> float:
    """A number with its unit; 1 without a number, s without a unit."""
    number = next((float(part) for part in children if isinstance(part, Token) and part.type == "NUMBER"), 1.0)
    return number * next((part for part in children if isinstance(part, float)), 1.0)
