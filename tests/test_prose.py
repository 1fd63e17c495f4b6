"""Documents are plain: no sentence is too long, and the glossary is short, sorted and true."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.sample_words import LONGEST, long_sentences

ROOT = Path(__file__).parents[1]
PLAIN = (
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    *sorted(str(file.relative_to(ROOT)) for file in ROOT.glob("docs/**/*.md")),
)
"""Documents without a sentence of more than `LONGEST` words."""
MOST_TERMS = 50
"""Terms that a newcomer can read through."""
_TERM = re.compile(r"^- \*\*(.+?)\*\*: (.+); `([\w./]+)`$", re.MULTILINE)


@pytest.mark.parametrize("name", PLAIN)
def test_no_sentence_is_too_long(name: str) -> None:
    found = [f"{name}:{one.line}: {one.words} words: {one.text}" for one in long_sentences(ROOT / name)]
    assert not found, f"more than {LONGEST} words:\n" + "\n".join(found)


def test_the_glossary_is_short_sorted_and_names_places_that_exist() -> None:
    text = (ROOT / "docs/reference/glossary.md").read_text(encoding="utf-8")
    terms = _TERM.findall(text)
    assert len(terms) == len(re.findall("^- ", text, re.MULTILINE)) <= MOST_TERMS
    names = [term.lower() for term, _, _ in terms]
    assert names == sorted(set(names))
    assert not [place for _, _, place in terms if not (ROOT / place).exists()]
