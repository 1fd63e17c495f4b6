"""Names of things of which only the tag is known."""

from __future__ import annotations

import pytest

from dsr.vocabulary.tags import COUNT, name_of, tag_of


def test_names_and_tags_belong_together() -> None:
    assert [tag_of(name_of(tag)) for tag in range(COUNT)] == list(range(COUNT))


@pytest.mark.parametrize(
    "name", ["cube_587", "cube_03", "cube_", "cube", "cup_3", "3", "cube_-1", "cube_³", "cube_" + "9" * 9999]
)
def test_names_that_no_tag_makes(name: str) -> None:
    assert tag_of(name) is None
