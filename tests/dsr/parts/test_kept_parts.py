"""Parts outlive all processes: a keeper holds what it is asked for, and restores it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dsr import ConfigError, Memory, PartNotFoundError, Pose
from dsr.persistence.world_keeper import WorldKeeper
from tests.dsr.conftest import Net
from tests.dsr.parts.test_parts import house


def kept(net: Net, folder: Path, *interest: str) -> tuple[Memory, WorldKeeper]:
    memory = net.join("keeper", interest=())
    net.pump(1.0)
    return memory, WorldKeeper(memory, folder, threaded=False, interest=interest)


def test_who_asks_for_all_holds_what_is_listed_later(net: Net) -> None:
    a, b = house(net)
    everything = net.join("all", interest="*")
    net.pump(1.0)
    assert set(everything.interest) == {"kitchen", "hall"} and "ball" in everything and everything.joined
    a.create_part("lab")
    a.add_node("robot", "robot", "lab")
    b.hold_part("*")
    net.pump(1.0)
    assert "robot" in everything and "robot" in b and set(b.interest) == {"kitchen", "hall", "lab"}
    b.leave_part("hall")
    a.create_part("cellar")
    net.pump(1.0)
    assert set(b.interest) == {"kitchen", "lab"} and "cellar" in everything.interest and everything.joined
    assert everything.transform("world", "ball").t == (1, 1, 0)


def test_all_parts_are_restored_after_a_crash_of_everybody(net: Net, tmp_path: Path) -> None:
    a, _ = house(net)
    memory, keeper = kept(net, tmp_path, "*")
    net.pump(1.0)
    a.update_node("cup", mass=7.0)
    a.create_part("lab")
    a.add_node("robot", "robot", "lab")
    a.remove_node("ball")
    net.pump(1.5)
    keeper.flush()
    later = Net()
    copy = tmp_path / "copy"
    _copy(tmp_path, copy)
    again, _ = kept(later, copy, "*")
    assert {node.name for node in again.nodes()} == {"world", "cup", "robot"}
    assert again.node("cup")["mass"] == 7.0 and again.part(again.node("robot")) == "lab"
    assert again.transform("world", "cup") == Pose((1, 0, 0))
    asker = later.join("asker", interest=("kitchen",))
    later.pump(1.5)
    assert asker.node("cup")["mass"] == 7.0 and asker.joined and "robot" not in asker
    again.add_node("plate", "cube", "kitchen")
    later.pump(1.5)
    assert "plate" in asker
    memory.close()


def test_a_part_that_came_just_before_the_end_is_kept(net: Net, tmp_path: Path) -> None:
    memory, _ = kept(net, tmp_path, "*")
    memory.create_part("kitchen")
    memory.add_node("cup", "cube", "kitchen", mass=7.0)
    memory.close()
    again, keeper = kept(Net(), tmp_path, "*")
    assert keeper.restored and again.node("cup")["mass"] == 7.0


def test_a_keeper_of_one_part_leaves_the_files_of_others_alone(net: Net, tmp_path: Path) -> None:
    house(net)
    memory, keeper = kept(net, tmp_path, "*")
    net.pump(1.0)
    keeper.flush()
    memory.leave_part("kitchen")
    keeper.flush()
    assert (tmp_path / "parts" / "kitchen").is_dir()
    memory.close()
    one, two = Net(), Net()
    part, _ = kept(one, tmp_path, "hall")
    assert {node.name for node in part.nodes()} == {"world", "ball"} and part.interest == ("hall",)
    part.close()
    whole, _ = kept(two, tmp_path, "*")
    assert {node.name for node in whole.nodes()} == {"world", "ball", "cup"}


def test_an_interest_of_what_no_part_is_called_is_refused(net: Net) -> None:
    memory = net.join("a", interest=())
    with pytest.raises(ConfigError, match="'the kitchen'"):
        memory.hold_part("the kitchen")
    with pytest.raises(PartNotFoundError):
        memory.hold_part("kitchen")
    memory.hold_part("kitchen", unlisted=True)
    assert memory.interest == ("kitchen",)


def _copy(folder: Path, to: Path) -> None:
    """What a crash leaves: the files without the locks."""
    for file in [each for each in folder.rglob("*") if each.is_file() and each.name != "lock"]:
        place = to / file.relative_to(folder)
        place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        place.write_bytes(file.read_bytes())
