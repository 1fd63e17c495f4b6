"""Texts from elsewhere as rerun can show them."""

from __future__ import annotations

import re

_MARKUP = re.compile(r"([\\`*_{}\[\]<>#|~!$])")
_LAST = "\u024f"  # end of Latin Extended-B, all of which the viewer's only font has
_LONGEST = 2000


def drawable(text: str, longest: int = _LONGEST) -> str:
    """`text` in one line of at most about `longest` characters, all of which the viewer has.

    A single character that its font lacks ends the viewer (rerun 0.41: "No glyph for").
    """
    text = " ".join(text[: 2 * longest].split())
    text = text if len(text) <= longest else f"{text[:longest]} ..."
    return "".join(letter if letter <= _LAST and letter.isprintable() else "?" for letter in text)


def markdown(text: str, longest: int = 160) -> str:
    """`text` as Markdown that shows it and does nothing else."""
    return _MARKUP.sub(r"\\\1", drawable(text, longest))
