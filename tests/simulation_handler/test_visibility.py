"""What cameras should see, by hand and beside the plant's own test of what a tag sensor sees."""

from __future__ import annotations

import math
import pickle
from functools import partial

import numpy as np
import pytest

from agents.object_models import load_model, model_files
from agents.plant.bullet import Bullet
from agents.plant.camera import OVERHEAD, SimulatedCamera
from agents.plant.hands import Hands
from agents.plant.noise import SensorModel
from agents.plant.poses import recognisable
from agents.plant.renderer import Renderer
from agents.plant.world import World
from agents.scenario.format.scenario import ObjectSpec, SensorSpec, TableSpec
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics
from simulation_handler.perception import visibility
from simulation_handler.perception.visibility import CameraView, ExpectedVisibility, RayVisibility
from simulation_handler.shapes.geometry import Solid

CUBE = (0.04, 0.04, 0.04)
LENS = Intrinsics.from_fov(640, 480, 0.98)


def view(pose: Pose = OVERHEAD, name: str = "overhead") -> CameraView:
    return CameraView(name, pose, LENS)


def solid(name: str, pose: Pose, size: tuple[float, float, float] = CUBE) -> Solid:
    return Solid(name, size, pose.t, pose.q)


def shares(*solids: Solid, obstacles: tuple[Solid, ...] = ()) -> dict[str, float]:
    return {name: share for (_, name), share in RayVisibility([view()], obstacles).shares(solids).items()}


def test_a_tower_hides_all_but_its_top() -> None:
    tower = [solid(f"cube_{k}", Pose((0.35, 0.0, 0.02 + 0.04 * k))) for k in range(3)]
    assert shares(*tower) == {"cube_0": 0.0, "cube_1": 0.0, "cube_2": 1.0}
    visibilities = RayVisibility([view()]).visibilities(tower)
    assert visibilities["overhead", "cube_0"] == ExpectedVisibility(0.0, "cube_1")
    assert visibilities["overhead", "cube_2"] == ExpectedVisibility(1.0, "")


def test_a_cube_half_on_another_hides_part_of_it() -> None:
    lower, upper = solid("lower", Pose((0.35, 0.0, 0.02))), solid("upper", Pose((0.37, 0.0, 0.06)))
    assert shares(lower, upper)["lower"] == pytest.approx(0.4, abs=0.2)


def test_who_asks_about_the_same_places_again_gets_the_same_without_another_look(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks = []
    look = visibility._visibility
    monkeypatch.setattr(visibility, "_visibility", lambda *of: (looks.append(of), look(*of))[1])
    rays = RayVisibility([view()])
    there = [solid("lower", Pose((0.35, 0.0, 0.02))), solid("upper", Pose((0.37, 0.0, 0.06)))]
    here, around = there[:1], [there[0].moved((x, 0.0, 0.02)) for x in (0.36, 0.45)]
    first = [rays.look_for(places, there) for places in (here, around)]
    assert len(looks) == 2
    assert [rays.look_for(places, [*there]) for places in (here, around)] == first
    assert len(looks) == 2
    first[1][0].clear()  # whoever asked may do so with its answer
    assert rays.look_for(around, there)[0]
    without = rays.look_for(around, there[:1])
    assert len(looks) == 3 and without[0]["overhead"].share == 1.0


def test_who_asks_the_same_again_gets_the_same_without_another_look(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []
    look = visibility._visibility
    monkeypatch.setattr(visibility, "_visibility", lambda *of: (looks.append(of), look(*of))[1])
    rays = RayVisibility([view()])
    lower, upper = solid("lower", Pose((0.35, 0.0, 0.02))), solid("upper", Pose((0.37, 0.0, 0.06)))
    first = rays.visibilities([lower, upper])
    kept = dict(first)
    first.clear()  # of the asker's own copy
    assert rays.visibilities((lower, upper)) == kept and len(looks) == 1
    trembling = solid("upper", Pose((0.37, 0.0, 0.0600001)))
    assert rays.visibilities([lower, trembling]) == kept and len(looks) == 1
    moved = solid("upper", Pose((0.37, 0.0, 0.061)))
    assert rays.visibilities([lower, moved]) == RayVisibility([view()]).visibilities([lower, moved])
    assert rays.visibilities([upper, lower]) == kept
    assert rays.visibilities([lower])["overhead", "lower"] == ExpectedVisibility(1.0, "")
    assert len(looks) == 5


@pytest.mark.parametrize("whole", [False, True])
def test_only_what_moved_and_what_that_may_hide_is_looked_for_again(
    monkeypatch: pytest.MonkeyPatch, *, whole: bool
) -> None:
    looked: list[int] = []
    look = visibility._visibility
    monkeypatch.setattr(visibility, "_visibility", lambda *of: (looked.append(len(of[1])), look(*of))[1])
    rng, rays = np.random.default_rng(3), RayVisibility([view()], whole=whole)
    places = [(*rng.uniform((0.1, -0.2), (0.6, 0.2)), rng.uniform(0.02, 0.1)) for _ in range(30)]
    here = [solid(f"thing_{k}", Pose(place)) for k, place in enumerate(places)]
    seen, hidden = 0, 0
    for step in range(30):
        moved = int(rng.integers(len(here)))
        here[moved] = here[moved].moved((*(here[moved].position[:2] + rng.normal(size=2) * 0.03), 0.05))
        tremble = 1e-6 * (step % 3)
        here = [one.moved((one.position[0] + tremble, *one.position[1:])) for one in here]
        if step % 10 == 5:
            here.pop(moved)
        if step % 10 == 8:
            here.append(solid(f"new_{step}", Pose((*rng.uniform((0.1, -0.2), (0.6, 0.2)), 0.1))))
        looked.clear()
        found = rays.look_for(here, here)
        seen += sum(looked)
        expected = RayVisibility([view()], whole=whole).look_for(here, here)
        for one, other in zip(found, expected, strict=True):
            assert one["overhead"].share == pytest.approx(other["overhead"].share, abs=0.05)
            assert one["overhead"].hidden_by == other["overhead"].hidden_by
        hidden += sum(by_camera["overhead"].hidden_by != "" for by_camera in found)
    assert hidden > 100 and seen < 0.4 * 30 * 30
    assert RayVisibility([]).look_for(here, here) == [{}] * len(here)


def test_what_had_the_name_of_another_in_the_question_before_is_looked_for_anew() -> None:
    low, high, aside = (
        solid(name, Pose(at))
        for name, at in (("low", (0.35, 0.0, 0.02)), ("two", (0.35, 0.0, 0.06)), ("two", (0.5, 0.2, 0.02)))
    )
    others = [solid(f"other_{k}", Pose((0.2, 0.1 * k, 0.02))) for k in range(3)]
    nearer = [solid("other_0", Pose((0.22, 0.0, 0.02))), *others[1:]]
    rays = RayVisibility([view()])
    for here in ([low, high, aside, *others], [low, high, aside, *nearer], [low, aside, *nearer], [low, *others]):
        assert rays.look_for(here, here) == RayVisibility([view()]).look_for(here, here)


def test_places_of_a_solid_are_looked_for_together_as_each_alone() -> None:
    tower = [solid(f"cube_{k}", Pose((0.35, 0.0, 0.02 + 0.04 * k))) for k in range(3)]
    places = [solid("cube_0", Pose((0.29 + 0.01 * step, 0.0, 0.02))) for step in range(13)]
    rays = RayVisibility([view()], [solid("link", Pose((0.42, 0.0, 0.2)))])
    alone = [rays.visibilities([place, *tower[1:]])["overhead", "cube_0"] for place in places]
    assert [by_camera["overhead"] for by_camera in rays.look_for(places, tower)] == alone
    assert {visible.hidden_by for visible in alone} >= {"", "cube_1", "link"}
    assert rays.look_for([solid("other", Pose((0.35, 0.0, 0.02)))], tower)[0]["overhead"].hidden_by == "cube_1"
    assert rays.look_for([], tower) == []


def test_touching_neighbours_hide_nothing_of_each_other() -> None:
    assert set(shares(*(solid(f"c{k}", Pose((0.27 + 0.04 * k, 0.1, 0.02))) for k in range(5))).values()) == {1.0}


@pytest.mark.parametrize(
    ("pose", "size"),
    [
        (Pose((0.35, 0.6, 0.02)), CUBE),
        (Pose((0.35, 0.0, 0.9)), CUBE),
        (Pose.from_rotvec((0.35, 0.0, 0.02), (math.pi, 0.0, 0.0)), CUBE),
        (Pose.from_rotvec((0.35, 0.0, 0.02), (math.radians(80.0), 0.0, 0.0)), CUBE),
        (Pose((0.35, 0.0, 0.02)), (0.01, 0.04, 0.04)),
    ],
    ids=["outside the image", "behind the camera", "upside down", "too steep", "too small"],
)
def test_what_cannot_be_found_counts_as_unseen(pose: Pose, size: tuple[float, float, float]) -> None:
    assert shares(solid("thing", pose, size)) == {"thing": 0.0}


def test_at_the_edge_of_the_image_a_part_is_seen() -> None:
    assert 0.0 < shares(solid("cube", Pose((0.35, 0.325, 0.02))))["cube"] < 1.0


def uncertain(camera: Pose, twists: np.ndarray) -> Pose:
    """With the covariance of some perturbations (n, 6)."""
    return camera.with_covariance(twists.T @ twists / len(twists))


def test_what_may_be_outside_the_image_as_the_camera_may_be_elsewhere_counts_as_unseen() -> None:
    edge, middle = solid("edge", Pose((0.35, 0.3, 0.02))), solid("middle", Pose((0.35, 0.0, 0.02)))
    assert shares(edge, middle) == {"edge": 1.0, "middle": 1.0}
    camera = uncertain(OVERHEAD, np.diag([0.005, 0.005, 0.005, 0.02, 0.02, 0.02]) * math.sqrt(6.0))
    assert RayVisibility([view(camera)]).shares([edge, middle]) == {
        ("overhead", "edge"): 0.0,
        ("overhead", "middle"): 1.0,
    }


def test_what_the_camera_is_surely_seen_to_show_is_so_however_uncertain_its_pose_is() -> None:
    """Turned about the cube at the edge, the camera sees that where it was."""
    edge = solid("edge", Pose((0.35, 0.3, 0.02)))
    centre = OVERHEAD.inverse() @ Pose((0.35, 0.3, 0.04))
    turns = np.random.default_rng(0).normal(0.0, 0.01, (200, 3))
    shifts = np.cross(centre.t, turns)
    assert RayVisibility([view(uncertain(OVERHEAD, np.hstack([shifts, turns])))]).shares([edge]) == {
        ("overhead", "edge"): 1.0
    }
    assert RayVisibility([view(uncertain(OVERHEAD, np.hstack([-shifts, turns])))]).shares([edge]) == {
        ("overhead", "edge"): 0.0
    }


def test_obstacles_hide_but_the_housing_that_the_camera_is_in_does_not() -> None:
    cube = solid("cube", Pose((0.35, 0.0, 0.02)))
    arm = solid("arm", Pose((0.35, 0.0, 0.3)), (0.1, 0.1, 0.1))
    housing = solid("housing", OVERHEAD, (0.05, 0.05, 0.05))
    assert shares(cube, obstacles=(arm,)) == {"cube": 0.0}
    assert shares(cube, obstacles=(housing,)) == {"cube": 1.0}


def test_what_is_behind_much_of_what_the_camera_is_in_cannot_be_judged() -> None:
    below, aside = solid("below", Pose((0.35, 0.0, 0.02))), solid("aside", Pose((0.35, 0.25, 0.02)))
    gripper = Solid("gripper", (0.125, 0.075, 0.135), (0.35, -0.035, 0.59))
    visibilities = RayVisibility([view()], [gripper]).visibilities([below, aside])
    assert visibilities["overhead", "below"] == ExpectedVisibility(0.0, "gripper")
    assert visibilities["overhead", "aside"] == ExpectedVisibility(1.0, "")


def test_each_camera_looks_for_itself_and_a_copy_sees_the_same() -> None:
    turned_away = Pose((0.35, 0.0, 0.65), (0.0, 0.0, 0.0, 1.0))
    rays = RayVisibility([view(), view(turned_away, "up")])
    cube = solid("cube", Pose((0.35, 0.0, 0.02)))
    expected = {("overhead", "cube"): 1.0, ("up", "cube"): 0.0}
    assert rays.shares([cube]) == pickle.loads(pickle.dumps(rays)).shares([cube]) == expected
    assert rays.shares([]) == RayVisibility([]).shares([cube]) == {}


@pytest.mark.parametrize("seed", range(4))
def test_it_agrees_with_the_plant(seed: int) -> None:
    """Random heaps in the air: its tag sensor sees a tag if the share is all of it, but for rays near an edge."""
    rng = np.random.default_rng(seed)
    specs = [ObjectSpec(name=f"cube_{k}", marker_id=k, position=(0.1 * k, 1.0, 0.02)) for k in range(20)]
    bullet = Bullet()
    try:
        world, hands = World(bullet, TableSpec(), specs), Hands(bullet, (), seen=False)
        agree = seen = partly = 0
        for _ in range(15):
            for spec in specs:
                turn = rng.normal(0.0, 0.4, 3)
                world.put(spec.name, Pose.from_rotvec(rng.uniform((0.1, -0.33, 0.02), (0.6, 0.33, 0.3)), turn))
            eye = OVERHEAD @ Pose.from_rotvec(rng.normal(0.0, 0.05, 3), rng.normal(0.0, 0.2, 3))
            camera = SimulatedCamera(
                "overhead", LENS, partial(Pose.__matmul__, eye, Pose.identity()), SensorModel(SensorSpec(), [], rng)
            )
            found = RayVisibility([view(eye)]).shares([solid(name, pose) for name, pose in world.poses().items()])
            recognised = set(recognisable(camera, world, hands))
            for spec in specs:
                sees = spec.name in recognised
                share = found["overhead", spec.name]
                agree += sees == (share == 1.0)
                seen += sees
                partly += 0.05 < share < 0.95
                assert not sees or share > 0.6
    finally:
        bullet.close()
    assert agree >= 0.97 * 15 * 20
    assert seen > 60
    assert partly > 20


@pytest.mark.parametrize("seed", range(2))
def test_shares_of_colours_are_those_of_pixels(seed: int) -> None:
    """Heaps of containers, cups and balls in the air, beside the pixels that show them with and without all others."""
    rng = np.random.default_rng(seed)
    models = {name: load_model(file) for name, file in model_files().items() if name != "large_box"}
    specs = [
        ObjectSpec(name=name, type="box", size=model.size, shape=model.shape, position=(0.3 * k, 2.0, 0.2))
        for k, (name, model) in enumerate(sorted(models.items()))
    ]
    bullet = Bullet()
    try:
        renderer, intrinsics = Renderer(bullet, "tiny"), Intrinsics.from_fov(240, 180, 0.98)
        world = World(bullet, TableSpec(), specs)
        errors = []
        for _ in range(6):
            for spec in specs:
                place = Pose.from_rotvec(rng.uniform((0.25, -0.17, 0.11), (0.45, 0.17, 0.25)), rng.normal(0.0, 1.0, 3))
                world.put(spec.name, place)
            poses = world.poses()
            solids = [
                Solid(spec.name, spec.size, poses[spec.name].t, poses[spec.name].q, shape=spec.shape) for spec in specs
            ]
            rays = RayVisibility([CameraView("overhead", OVERHEAD, intrinsics)], by_color=list(models))
            found, counts = rays.shares(solids), pixels(renderer, world, intrinsics)
            for spec in specs:
                if not is_in_image(poses[spec.name], spec, intrinsics):
                    continue
                with world.shown_at({name: Pose((0.0, 0.0, -30.0)) for name in poses if name != spec.name}):
                    alone = pixels(renderer, world, intrinsics)[spec.name]
                errors.append(found["overhead", spec.name] - counts[spec.name] / alone)
    finally:
        bullet.close()
    assert len(errors) > 10
    assert np.abs(errors).mean() < 0.05
    assert np.abs(errors).max() < 0.15


def pixels(renderer: Renderer, world: World, intrinsics: Intrinsics) -> dict[str, int]:
    """How many pixels show each object."""
    picture = renderer.render(OVERHEAD, intrinsics, bodies=True)
    assert picture.bodies is not None
    return {name: int((picture.bodies == world.body(name)).sum()) for name in world}


def is_in_image(pose: Pose, spec: ObjectSpec, intrinsics: Intrinsics) -> bool:
    """Whether all of an object is in the image: what is outside counts as unseen, and has no pixels."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    found = intrinsics.project((OVERHEAD.inverse() @ pose).apply(signs * np.array(spec.size) / 2))
    return bool((found >= 0).all() and (found <= (intrinsics.width - 1, intrinsics.height - 1)).all())


def test_a_container_hides_what_is_beside_it_but_not_what_is_in_it() -> None:
    model = load_model(model_files()["container_green"])
    box = Solid("green", model.size, (0.35, 0.0, 0.06), shape=model.shape)
    ball = load_model(model_files()["ball"])
    inside = Solid("ball", ball.size, (0.35, 0.0, 0.034), shape=ball.shape)
    visibilities = RayVisibility([view()], by_color=("green", "ball")).visibilities([box, inside])
    assert visibilities["overhead", "ball"].share > 0.95
    assert 0.5 < visibilities["overhead", "green"].share < 0.95
    assert visibilities["overhead", "green"].hidden_by == "ball"
    lid = Solid("lid", (0.16, 0.16, 0.01), (0.35, 0.0, 0.125))
    visibilities = RayVisibility([view()], by_color=("green", "ball")).visibilities([box, inside, lid])
    assert visibilities["overhead", "ball"] == ExpectedVisibility(0.0, "lid", tagged=False)


def test_a_wall_hides_a_tag() -> None:
    model = load_model(model_files()["container_green"])
    low, high = Pose((0.35, 0.0, 0.02)), Pose((0.35, 0.0, 0.16))
    eye = Pose.from_rotvec((0.35, -0.35, 0.35), (math.radians(-135.0), 0.0, 0.0))
    for pose, share in ((low, 0.0), (high, 1.0)):
        box = Solid("green", model.size, (0.35, 0.0, 0.06), shape=model.shape)
        assert RayVisibility([view(eye)]).shares([solid("cube", pose), box])["overhead", "cube"] == share


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("far", [1e7, 1e200, -1e308])
def test_nonsense_is_somewhere_far_away(far: float) -> None:
    things = [
        solid("far", Pose.unchecked((far, far, far), (0.0, 0.0, 0.0, 1.0))),
        solid("large", Pose((0.35, 0.0, -0.5)), (abs(far),) * 3),
        solid("cube", Pose((0.35, 0.0, 0.02))),
    ]
    for by_color in ((), ("far", "large", "cube")):
        rays = RayVisibility(
            [view(), view(Pose.unchecked((far, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), "lost")], by_color=by_color
        )
        assert rays.shares(things)["overhead", "far"] == 0.0
