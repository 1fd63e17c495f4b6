"""The line of a value is found in any way of writing TOML."""

from __future__ import annotations

import pytest

from dsr.runtime.toml_lines import Path, line_of

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
