"""Descriptions of objects are read completely or refused with the file and the element."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.object_models import find_model, load_model, model_files, parse_model
from dsr.errors import ConfigError
from dsr.math3d.shapes import bounds
from dsr.vocabulary.relations import THINGS

BALL = """<?xml version="1.0"?>
<robot name="ball">
  <link name="ball">
    <inertial><mass value="0.05"/></inertial>
    <visual><material name="red"><color rgba="1 0 0 1"/></material></visual>
    <collision><origin xyz="1 2 3"/><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
</robot>
"""
SPHERE = '<geometry><sphere radius="0.03"/></geometry>'


def refusal(text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_model(text.encode(), "x.urdf")
    return str(caught.value)


@pytest.mark.parametrize("name", model_files())
def test_every_model_that_comes_along_can_be_used(name: str) -> None:
    model = load_model(find_model(name, Path()))
    assert model.type in THINGS
    assert model.color is not None
    assert 0.0 < model.mass < 2.0
    if model.shape:
        low, high = bounds(model.shape)
        assert [b - a for a, b in zip(low, high, strict=True)] == pytest.approx(model.size, abs=1e-6)
        assert [a + b for a, b in zip(low, high, strict=True)] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_the_sizes_of_the_scenarios() -> None:
    sizes = {name: load_model(file).size for name, file in model_files().items()}
    assert sizes["cup"] == pytest.approx((0.07, 0.07, 0.09), abs=1e-5)
    assert sizes["ball"] == (0.06, 0.06, 0.06)
    assert sizes["large_box"] == (0.2, 0.3, 0.25)
    assert sizes["cover_large"] == (0.17, 0.17, 0.15)
    assert sizes["cover_small"] == (0.145, 0.145, 0.14)


def test_the_frame_is_moved_to_the_middle_and_the_rest_has_defaults() -> None:
    model = parse_model(BALL.encode())
    assert model.type == "ball"
    assert model.shape[0].position == (0.0, 0.0, 0.0)
    assert model.size == (0.06, 0.06, 0.06)
    assert (model.mass, model.friction, model.rolling_friction) == (0.05, 0.6, 0.0)
    assert model.color == (1.0, 0.0, 0.0)


def test_a_single_upright_box_is_solid() -> None:
    text = BALL.replace('<sphere radius="0.03"/>', '<box size="0.1 0.2 0.3"/>').replace('name="ball"', 'name="box"')
    assert parse_model(text.encode()).shape == ()
    assert parse_model(text.replace('xyz="1 2 3"', 'rpy="0 0 0.5"').encode()).shape != ()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<robot", "<rob", "not valid XML"),
        ("robot", "sdf", "expected <robot>"),
        ('link name="ball"', 'link name="bal"', "did you mean 'ball'"),
        ('<link name="ball">', '<link name="ball"/><link name="ball">', "2 <link> elements; expected one"),
        ('<sphere radius="0.03"/>', '<box size="0.1 0.1 0.1"/>', "a ball is one <sphere>"),
        ("</robot>", '<joint name="hinge"/></robot>', "<joint name='hinge'>: an object has no joints"),
        (f'<collision><origin xyz="1 2 3"/>{SPHERE}</collision>', "", "0 <collision> elements"),
        ('<sphere radius="0.03"/>', '<mesh filename="a.stl"/>', "<collision> 1: <mesh> 'a.stl' is not supported"),
        (SPHERE, "", "<collision> 1: expected one <geometry>"),
        ('radius="0.03"', 'radius="-0.03"', "<collision> 1: <sphere>: expected lengths of at least 0.001 m"),
        ('radius="0.03"', 'radius="0.0004"', "<collision> 1: <sphere>: expected lengths of at least 0.001 m"),
        ("</link>", f"<collision>{SPHERE}</collision>" * 16 + "</link>", "17 <collision> elements; expected 1 to 16"),
        ('radius="0.03"', 'radius="nan"', "<collision> 1: <sphere radius='nan'>"),
        ('radius="0.03"', 'radius="30"', "60 x 60 x 60 m; expected at most"),
        ('<mass value="0.05"/>', "", "expected <inertial> with <mass"),
        ('"0.05"', '"0"', "expected <inertial> with <mass"),
        ('"0.05"', '"1e-300"', "<mass value=...> of 0.0001 to 100 kg"),
        ('"0.05"', '"nan"', "<mass value='nan'>: expected a finite number"),
        ("1 0 0 1", "1 0 0", "expected 4 numbers"),
        ("1 0 0 1", "255 0 0 1", "expected numbers from 0 to 1"),
        ('<color rgba="1 0 0 1"/>', "", "<material name='red'>: no <color"),
        ('<?xml version="1.0"?>', '<!DOCTYPE r [<!ENTITY a "b">]>', "without DOCTYPE"),
        ("<collision>", '<contact><lateral_friction value="9"/></contact><collision>', "<lateral_friction value=9>"),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, message: str) -> None:
    found = refusal(BALL.replace(old, new))
    assert found.startswith("x.urdf")
    assert message in found


@pytest.mark.parametrize("encoding", ["utf8x", "rot13", "hex", "shift_jis", "idna"])
def test_encodings_that_cannot_be_read_are_refused(encoding: str) -> None:
    found = refusal(BALL.replace('version="1.0"', f'version="1.0" encoding="{encoding}"'))
    assert found.startswith("x.urdf: cannot be decoded") and "expected the encoding UTF-8" in found


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_nothing_is_expanded_in_any_encoding(encoding: str) -> None:
    declared = BALL.replace('version="1.0"', 'version="1.0" encoding="utf-16"')
    mark = "" if encoding == "utf-16" else "\ufeff"
    assert parse_model((mark + declared).encode(encoding)).type == "ball"
    with_entity = declared.replace("<robot", '<!DOCTYPE r [<!ENTITY a "b">]><robot')
    with pytest.raises(ConfigError, match="without DOCTYPE"):
        parse_model((mark + with_entity).encode(encoding))


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="unknown model 'cpu'; did you mean 'cup'"):
        find_model("cpu", tmp_path)
    with pytest.raises(ConfigError, match="cannot be read"):
        load_model(find_model("mine.urdf", tmp_path))


@pytest.mark.parametrize("axis", range(3))
def test_places_that_overflow_are_refused(axis: int) -> None:
    place = ["0", "0", "0"]
    place[axis] = "1e308"
    assert "a length of 1e+308 m; at most 100000" in refusal(BALL.replace("1 2 3", " ".join(place)))


def test_errors_do_not_show_megabytes_of_the_file() -> None:
    assert len(refusal(BALL.replace("1 2 3", "1 " * 1_000_000))) < 1000
