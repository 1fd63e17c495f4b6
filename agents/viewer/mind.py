"""Writes the robot's goals, actions, held object, surprises and explanations as two pages of text."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import rerun as rr

from agents.viewer.elapsed import Elapsed
from agents.viewer.texts import markdown
from dsr import Memory, Node
from dsr.timeline import explanations
from dsr.vocabulary.intentions import DONE, RUNNING, WANTED, describe_action
from dsr.vocabulary.relations import nodes_by_name
from dsr.vocabulary.sentences import RELATION_WORDS, explained_sentence, listed, rejected_sentences

PLAN = "mind/plan"
EXPLANATIONS = "mind/explanations"
_NEWEST = 3  # explanations with what was rejected
_EARLIER = 5  # explanations without
_MOST_REJECTED = 4
_MOST_ACTIONS = 12
_FOLDED = 2  # actions that are done, and take one row together from this number on


class MindView:
    """Logs the pages, each only when it changed."""

    def __init__(self, recording: rr.RecordingStream, elapsed: Elapsed) -> None:
        self._recording = recording
        self._elapsed = elapsed
        self._shown: dict[str, str] = {}

    def draw(self, memory: Memory) -> None:
        """Log what is not as it was before."""
        self._update(PLAN, plan_page(memory))
        self._update(EXPLANATIONS, explanations_page(memory, self._elapsed))

    def _update(self, entity: str, page: str) -> None:
        if self._shown.get(entity) != page:
            self._shown[entity] = page
            self._recording.log(entity, rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN))


def plan_page(memory: Memory) -> str:
    """Markdown: what the robot and others hold, and each intention with its status and its actions."""
    intentions = nodes_by_name(memory, "intention")
    return "\n\n".join(
        [_held(memory), *([_intention(memory, node) for node in intentions] or ["*Nothing is wanted.*"])]
    )


def _held(memory: Memory) -> str:
    """What the robot holds, then what each hand holds."""
    held: dict[str, list[str]] = defaultdict(list)
    for edge in sorted(memory.edges("grasping"), key=lambda edge: (edge.src, edge.dst)):
        node = memory.get_node(edge.src)
        held["" if node is None or node.type != "hand" else edge.src].append(edge.dst)
    own = held.pop("", [])
    holds = RELATION_WORDS["grasping"].holds
    sentences = [f"{holds.capitalize()} **{markdown(listed(own))}**." if own else f"{holds.capitalize()} nothing."]
    sentences += [f"{markdown(hand)} {holds} **{markdown(listed(things))}**." for hand, things in held.items()]
    return " ".join(sentences)


def _intention(memory: Memory, intention: Node) -> str:
    replans = intention.get("replans", 0)
    again = f", planned again {replans} times" if replans else ""
    status = f"*{markdown(intention.get('status', WANTED))}{again}*"
    why = markdown(intention.get("explanation", ""))
    lines = [f"**{markdown(intention.get('goal', ''))}** {status}{f': {why}' if why else ''}"]
    children = (memory.get_node(edge.dst) for edge in memory.edges("has", src=intention.name))
    actions = sorted(
        (node for node in children if node is not None and node.type == "action"),
        key=lambda node: (node.get("order", 0), node.name),
    )
    return "\n".join(lines + (["", "| action | status |", "|---|---|", *_rows(actions)] if actions else []))


def _rows(actions: list[Node]) -> Iterable[str]:
    """What is done is in one row while there is more to do, and of very many actions, only the last are shown."""
    to_do = [node for node in actions if node.get("status") != DONE]
    done = len(actions) - len(to_do)
    is_folded = bool(to_do) and done >= _FOLDED
    if is_folded:
        yield f"| *{done} actions* | {DONE} |"
    for node in (to_do if is_folded else actions)[-_MOST_ACTIONS:]:
        status, why = node.get("status", ""), node.get("explanation", "")
        said = markdown(f"{status}: {why}" if why else status)
        emphasis = "**" if status == RUNNING else ""
        yield f"| {emphasis}{markdown(describe_action(node))}{emphasis} | {emphasis}{said}{emphasis} |"


def explanations_page(memory: Memory, elapsed: Elapsed) -> str:
    """Markdown: what is surprising now, the newest explanations with what was rejected, and earlier ones."""
    events = explanations(memory)[::-1]
    surprising = sorted((node for node in memory.nodes() if node.get("surprising", False)), key=lambda node: node.name)
    parts = [f"**Surprising: {markdown(node.name)}**, {markdown(node.get('surprise', ''))}" for node in surprising]
    parts += [_explained(node, elapsed) for node in events[:_NEWEST]] or ["*Nothing had to be explained.*"]
    earlier = events[_NEWEST:][:_EARLIER]
    parts += [f"{_time(node, elapsed)} {markdown(explained_sentence(node.attributes))}" for node in earlier]
    return "\n\n".join(parts)


def _explained(event: Node, elapsed: Elapsed) -> str:
    """A list: the explanation chosen first, then those rejected, each with its score. Unlike tables, lists wrap."""
    rejected = rejected_sentences(event.attributes)
    lines = [f"- **{_score(event)} {markdown(explained_sentence(event.attributes))}** (chosen)"]
    lines += [f"- {markdown(other.score)} {markdown(other.sentence)}" for other in rejected[:_MOST_REJECTED]]
    if len(rejected) > _MOST_REJECTED:
        lines.append(f"- and {len(rejected) - _MOST_REJECTED} more")
    title = f"{_time(event, elapsed)} {markdown(event.get('target', ''))}, by {markdown(event.get('policy', ''))}"
    return "\n".join([f"{title}; the smallest score is the best\n", *lines])


def _score(event: Node) -> str:
    return f"{event['score']:.1f}" if "score" in event else ""


def _time(node: Node, elapsed: Elapsed) -> str:
    """When, as the story of a run tells it."""
    time = node.get("time")
    return elapsed.text(time).strip() if isinstance(time, float) else "at no time"
