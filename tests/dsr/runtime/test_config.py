"""Configuration files and their errors."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from dsr.config.toml import MisfitError, TomlFile, convert
from dsr.errors import ConfigError


class Wheel(msgspec.Struct, frozen=True):
    radius: float = 0.3


class Car(msgspec.Struct, frozen=True):
    name: str
    wheels: list[Wheel] = []
    spare: Wheel | None = None


def write(folder: Path, text: str) -> Path:
    file = folder / "car.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_good_file_is_read(tmp_path: Path) -> None:
    file = write(tmp_path, 'name = "a"\n[[wheels]]\nradius = 0.4\n[spare]\n')
    assert TomlFile(file).convert(Car) == Car("a", [Wheel(0.4)], Wheel())


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        ('name = "a"\ncolour = 1\n', 2, "unknown field 'colour'; valid: name, spare, wheels"),
        ('name = "a"\n\n[[wheels]]\n[[wheels]]\nradios = 0.4\n', 5, "unknown field 'radios' in wheels[1]; did you"),
        ('name = "a"\n[spare]\nsize = 1\n', 3, "unknown field 'size' in spare; valid: radius"),
        ('name = "a"\n[[wheels]]\nradius = 0.4\n[[wheels]]\nradius = "big"\n', 5, "wheels[1].radius: expected `float`"),
        ("name = 3\n", 1, "name: expected `str`, got `int`"),
        ('name = "a"\nspare = {radius = \n', 2, "not valid TOML"),
        ("name = 'a\n", 1, "not valid TOML"),
    ],
)
def test_a_mistake_is_told_with_file_line_and_what_was_expected(
    tmp_path: Path, text: str, line: int, expected: str
) -> None:
    file = write(tmp_path, text)
    with pytest.raises(ConfigError, match=re.escape(f"{file}:{line}: {expected}")):
        TomlFile(file).convert(Car)


def test_a_missing_field_names_it(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="missing required field `name`"):
        TomlFile(write(tmp_path, "")).convert(Car)


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        TomlFile(tmp_path / "none.toml")


def test_a_part_of_a_file_is_converted_with_its_own_lines(tmp_path: Path) -> None:
    source = TomlFile(write(tmp_path, 'title = "x"\n[car]\nname = "a"\nspar = 1\n'))
    with pytest.raises(ConfigError, match=r":4: unknown field 'spar'; did you mean 'spare'"):
        source.convert(Car, ("car",))


def test_plain_data_is_checked_the_same_way() -> None:
    assert convert({"radius": 1}, Wheel) == Wheel(1.0)
    with pytest.raises(MisfitError, match="the wheel: unknown field 'r'; valid: radius") as caught:
        convert({"r": 1}, Wheel, "the wheel")
    assert caught.value.path == ("r",)


def test_structs_by_name_are_checked_like_others() -> None:
    class Fleet(msgspec.Struct):
        cars: dict[str, Car] = {}

    assert convert({"cars": {"a": {"name": "b"}}}, Fleet).cars == {"a": Car("b")}
    with pytest.raises(ConfigError, match=re.escape("unknown field 'nam' in cars.a; did you mean 'name'?")):
        convert({"cars": {"a": {"nam": "b"}}}, Fleet)
