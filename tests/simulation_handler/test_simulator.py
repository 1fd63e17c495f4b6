"""What the simulation has to hold: resting heights, no creep, restore, waking, errors."""

from __future__ import annotations

import gc
import math

import pybullet
import pytest

from simulation_handler.physics.simulator import SimulationError, Simulator
from tests.simulation_handler.worlds import container

CUBE = (0.04, 0.04, 0.04)
YAWED = (0.0, 0.0, math.sin(0.15), math.cos(0.15))
SECOND = 240


def stack(sim: Simulator, count: int) -> list[str]:
    """Cubes on each other, from the table up, slightly out of line."""
    names = [f"cube_{level}" for level in range(count)]
    for level, name in enumerate(names):
        rotation = YAWED if level % 2 else (0.0, 0.0, 0.0, 1.0)
        sim.add_box(name, CUBE, (0.002 * level, 0.0, 0.02 + 0.04 * level), rotation, mass=0.05)
    return names


def test_bodies_pass_through_each_other_only_as_long_as_told(table: Simulator) -> None:
    below, above = stack(table, 2)
    table.let_pass({(below, above)})
    table.step(SECOND)
    assert table.position(above)[2] == pytest.approx(0.02, abs=1e-3)
    table.place(above, (0.0, 0.0, 0.07), YAWED)
    table.let_pass(set())
    table.step(SECOND)
    assert table.position(above)[2] == pytest.approx(0.06, abs=1e-3)


def test_what_sleeps_goes_on_resting_on_the_table_when_it_may_be_passed(table: Simulator) -> None:
    pair = (stack(table, 1)[0], "other")
    table.add_box(pair[1], CUBE, (0.3, 0.0, 0.02), mass=0.05)
    table.step(4 * SECOND)
    for pairs in ({pair}, set()):
        table.let_pass(pairs)
        table.step(4)
        assert {contact[:2] for contact in table.contacts()} == {(name, "table") for name in pair}


@pytest.mark.parametrize("count", [1, 3])
def test_cubes_rest_at_their_height_without_interpenetration(table: Simulator, count: int) -> None:
    names = stack(table, count)
    table.step(2 * SECOND)
    for level, name in enumerate(names):
        assert table.position(name)[2] == pytest.approx(0.02 + 0.04 * level, abs=1e-4)
    assert all(contact.distance > -1e-4 for contact in table.contacts())


@pytest.mark.parametrize("shift", [0.03, 0.04, 0.045])
def test_boxes_whose_walls_are_in_each_other_are_not_shot_away(table: Simulator, shift: float) -> None:
    outer, inner = (0.15, 0.15, 0.12), (0.09, 0.09, 0.08)
    table.add_body("outer", outer, container(outer), (0.0, 0.0, 0.06), mass=0.2)
    table.add_body("inner", inner, container(inner), (shift, 0.5 * shift, 0.06), YAWED, mass=0.1)
    table.add_box("cube", CUBE, (shift + 0.01, 0.5 * shift, 0.045), mass=0.05)
    for _ in range(SECOND):
        table.step()
        assert max(math.hypot(*table.velocity(name)[0]) for name in ("outer", "inner", "cube")) < 0.8
    assert table.position("outer")[2] < 0.09


def test_a_resting_stack_does_not_creep(table: Simulator) -> None:
    names = stack(table, 3)
    table.step(SECOND)
    before = [table.position(name) for name in names]
    for name in names:  # awake all the time
        table.place(name, *table.pose(name))
    table.step(5 * SECOND)
    after = [table.position(name) for name in names]
    assert all(math.dist(a, b) < 1e-4 for a, b in zip(before, after, strict=True))


@pytest.mark.parametrize("shift", [0.0002, 0.001, 0.005])
def test_a_body_stays_where_it_is_put_however_near(table: Simulator, shift: float) -> None:
    stack(table, 1)
    table.step(SECOND)
    table.place("cube_0", (shift, 0.0, 0.02), YAWED)
    table.step(SECOND)
    assert table.position("cube_0")[0] == pytest.approx(shift, abs=2e-5)


@pytest.mark.parametrize("move", ["place", "remove"])
def test_what_rested_on_a_body_falls_when_that_goes(table: Simulator, move: str) -> None:
    bottom, top = stack(table, 2)
    table.step(4 * SECOND)
    assert table.speed(top) == (0.0, 0.0), "asleep"
    if move == "place":
        table.place(bottom, (0.3, 0.0, 0.02), YAWED)
    else:
        table.remove(bottom)
    table.step(SECOND // 2)
    assert table.position(top)[2] == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize("height", [0.01, 0.04, 0.12])
def test_a_falling_body_does_not_get_into_what_it_hits(table: Simulator, height: float) -> None:
    table.add_box("cube", CUBE, (0.0, 0.0, 0.02 + height), mass=0.05)
    heights = []
    for _ in range(SECOND):
        table.step()
        heights.append(table.position("cube")[2])
    assert min(heights) > 0.02 - 5e-4
    assert heights[-1] == pytest.approx(0.02, abs=1e-4)


def test_a_pinned_body_hovers_until_it_is_let_go(table: Simulator) -> None:
    table.add_box("cube", CUBE, (0.0, 0.0, 0.2), mass=0.05)
    table.make_static("cube", True)
    table.step(SECOND)
    assert table.position("cube") == (0.0, 0.0, 0.2)
    table.make_static("cube", False)
    table.step(SECOND)
    assert table.position("cube")[2] == pytest.approx(0.02, abs=1e-3)


def test_contacts_name_the_upper_and_the_lower_body(table: Simulator) -> None:
    stack(table, 2)
    table.add_box("beside", CUBE, (0.0, 0.0400, 0.02), mass=0.05)
    table.step(10)
    contacts = {(c.upper, c.lower): c.steepness for c in table.contacts()}
    assert contacts["cube_1", "cube_0"] > 0.99
    assert contacts["cube_0", "table"] > 0.99
    assert min(contacts.get(("cube_0", "beside"), 1.0), contacts.get(("beside", "cube_0"), 1.0)) < 0.1


def trajectory(sim: Simulator, steps: int) -> list[object]:
    """All poses after each step."""
    poses: list[object] = []
    for _ in range(steps):
        sim.step()
        poses.append([sim.pose(name) for name in sim.names])
    return poses


def tumbling(sim: Simulator) -> None:
    """Cubes that fall onto each other."""
    for index in range(5):
        sim.add_box(f"cube_{index}", CUBE, (0.011 * index, 0.007 * index, 0.1 + 0.05 * index), YAWED, mass=0.05)


def test_two_simulations_are_bit_identical() -> None:
    results = []
    for _ in range(2):
        with Simulator() as sim:
            sim.add_box("table", (1.2, 1.2, 0.04), (0.0, 0.0, -0.02))
            tumbling(sim)
            results.append(trajectory(sim, 200))
    assert results[0] == results[1]


def test_a_restored_snapshot_continues_bit_identically(table: Simulator) -> None:
    tumbling(table)
    table.step(40)
    snapshot = table.snapshot()
    uninterrupted = trajectory(table, 150)
    table.restore(snapshot)
    assert trajectory(table, 150) == uninterrupted


def test_a_snapshot_of_other_bodies_is_refused(table: Simulator) -> None:
    snapshot = table.snapshot()
    stack(table, 1)
    with pytest.raises(SimulationError, match="does not fit"):
        table.restore(snapshot)
    table.discard(snapshot)


def test_bodies_do_not_leak(table: Simulator) -> None:
    for _ in range(50):
        stack(table, 2)
        table.remove("cube_0")
        table.remove("cube_1")
    assert table.names == ("table",)
    assert pybullet.getNumBodies(physicsClientId=table._client) == 1


def test_errors_name_the_body(table: Simulator) -> None:
    with pytest.raises(SimulationError, match=r"'tabel'.*did you mean 'table'"):
        table.pose("tabel")
    with pytest.raises(SimulationError, match="'table' is already"):
        table.add_box("table", CUBE, (0.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match=r"'thin': size \(0.0, 1.0, 1.0\)"):
        table.add_box("thin", (0.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match="mass nan"):
        table.add_box("odd", CUBE, (0.0, 0.0, 0.0), mass=math.nan)


def test_a_simulation_that_nobody_uses_any_more_is_freed() -> None:
    sim = Simulator()
    client = sim._client
    assert pybullet.isConnected(client)
    del sim
    gc.collect()
    assert not pybullet.isConnected(client)
