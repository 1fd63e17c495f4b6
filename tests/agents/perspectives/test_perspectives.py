"""What persons know: what they see now, what they saw last, and what they see not to be there any more."""

from __future__ import annotations

import math

import pytest
import trimesh

from agents.perspectives.containment import carried, covers
from agents.perspectives.falling import fallen
from dsr import LocalNetwork, ManualClock, Memory, Mesh, Pose
from dsr.timeline import kept_by, query
from dsr.vocabulary.perceived import MOST_PERSONS
from tests.agents.perspectives.conftest import COVER, TURNED, Table

HERE, THERE = (100, 0, 20), (100, 250, 20)
MOVED = Pose((0.1, 0.25, 0.02))


def block_of(edge: float) -> Mesh:
    found = trimesh.creation.box((edge, edge, edge))
    return Mesh(found.vertices, found.faces)


def test_everybody_knows_what_they_see_and_nothing_else(table: Table) -> None:
    table.run()
    assert table.place("human_1", "cube") == HERE
    assert {"wall", "table", "human_2"} <= {node.name for node in table.view("human_2").nodes()}
    assert "cube" not in table.view("human_2")
    assert {(edge.src, edge.dst) for edge in table.memory.edges("sees")} == {
        ("human_1", "cube"), ("human_1", "wall"), ("human_2", "wall"),
    }  # fmt: skip
    assert table.memory.edge("human_1", "cube", "sees")["share"] == 1.0


def test_what_is_seen_to_move_is_known_to_have_moved(table: Table) -> None:
    table.run()
    table.put("cube", MOVED)
    table.run()
    assert table.place("human_1", "cube") == THERE


def test_who_is_not_there_learns_nothing_and_remembers(table: Table) -> None:
    table.run()
    table.leave("human_1")
    table.run()
    table.put("cube", MOVED)
    table.run()
    cube = table.view("human_1").node("cube")
    assert table.place("human_1", "cube") == HERE
    assert cube["perceived"] is False and cube["seen_at"].t == pytest.approx((0.1, 0.0, 0.02))
    assert table.lockstep.clock.now() - cube["last_seen"] == pytest.approx(1.2, abs=0.3)
    assert not table.view("human_1").edges("sees")


def test_who_comes_back_sees_at_once_that_it_is_elsewhere(table: Table) -> None:
    table.run()
    table.leave("human_1")
    table.run()
    table.put("cube", MOVED)
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run(0.3)
    assert table.place("human_1", "cube") == THERE
    assert table.view("human_1").node("cube")["perceived"] is True


def test_whoever_sees_the_place_empty_knows_that_it_is_not_there(table: Table) -> None:
    table.run()
    table.leave("human_1")
    table.run()
    table.put("cube", Pose((-0.1, 0.0, 0.02)))  # behind the wall
    table.run()
    assert table.place("human_1", "cube") == HERE
    table.come("human_1", Pose((0.8, 0.0, 0.1), TURNED))
    table.run(1.0)
    assert table.place("human_1", "cube") is None
    assert table.view("human_1").node("cube")["present"] is False
    assert table.place("human_2", "cube") == (-100, 0, 20)
    table.put("cube", MOVED)
    table.run()
    assert table.place("human_1", "cube") == THERE
    assert table.view("human_1").node("cube")["present"] is True


@pytest.mark.parametrize("kind", ["cube", "object"])
def test_the_place_of_what_has_only_a_mesh_is_seen_to_be_empty(table: Table, kind: str) -> None:
    table.add("block", kind, Pose((0.2, -0.2, 0.02)), mesh=table.memory.put_mesh(block_of(0.04)))
    table.run(1.2)  # until the mesh is there
    assert table.place("human_1", "block") == (200, -200, 20)
    table.leave("human_1")
    table.run()
    table.put("block", Pose((-0.1, 0.0, 0.02)))  # behind the wall
    table.come("human_1", Pose((0.8, 0.0, 0.1), TURNED))
    table.run(1.0)
    assert table.place("human_1", "block") is None
    assert table.view("human_1").node("block")["present"] is False


def test_a_place_that_is_hidden_is_not_known_to_be_empty(table: Table) -> None:
    table.add("ball", "cube", Pose((0.2, -0.2, 0.02)), size=(0.04, 0.04, 0.04))
    table.run()
    table.add("cover", "container", Pose((0.2, -0.2, 0.04)), size=(0.1, 0.1, 0.08), shape=COVER)
    table.run()
    assert table.place("human_1", "ball") == (200, -200, 20)
    table.leave("human_1")
    table.run()
    table.put("ball", Pose((-0.1, 0.0, 0.02)))
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run(1.0)
    assert table.place("human_1", "ball") == (200, -200, 20), "a false belief"
    table.put("cover", Pose((0.2, -0.2, 0.12)))
    table.run(0.2)
    table.put("cover", Pose((0.2, -0.45, 0.12)))
    table.run(1.0)
    assert table.place("human_1", "ball") is None


UPRIGHT = Pose((0.2, -0.2, 0.04), (1.0, 0.0, 0.0, 0.0))


def test_what_vanishes_above_an_open_box_fell_into_it_and_goes_along(table: Table) -> None:
    table.add("open", "container", UPRIGHT, size=(0.1, 0.1, 0.08), shape=COVER)
    table.add("ball", "cube", Pose((0.2, -0.2, 0.2)), size=(0.04, 0.04, 0.04))
    table.run()
    table.put("ball", Pose((0.2, -0.2, 0.026)))
    table.run(1.0)
    view = table.view("human_1")
    assert table.place("human_1", "ball") == (200, -200, 24), "on the floor of the box, which is 4 mm thick"
    assert view.node("ball")["perceived"] is False and view.node("ball")["present"] is True
    assert view.get_edge("ball", "open", "in") is not None
    table.put("open", Pose((0.2, -0.4, 0.04), UPRIGHT.q))
    table.put("ball", Pose((0.2, -0.4, 0.024)))
    table.run()
    assert table.place("human_1", "ball") == (200, -400, 24)


def test_what_vanishes_where_a_fall_would_be_seen_is_nowhere(table: Table) -> None:
    table.add("ball", "cube", Pose((0.3, -0.3, 0.2)), size=(0.04, 0.04, 0.04))
    table.run()
    table.put("ball", Pose((-0.1, 0.0, 0.02)))  # behind the wall
    table.run(1.0)
    assert table.place("human_1", "ball") is None


def test_nobody_who_looked_away_takes_a_thing_to_have_fallen(table: Table) -> None:
    table.add("open", "container", UPRIGHT, size=(0.1, 0.1, 0.08), shape=COVER)
    table.add("ball", "cube", Pose((0.2, -0.2, 0.2)), size=(0.04, 0.04, 0.04))
    table.run()
    table.leave("human_1")
    table.run()
    table.put("ball", Pose((-0.1, 0.0, 0.02)))
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run(1.0)
    assert table.place("human_1", "ball") is None


@pytest.mark.parametrize(
    ("x", "height"),
    [(0.2, 0.024), (0.5, 0.02), (0.152, 0.1), (0.157, 0.1)],
    ids=["into", "on the table", "on a rim", "on it"],
)
def test_a_thing_falls_until_it_touches(table: Table, x: float, height: float) -> None:
    table.add("open", "container", UPRIGHT, size=(0.1, 0.1, 0.08), shape=COVER)
    cube = table.memory.node("cube")
    below = fallen(table.memory, cube, Pose((x, -0.2, 0.3)))
    assert below is not None and below.t == pytest.approx((x, -0.2, height), abs=1e-6)


def test_nothing_beneath_is_no_place_to_fall_to(table: Table) -> None:
    assert fallen(table.memory, table.memory.node("cube"), Pose((5.0, 0.0, 0.3))) is None


def test_what_is_in_something_goes_along_with_it(table: Table) -> None:
    table.add("ball", "cube", Pose((0.2, -0.2, 0.02)), size=(0.04, 0.04, 0.04))
    table.run()
    table.add("cover", "container", Pose((0.2, -0.2, 0.04)), size=(0.1, 0.1, 0.08), shape=COVER)
    table.memory.add_edge("ball", "cover", "in")
    table.run()
    table.put("ball", Pose((0.3, -0.2, 0.02)))
    table.put("cover", Pose((0.3, -0.2, 0.04)))
    table.run(1.0)
    assert table.view("human_1").node("ball")["perceived"] is False
    assert table.place("human_1", "ball") == (300, -200, 20)


@pytest.mark.parametrize("taken", [False, True])
def test_what_is_known_to_be_in_a_cover_follows_from_what_is_seen_alone(table: Table, taken: bool) -> None:
    table.add("ball", "cube", Pose((0.2, -0.2, 0.02)), size=(0.04, 0.04, 0.04))
    table.add("cover", "container", Pose((0.2, -0.45, 0.04)), size=(0.1, 0.1, 0.08), shape=COVER)
    table.add("other", "container", Pose((0.2, 0.25, 0.04)), size=(0.1, 0.1, 0.08), shape=COVER)
    table.run()
    table.leave("human_1")
    table.run()
    table.put("cover", Pose((0.2, -0.2, 0.04)))
    if taken:
        table.put("ball", Pose((0.2, 0.25, 0.02)))
    table.memory.add_edge("ball", "other" if taken else "cover", "in")
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run()
    view = table.view("human_1")
    assert [edge.dst for edge in view.edges("in", src="ball")] == ["cover"]
    table.put("cover", Pose((0.3, -0.2, 0.04)))
    if not taken:
        table.put("ball", Pose((0.3, -0.2, 0.02)))
    table.run(1.0)
    assert table.place("human_1", "ball") == (300, -200, 20) and view.node("ball")["present"] is True
    assert [edge.dst for edge in view.edges("in", src="ball")] == ["cover"]


def test_only_hollow_things_that_are_larger_cover_what_is_within_them() -> None:
    with Memory("g", "tester", transport=LocalNetwork(ManualClock()).connect("a"), clock=ManualClock()) as memory:
        cover = memory.add_node("cover", "container", size=(0.1, 0.1, 0.08), shape=COVER)
        cup = memory.add_node("cup", "cup", size=(0.1, 0.1, 0.08))
        block = memory.add_node("block", "box", size=(0.1, 0.1, 0.08))
        cube = memory.add_node("cube", "cube", size=(0.04, 0.04, 0.04))
        crate = memory.add_node("crate", "cube", size=(0.2, 0.2, 0.2))
        mug = memory.add_node("mug", "cup", mesh=memory.put_mesh(block_of(0.1)))
        brick = memory.add_node("brick", "object", mesh=memory.put_mesh(block_of(0.03)))
        cloud = memory.add_node("cloud", "cup")
        there, within, beside = Pose((0.2, 0.0, 0.04)), Pose((0.2, 0.0, 0.02)), Pose((0.26, 0.0, 0.02))
        assert all(
            covers(memory, hollow, there, thing, within) for hollow in (cover, cup, mug) for thing in (cube, brick)
        )
        assert not covers(memory, cover, there, cube, beside) and not covers(memory, mug, there, brick, beside)
        assert not covers(memory, cover, there, crate, within) and not covers(memory, mug, there, crate, within)
        assert not covers(memory, block, there, cube, within) and not covers(memory, cloud, there, cube, within)


def test_a_place_that_is_seen_through_an_open_side_is_not_in_a_cover(table: Table) -> None:
    table.add("ball", "cube", Pose((0.2, -0.2, 0.02)), size=(0.04, 0.04, 0.04))
    table.run()
    table.memory.remove_node("ball")
    on_its_side = Pose.from_rotvec((0.2, -0.2, 0.05), (0.0, -math.pi / 2, 0.0))
    table.add("cover", "container", on_its_side, size=(0.1, 0.1, 0.08), shape=COVER)
    table.run(0.2)
    assert not table.view("human_1").edges("in")
    table.run(1.0)
    assert table.place("human_1", "ball") is None


def test_what_a_lifted_cover_covered_stays_behind(table: Table) -> None:
    table.add("ball", "cube", Pose((0.2, -0.2, 0.02)), size=(0.04, 0.04, 0.04))
    table.run()
    table.add("cover", "container", Pose((0.2, -0.2, 0.04)), size=(0.1, 0.1, 0.08), shape=COVER)
    table.memory.add_edge("ball", "cover", "in")
    table.run()
    table.leave("human_1")
    table.run()
    table.put("ball", Pose((-0.1, 0.0, 0.02)))
    table.memory.remove_edge("ball", "cover", "in")
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run()
    assert table.view("human_1").get_edge("ball", "cover", "in")
    for height in (0.08, 0.12):
        table.put("cover", Pose((0.2, -0.2, height)))
        table.run(0.2)
    table.put("cover", Pose((0.2, -0.5, 0.12)))
    table.run(1.0)
    assert table.place("human_1", "ball") is None


def test_what_is_in_an_open_box_goes_where_that_goes() -> None:
    with Memory("g", "tester", transport=LocalNetwork(ManualClock()).connect("a"), clock=ManualClock()) as memory:
        upright = Pose((0.0, 0.0, 0.04))
        raised = Pose.from_rotvec((0.1, 0.0, 0.5), (0.0, 0.0, 1.0))
        turned = Pose((0.0, 0.0, 0.04), (1.0, 0.0, 0.0, 0.0))
        cover = memory.add_node("cover", "container", size=(0.1, 0.1, 0.08), shape=COVER)
        ball = Pose((0.01, 0.0, 0.02))
        assert carried(cover, turned, raised @ turned.inverse() @ turned, ball) == raised @ turned.inverse() @ ball
        assert carried(cover, upright, raised, ball) is None
        slid = carried(cover, upright, Pose((0.2, 0.0, 0.05)), ball)
        assert slid is not None and slid.t == pytest.approx((0.21, 0.0, 0.02))


def test_a_world_that_somebody_deletes_begins_anew(table: Table) -> None:
    table.run()
    table.memory.delete_world("view_of_human_1")
    table.run(1.0)
    assert table.place("human_1", "cube") == HERE


def test_a_thing_of_another_type_takes_the_place_of_one_that_was_known(table: Table) -> None:
    table.run()
    table.memory.remove_node("cube")
    table.add("cube", "ball", MOVED, size=(0.04, 0.04, 0.04))
    table.run()
    assert table.view("human_1").node("cube").type == "ball" and table.place("human_1", "cube") == THERE


def test_a_camera_has_a_view_too() -> None:
    table = Table(of=("camera",))
    table.add("cube", "cube", Pose((0.1, 0.0, 0.02)), size=(0.04, 0.04, 0.04))
    table.add("camera", "camera", Pose((0.0, 0.0, 0.8), (1.0, 0.0, 0.0, 0.0)), fov=(1.0, 0.8))
    table.run()
    assert table.place("camera", "cube") == HERE
    table.lockstep.close()


def test_names_that_are_nobodys_who_sees_have_no_world_and_are_told_once(caplog: pytest.LogCaptureFixture) -> None:
    table = Table(of=("humn_1", "cube", "human_1", "late"))
    table.add("cube", "cube", Pose((0.1, 0.0, 0.02)), size=(0.04, 0.04, 0.04))
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run(1.0)
    table.come("late", Pose((0.8, 0.1, 0.4), TURNED))
    table.run(1.0)
    table.memory.remove_node("human_1")
    table.run(1.0)
    assert [info.name for info in table.memory.worlds()] == ["base", "view_of_human_1", "view_of_late"]
    warned = [record.getMessage() for record in caplog.records if "no camera or person" in record.getMessage()]
    assert len(warned) == 3 and "did you mean 'human_1'" in warned[0] and "of type cube" in warned[1]
    assert table.place("late", "cube") == HERE
    table.lockstep.close()


def test_a_view_that_cannot_be_kept_is_told_until_its_person_is_gone(table: Table) -> None:
    name = "h" * 60
    table.come(name, Pose((0.8, 0.1, 0.4), TURNED))
    table.run()
    agent = table.lockstep.runner("perspectives").agent
    assert name in agent.degraded
    table.memory.remove_node(name)
    table.run()
    assert agent.degraded == "" and table.place("human_1", "cube") == HERE


def test_what_a_thing_does_not_look_like_any_more_is_forgotten(table: Table) -> None:
    table.memory.update_node("cube", color=(1.0, 0.0, 0.0))
    table.run()
    assert table.view("human_1").node("cube")["color"] == (1.0, 0.0, 0.0)
    table.memory.remove_attribute("cube", "color")
    table.run()
    assert "color" not in table.view("human_1").node("cube")
    assert table.view("human_1").node("cube")["size"] == (0.04, 0.04, 0.04)


def test_the_same_scene_gives_the_same_worlds() -> None:
    snapshots = []
    for _ in range(2):
        table = Table()
        table.add("cube", "cube", Pose((0.1, 0.0, 0.02)), size=(0.04, 0.04, 0.04))
        table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
        table.run(1.0)
        snapshots.append(table.view("human_1").snapshot())
        table.lockstep.close()
    assert snapshots[0] == snapshots[1]


def test_what_was_seen_when_is_on_the_timeline_of_the_persons_world(table: Table) -> None:
    table.run(1.0)
    table.leave("human_1")
    table.run(1.0)
    table.put("cube", Pose((0.1, 0.3, 0.02)))
    table.run(1.0)
    world = table.view("human_1")  # somebody else has it open
    table.lockstep.kill("perspectives")
    table.run(0.2)
    table.lockstep.restart("perspectives")
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run(1.0)
    before, since = query(world, kind="sees", participants="cube")
    assert before.participants == ("human_1", "cube") and not before.is_open and since.is_open
    assert before.outcome == "last seen at (0.100, 0.000, 0.020)"
    assert before.end is not None and 0.5 < before.end - before.begin < 1.5 < since.begin - before.begin
    assert len(query(world, kind="present", participants="cube")) == 1
    assert query(world, kind="sees", participants="wall", open=True)
    (first,) = query(table.view("human_2"), kind="sees", participants="cube")
    assert first.begin > before.begin + 1.5  # the wall hid it
    assert not query(table.memory)
    assert kept_by(world) == "perspectives"


def test_a_place_that_is_seen_to_be_empty_is_on_the_timeline(table: Table) -> None:
    table.run(1.0)
    table.memory.update_node("cube", present=False)
    table.memory.remove_edge("world", "cube", "RT")
    table.run(2.0)
    (gone,) = query(table.view("human_1"), kind="present", participants="cube")
    assert gone.end is not None and gone.outcome == "not there any more"


def test_nothing_is_written_about_a_person_who_is_gone(table: Table) -> None:
    table.memory.update_node("human_1", last_seen=table.lockstep.clock.now())
    table.run()
    table.leave("human_1")
    table.run(2.0)
    view = table.lockstep.runner("perspectives").agent.memory.world("view_of_human_1")
    written = view.replica.written
    table.run(2.0)
    assert view.replica.written == written
    assert view.node("human_1")["last_seen"] == table.memory.node("human_1")["last_seen"]


def test_persons_hide_what_is_behind_them_and_are_seen(table: Table) -> None:
    table.run(1.0)
    assert table.memory.get_edge("human_1", "cube", "sees") is not None
    table.come("human_3", Pose((0.5, 0.0, 0.5)))
    table.run(1.0)
    assert table.memory.get_edge("human_1", "cube", "sees") is None
    assert table.view("human_1").node("human_3")["perceived"] is True
    assert table.view("human_1").node("cube")["perceived"] is False
    table.leave("human_3")
    table.run(1.0)
    assert table.memory.get_edge("human_1", "cube", "sees") is not None
    assert table.view("human_1").node("human_3")["perceived"] is False


def test_three_persons_come_and_go_while_a_thing_is_destroyed_and_made_anew(table: Table) -> None:
    table.come("human_3", Pose((0.0, -0.8, 0.4), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))))
    table.memory.remove_node("wall")
    table.come("human_2", Pose((-0.8, 0.0, 0.4)))
    persons = ("human_1", "human_2", "human_3")
    table.run(1.0)
    assert [table.place(person, "cube") for person in persons] == [HERE] * 3
    table.leave("human_1")
    table.run()
    table.put("cube", MOVED)
    table.run()
    table.leave("human_2")
    table.run()
    table.memory.remove_node("cube")
    table.run(1.5)
    assert [table.place(person, "cube") for person in persons] == [HERE, THERE, None]
    table.add("cube", "ball", Pose((0.3, 0.1, 0.03)), size=(0.06, 0.06, 0.06))
    table.run(1.0)
    assert [table.view(person).node("cube").type for person in persons] == ["cube", "cube", "ball"]
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run(1.5)
    assert table.place("human_1", "cube") == (300, 100, 30)


def test_a_person_whose_node_is_removed_learns_nothing_and_is_seen_by_nobody(table: Table) -> None:
    table.run(1.0)
    assert table.view("human_1").node("human_2")["perceived"] is True
    table.memory.remove_node("human_2")
    table.run(1.0)
    table.put("wall", Pose((0.0, 0.4, 0.1)))
    table.run(1.0)
    assert table.place("human_2", "wall") == (0, 0, 100)
    for node, person in (("human_2", "human_2"), ("wall", "human_2"), ("human_2", "human_1")):
        assert table.view(person).node(node)["perceived"] is False
    table.memory.add_node("human_4", "person", perceived=True)  # nobody knows where
    table.run(1.0)
    assert "human_4" not in table.view("human_4")


def test_however_many_persons_somebody_makes_up_the_worlds_are_few_and_those_of_others_stay() -> None:
    table = Table()
    table.come("human_1", Pose((0.8, 0.0, 0.4), TURNED))
    table.run()
    liar = table.lockstep._join("liar", "liar-1", None)
    for turn in range(3):
        for number in range(MOST_PERSONS):
            liar.add_node(f"a_{turn}_{number}", "person", perceived=True)
            liar.add_edge("world", f"a_{turn}_{number}", "RT", pose=Pose((0.8, 0.1, 0.4), TURNED))
        liar.flush()
        table.run(0.4)
        if turn == 1:
            table.leave("human_1")
        for number in range(MOST_PERSONS):
            liar.remove_node(f"a_{turn}_{number}")
        liar.flush()
    table.run(0.4)
    worlds = [info.name for info in table.memory.worlds() if info.name.startswith("view_of_")]
    assert len(worlds) <= MOST_PERSONS and "view_of_human_1" in worlds


@pytest.mark.parametrize("kind", ["finger", "arm"])
def test_a_person_that_turns_into_something_else_is_missed(table: Table, kind: str) -> None:
    """Before, that ended the agent, which may write persons alone."""
    table.run()
    where = table.memory.edge("world", "human_1", "RT").pose
    table.memory.remove_node("human_1")
    table.add("human_1", kind, where)
    table.run(1.0)
    for person in ("human_1", "human_2"):
        seen = table.view(person).get_node("human_1")
        assert seen is None or seen.type == "person"


def test_who_takes_the_root_out_of_a_persons_world_ends_nobody(table: Table) -> None:
    table.run()
    view = table.view("human_1")
    view.remove_node("world")
    table.run()
    assert table.place("human_1", "cube") == HERE
    for node in view.nodes():
        view.remove_node(node.name)
    table.run()
    assert table.place("human_1", "cube") == HERE
