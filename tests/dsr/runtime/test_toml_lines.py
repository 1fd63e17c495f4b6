"""The line of a value is found in any way of writing TOML."""

from __future__ import annotations

import tomllib

import pytest

from dsr.config.toml_lines import Path, line_of, parse_toml

TEXT = '''\
# a = 0
name = "x = [1"
points = [
  [1, 2],   # object.name
  [3, 4],
]
"quoted.key" = 1
text = """
name = 3
[object]
"""
after.text = { inline = 1 }
[sensor.noise]
grey = 2
[[object]]
name = "a"
[object.size]
x = 1
[[object]]
name = "b"
  size.x = 2
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("name",), 2),
        (("points",), 3),
        (("points", 1, 0), 3),
        (("quoted.key",), 7),
        (("text",), 8),
        (("after", "text", "inline"), 12),
        (("sensor", "noise"), 13),
        (("sensor", "noise", "grey"), 14),
        (("object",), 15),
        (("object", 0), 15),
        (("object", 0, "name"), 16),
        (("object", 0, "size", "x"), 18),
        (("object", 1), 19),
        (("object", 1, "name"), 20),
        (("object", 1, "size", "x"), 21),
        (("object", 1, "unknown"), 19),
        (("nothing",), None),
    ],
)
def test_line_of_a_value_or_of_the_table_around_it(path: Path, line: int | None):
    assert line_of(TEXT, path) == line


@pytest.mark.parametrize("key", ["a" + ".a" * 100, "a" + " . 'b c'" * 100, '"x"' + '."y"' * 100])
@pytest.mark.parametrize("text", ["b = 1\n{} = 1", "b = 1\n[{}]", "b = 1\nc = {{ {} = 1 }}"])
def test_keys_of_very_many_parts_are_refused_where_they_stand(text: str, key: str) -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match=r"parts \(at line 2"):
        parse_toml(text.format(key))


def test_endless_numbers_are_refused_where_they_stand() -> None:
    with pytest.raises(tomllib.TOMLDecodeError, match=r"too long \(at line 2"):
        parse_toml("b = 1\na = " + "9" * 10_000)


def test_usual_keys_and_long_lists_are_read() -> None:
    assert parse_toml("a.b.c.d = 1\ne = [" + "1.5, " * 10_000 + "]")["a"] == {"b": {"c": {"d": 1}}}
