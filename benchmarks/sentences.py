"""Splits Markdown into sentences, and counts their words.

A sentence ends at a full stop, question or exclamation mark, at `<br>`, or with its block. Blocks are paragraphs, items
of lists, cells of tables, and the texts of pictures. A semicolon or colon ends nothing: their chains are one sentence.
A colon before a list or code ends its paragraph. Headings, code blocks and comments hold no sentences.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

_ABBREVIATIONS = ("e.g.", "i.e.", "vs.", "cf.", "Fig.", "Figs.", "Eq.", "Sec.", "No.", "al.", "approx.", "resp.", "St.")
"""After these a sentence goes on; after "etc." only before a small letter."""

_FENCE = re.compile(r"^\s*(```|~~~)")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+[.)])\s+")
_RULER = re.compile(r"^\s*\|?\s*:?-+:?\s*(\|\s*:?-*:?\s*)*$")
_UNDERLINE = re.compile(r"^\s*(=+|-{3,})\s*$")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_CODE = re.compile(r"(`+)(?!`).+?(?<!`)\1(?!`)", re.DOTALL)
_IMAGE = re.compile(r"!\[([^\]]*)\]\([^)]*\)")
_LINK = re.compile(r"\[([^\]]*)\]\(([^)]*)\)")
_ADDRESS = re.compile(r"https?://[^\s)>]+")
_BREAK = re.compile(r"<br ?/?>")
_END = re.compile(r"[.!?…][\"')\]*_”’]*(?=\s|$)")
_WORD = re.compile(r"[^\W_]")


@dataclass(frozen=True)
class Sentence:
    """A sentence of a Markdown file."""

    line: int
    """The line in which it begins, counted from 1."""
    text: str
    """As it is written, on one line."""

    @property
    def words(self) -> int:
        """Number of words: a code span or an address is one, a link as many as its text has, a lone symbol none."""
        plain = _LINK.sub(r"\1", _CODE.sub("code", self.text))
        return sum(bool(_WORD.search(part)) for part in _ADDRESS.sub("address", plain).split())


def sentences(markdown: str) -> Iterator[Sentence]:
    """Yield the sentences of a Markdown text, in its order; those of a picture's text after those around it."""
    for line, block in _blocks(_COMMENT.sub(_blank, markdown)):
        pictures = [(line + block.count("\n", 0, found.start()), found[1]) for found in _IMAGE.finditer(block)]
        yield from _split(line, _IMAGE.sub(_blank, block))
        for start, text in pictures:
            yield from _split(start, text)


def _blocks(markdown: str) -> Iterator[tuple[int, str]]:
    """Yield paragraphs, items and cells with the line in which each begins."""
    start, held = 0, list[str]()
    in_code = in_list = False
    after_blank = True
    for number, line in enumerate([*markdown.splitlines(), ""], 1):
        is_fence = bool(_FENCE.match(line))
        is_blank = not line.strip()
        is_row = line.lstrip().startswith("|")
        is_item = bool(_ITEM.match(line))
        is_indented = line.startswith("    ") and after_blank and not in_list
        is_heading = line.startswith("#") or bool(_UNDERLINE.match(line))
        if in_code or is_fence or is_blank or is_row or is_item or is_indented or is_heading:
            if held:
                yield start, "\n".join(held)
            held = []
        if is_fence:
            in_code = not in_code
        elif not (in_code or is_blank or is_indented or is_heading):
            if is_row:
                yield from _cells(number, line)
            else:
                start = start if held else number
                held.append(_ITEM.sub(_blank, line).lstrip("> "))
        in_list = is_item or (in_list and (is_blank or line.startswith("  ") or bool(held)))
        after_blank = is_blank or (is_indented and not in_code)


def _cells(number: int, line: str) -> Iterator[tuple[int, str]]:
    if not _RULER.match(line):
        hidden = _CODE.sub(lambda found: "x" * len(found[0]), line.replace("\\|", "xx"))
        borders = [-1, *(place for place, letter in enumerate(hidden) if letter == "|"), len(line)]
        for left, right in pairwise(borders):
            yield number, line[left + 1 : right]


def _split(line: int, block: str) -> Iterator[Sentence]:
    """Yield the sentences of a block that begins in `line`."""
    hidden = _CODE.sub(_hide, block)
    hidden = _LINK.sub(_hide, hidden)
    hidden = _ADDRESS.sub(lambda found: _hide(found) if found[0][-1] not in ".!?" else _hide(found)[:-1] + ".", hidden)
    ends = {found.end() for found in _END.finditer(hidden) if _is_end(hidden, found)}
    ends |= {found.end() for found in _BREAK.finditer(hidden)} | {len(block)}
    begin = 0
    for end in sorted(ends):
        text = _BREAK.sub(_blank, block[begin:end])
        if _WORD.search(text):
            first = begin + len(text) - len(text.lstrip())
            yield Sentence(line + block.count("\n", 0, first), " ".join(text.split()))
        begin = end


def _is_end(text: str, found: re.Match[str]) -> bool:
    if found[0][0] != ".":
        return True
    word = text[: found.start() + 1].rsplit(maxsplit=1)[-1].lstrip("(\"'*_[“‘")
    if word == "etc.":
        following = text[found.end() :].lstrip()
        return not following or not following[0].islower()
    return word not in _ABBREVIATIONS


def _blank(found: re.Match[str]) -> str:
    """Replace by spaces, in as many lines."""
    return re.sub(r"[^\n]", " ", found[0])


def _hide(found: re.Match[str]) -> str:
    """Replace by letters that end nothing, in as many lines."""
    return re.sub(r"[^\n]", "x", found[0])
