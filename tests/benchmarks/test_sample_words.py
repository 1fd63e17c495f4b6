"""Where sentences end, how many words they have, and which docstrings are drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import sample_words
from benchmarks.sample_words import docstrings_in, main, public_docstrings
from benchmarks.sentences import Sentence, sentences

SOURCE = '''"""Holds cubes."""

EDGE: float = 0.04
"""m"""
_HIDDEN = 1
"""Not shown."""


class Cube(Base):
    """A cube."""

    edge: float
    """m along each side."""

    @property
    def volume(self) -> float:
        """Cubic metres."""
        return secret

    def _inner(self) -> None:
        """Not shown."""


class _Hidden:
    """Not shown."""
'''


def texts(markdown: str) -> list[str]:
    return [one.text for one in sentences(markdown)]


@pytest.mark.parametrize(
    ("markdown", "expected"),
    [
        ("One. Two? Three!", ["One.", "Two?", "Three!"]),
        ("One goes\non here. Two.", ["One goes on here.", "Two."]),
        ("It is 2.5 m, e.g. here, vs. Fig. 2 there.", ["It is 2.5 m, e.g. here, vs. Fig. 2 there."]),
        (
            "Cups, balls etc. lie. Cups, balls etc. They lie.",
            ["Cups, balls etc. lie.", "Cups, balls etc.", "They lie."],
        ),
        ('**Links.** Then (so it is.) And "so." End', ["**Links.**", "Then (so it is.)", 'And "so."', "End"]),
        ("See [a. b](docs/c.md). Use `a. b`. End.", ["See [a. b](docs/c.md).", "Use `a. b`.", "End."]),
        ("One; two: three.", ["One; two: three."]),
        ("One\n\nTwo", ["One", "Two"]),
        ("One<br>two <br/> three", ["One", "two", "three"]),
    ],
)
def test_a_sentence_ends_at_its_full_stop(markdown: str, expected: list[str]) -> None:
    assert texts(markdown) == expected


@pytest.mark.parametrize(
    ("markdown", "expected"),
    [
        ("# Title\nText\n\nUnder\n---\n", ["Text", "Under"]),
        ("These:\n\n- one\n  goes on\n- two. Three\n\n1. four", ["These:", "one goes on", "two.", "Three", "four"]),
        ("Run:\n```sh\ndsr run. Now\n```\nthen this", ["Run:", "then this"]),
        ("Run:\n\n    dsr run. Now\n\nthen this", ["Run:", "then this"]),
        ("- one\n\n    still one\n", ["one", "still one"]),
        ("| a | `b | c` |\n|---|:--:|\n| d. e | f \\| g |", ["a", "`b | c`", "d.", "e", "f \\| g"]),
        ("![A picture. Nice](a.png)\n\nText", ["A picture.", "Nice", "Text"]),
        ("> quoted\n> text <!-- not. this -->", ["quoted text"]),
    ],
)  # fmt: skip
def test_a_sentence_ends_with_its_block(markdown: str, expected: list[str]) -> None:
    assert texts(markdown) == expected


def test_lines_are_those_of_the_file() -> None:
    found = list(sentences("# Title\n\nOne. Two\ngoes on. Three\n\n```\ncode\n```\n| a |\n"))
    assert [(one.line, one.text) for one in found] == [(3, "One."), (3, "Two goes on."), (4, "Three"), (9, "a")]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("A cube of 40 mm.", 5),
        ("Run `dsr scenario run hovering` now.", 3),
        ("See [the whole page](docs/a b.md) – or https://a.org/b.c here.", 7),
        ("a → b · c", 3),
    ],
)
def test_words_are_counted_as_they_are_read(text: str, words: int) -> None:
    assert Sentence(1, text).words == words


def test_public_docstrings_with_signature_and_without_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample_words, "_ROOT", tmp_path)
    (tmp_path / "cube.py").write_text(SOURCE, encoding="utf-8")
    assert [(one.line, one.signature, one.text) for one in docstrings_in(tmp_path / "cube.py")] == [
        (1, "module cube.py", "Holds cubes."),
        (3, "EDGE: float", "m"),
        (9, "class Cube(Base)", "A cube."),
        (12, "Cube.edge: float", "m along each side."),
        (16, "@property def Cube.volume(self) -> float", "Cubic metres."),
    ]


def test_a_seed_draws_the_same_again(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("docstrings", "sentences"):
        drawn = []
        for seed in ("1", "1", "2"):
            assert main([command, "--seed", seed, "--count", "5"]) == 0
            drawn.append(capsys.readouterr().out)
        assert drawn[0] == drawn[1] != drawn[2]
        assert "\n5. " in drawn[0] and "\n6. " not in drawn[0]


def test_the_packages_have_docstrings_of_every_kind() -> None:
    signatures = [one.signature for one in public_docstrings(("surprise",))]
    for kind in ("module surprise/", "class ", "def "):
        assert any(signature.startswith(kind) for signature in signatures)


def test_long_sentences_are_listed_and_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sample_words, "_ROOT", tmp_path)
    for name in ("README.md", "ARCHITECTURE.md", "CHANGELOG.md"):
        (tmp_path / name).write_text(f"Short.\n{'word ' * 25}.\n", encoding="utf-8")
    assert main(["long"]) == 0
    (tmp_path / "CHANGELOG.md").write_text(f"Short.\n{'word ' * 13}; {'word ' * 13}.\n", encoding="utf-8")
    assert main(["long"]) == 1
    assert "CHANGELOG.md:2: 26 words" in capsys.readouterr().out
