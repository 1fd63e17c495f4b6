"""Boxes read off a memory, hysteresis, and requests."""

from __future__ import annotations

import numpy as np
import pytest

import dsr
from dsr import ConfigError, ManualClock, Memory, NodeNotFoundError, Pose
from dsr.network.local_transport import LocalNetwork
from dsr.spatial import ALLOCENTRIC, SPATIAL, Fact, Hysteresis, Scene, read_scene, read_view, request_relations

CUBE = (0.04, 0.04, 0.04)


@pytest.fixture
def memory() -> Memory:
    clock = ManualClock()
    memory = Memory("g", "a", transport=LocalNetwork(clock).connect("a"), clock=clock)
    for name, kind in (("world", "world"), ("table", "table"), ("camera", "camera")):
        memory.add_node(name, kind)
    memory.update_node("table", size=(1.0, 1.0, 0.05))
    memory.add_edge("world", "table", "RT", pose=Pose())
    memory.add_edge("world", "camera", "RT", pose=Pose.from_rotvec((0.0, -1.0, 0.3), (-np.pi / 2, 0.0, 0.0)))
    for name, x in (("cube_1", 0.0), ("cube_2", 0.06)):
        memory.add_node(name, "cube", size=CUBE)
        memory.add_edge("world", name, "Virtual_RT", pose=Pose((x, 0.0, 0.02)))
    return memory


def holding(scene: Scene, *relations: str, **options: object) -> set[Fact]:
    return {fact for fact, margin in scene.margins(relations, **options).items() if margin >= 0.0}  # type: ignore[arg-type]


def test_the_scene_is_what_is_believed_to_be_somewhere(memory: Memory) -> None:
    memory.add_node("cube_nowhere", "cube", size=CUBE)
    memory.add_node("cube_gone", "cube", size=CUBE, present=False)
    memory.add_edge("world", "cube_gone", "Virtual_RT", pose=Pose())
    memory.add_node("cube_of_no_size", "cube")
    memory.add_edge("world", "cube_of_no_size", "Virtual_RT", pose=Pose())
    memory.add_edge("world", "cube_1", "RT", pose=Pose((5.0, 0.0, 0.0)))
    scene = read_scene(memory)
    assert list(scene.boxes) == ["cube_1", "cube_2", "table"]
    assert scene.boxes["cube_1"].pose.t == (0.0, 0.0, 0.02)
    assert scene.boxes["table"].top == pytest.approx(0.0) and scene.boxes["table"].bottom == pytest.approx(-0.05)


def test_objects_with_meshes_are_in_the_scene_as_the_box_around_them(memory: Memory) -> None:
    memory.add_node("shelf", "object", bounds=(0.0, -0.1, 0.0, 0.2, 0.1, 0.5))
    memory.add_edge("world", "shelf", "RT", pose=Pose((0.5, 0.0, 0.0)))
    flat = dsr.Mesh([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [(0, 1, 2)])
    memory.add_node("poster", "object", mesh=memory.put_mesh(flat))
    memory.add_edge("shelf", "poster", "RT", pose=Pose((0.0, 0.0, 0.6)))
    scene = read_scene(memory)
    assert scene.boxes["shelf"].pose.t == pytest.approx((0.6, 0.0, 0.25))
    assert scene.boxes["shelf"].size == pytest.approx((0.2, 0.2, 0.5))
    assert scene.boxes["poster"].bottom == pytest.approx(0.6, abs=1e-3)
    assert {Fact("above", "poster", "shelf"), Fact("on_top", "shelf", "table")} <= holding(scene, "above", "on_top")


def test_relations_among_some_or_all(memory: Memory) -> None:
    scene = read_scene(memory)
    assert holding(scene, "on_top") == {Fact("on_top", "cube_1", "table"), Fact("on_top", "cube_2", "table")}
    assert holding(scene, "next_to", sources=["cube_1"]) == {Fact("next_to", "cube_1", "cube_2")}
    assert set(scene.margins(["above"], ["cube_1"], ["table"])) == {Fact("above", "cube_1", "table")}
    assert {fact.relation for fact in scene.margins()} == set(ALLOCENTRIC)
    view = read_view(memory, "camera")
    assert {fact.relation for fact in scene.margins(view=view)} == set(SPATIAL)
    assert holding(scene, "left_of", view=view) == {Fact("left_of", "cube_1", "cube_2")}
    from_world = read_view(memory, "world")
    assert holding(scene, "in_front_of", view=from_world) == {Fact("in_front_of", "cube_1", "cube_2")}


def test_one_name_is_a_name_and_no_collection_of_letters(memory: Memory) -> None:
    memory.add_node("cube_11", "cube", size=CUBE)
    memory.add_edge("world", "cube_11", "Virtual_RT", pose=Pose((0.0, 0.06, 0.02)))
    scene = read_scene(memory)
    assert set(scene.margins("above", "cube_11", "cube_1")) == {Fact("above", "cube_11", "cube_1")}
    every = set(scene.margins(["above"], ["cube_1", "cube_11"], ["cube_2", "table"]))
    assert set(scene.margins(iter(["above"]), iter(["cube_1", "cube_11"]), iter(["cube_2", "table"]))) == every
    with pytest.raises(ConfigError, match="no spatial relation 'abov'; did you mean 'above'"):
        scene.margins("abov")


@pytest.mark.parametrize("things", [[], ["cube_1"]])
def test_margins_of_wrong_relations_are_told(memory: Memory, things: list[str]) -> None:
    scene, view = read_scene(memory), read_view(memory, "camera")
    with pytest.raises(ConfigError, match="no spatial relation 'leftof'; did you mean 'left_of'"):
        scene.margins(("leftof",), things, view=view)
    with pytest.raises(ConfigError, match="left_of, behind depends on who looks: give a view"):
        scene.margins(("above", "left_of", "behind"), things)


def test_viewpoints_must_be_somewhere(memory: Memory) -> None:
    with pytest.raises(NodeNotFoundError):
        read_view(memory, "camera_2")
    memory.add_node("camera_2", "camera")
    with pytest.raises(ConfigError, match="camera_2"):
        read_view(memory, "camera_2")


def test_hysteresis_ignores_noise_within_its_band_and_follows_what_is_beyond() -> None:
    rng = np.random.default_rng(0)
    hysteresis = Hysteresis[str](band=0.01)
    assert hysteresis.update({"a": 0.0005}) == {"a"}
    for noise in rng.uniform(-0.01, 0.01, 200):
        assert hysteresis.update({"a": float(noise)}) == {"a"}
    assert hysteresis.update({"a": -0.0101}) == frozenset()
    for noise in rng.uniform(-0.01, -1e-6, 200):
        assert hysteresis.update({"a": float(noise)}) == frozenset()
    assert hysteresis.update({"a": 0.0}) == {"a"} and hysteresis.update({"b": 1.0}) == {"b"}
    assert Hysteresis(0.01, ["a"]).update({"a": -0.005}) == {"a"}
    with pytest.raises(ValueError, match="0 or more"):
        Hysteresis[str](band=float("nan"))


def test_a_request_is_a_node_below_the_mind(memory: Memory) -> None:
    names = [request_relations(memory, "left_of, above", "cube_1", viewpoint="camera") for _ in range(2)]
    assert len(set(names)) == 2
    assert dict(memory.node(names[0])) == {
        "relations": "left_of,above", "things": "cube_1", "others": "", "viewpoint": "camera",
    }  # fmt: skip
    assert memory.get_edge("mind", names[0], "has") is not None


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [("left", "did you mean 'left_of'"), ("on", "no spatial"), ("", "no spatial"),
     ("above,left_of", "left_of depends on who looks: name a viewpoint")],
)  # fmt: skip
def test_wrong_requests_are_told(memory: Memory, wanted: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected):
        request_relations(memory, wanted)
    assert memory.nodes("query") == []
