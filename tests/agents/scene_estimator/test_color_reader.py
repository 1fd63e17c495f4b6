"""Objects recognised by their colour in rendered images: right where they are sure, and unsure where they are not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import msgspec
import numpy as np
import pytest

from agents import colors
from agents.object_models import load_model, model_files
from agents.scenario.format.scenario import ObjectSpec
from agents.scene_estimator import color_reader, placing
from agents.scene_estimator.color_reader import ColorReader
from agents.scene_estimator.colored import LEANING, ColoredObject, ColorSighting
from agents.scene_estimator.placing import Guess, Placed
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.segmentation import ColorImage
from agents.scene_estimator.turning import nearest_alike
from benchmarks.color_scene import AWAY, ColorScene, looking_at
from dsr import Pose
from dsr.errors import WireError
from dsr.math3d import transforms
from dsr.math3d.shapes import to_numbers

from .conftest import AGE, PERIOD, Bench

MODELS = sorted(model_files())
GREY = ObjectSpec(name="screen", type="box", size=(0.3, 0.3, 0.02), color=(0.5, 0.5, 0.5), position=(0.0, 0.0, -9.0))
PLACE = (0.35, 0.02)
NO_BIAS = NoiseModel(depth_bias_std=0.0)


@pytest.fixture(scope="module")
def scene() -> Iterator[ColorScene]:
    scene = ColorScene(MODELS, np.random.default_rng(0), [GREY])
    yield scene
    scene.close()


@pytest.fixture(autouse=True)
def clear(scene: ColorScene) -> None:
    for name in (*MODELS, "screen"):
        scene.put(name, AWAY)


def standing(scene: ColorScene, model: str, yaw: float = 0.0) -> Pose:
    pose = Pose.from_rotvec((*PLACE, scene.height(model)), (0.0, 0.0, yaw))
    scene.put(model, pose)
    return pose


def read(scene: ColorScene, camera: Pose, reader: ColorReader | None = None) -> dict[str, ColorSighting]:
    found = (reader or ColorReader(NO_BIAS)).read(scene.frame(camera), scene.known, camera)
    return {sighting.name: sighting for sighting in found}


def judged(sighting: ColorSighting, camera: Pose, truth: Pose) -> tuple[float, float]:
    """Error (m), and its square over the covariance: 3 on average if that is right."""
    error = sighting.position - camera.inverse().apply(truth.t)
    return float(np.linalg.norm(error)), float(error @ np.linalg.solve(sighting.covariance, error))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("distance", "most"), [(0.6, 0.008), (1.0, 0.02)])
def test_what_stands_free_is_where_it_is_seen(scene: ColorScene, model: str, distance: float, most: float) -> None:
    rng = np.random.default_rng(3)
    for yaw in (0.0, 0.7):
        truth, camera = standing(scene, model, yaw), looking_at((*PLACE, 0.05), distance, rng)
        found = read(scene, camera)
        assert list(found) == [model]
        error, nees = judged(found[model], camera, truth)
        assert error < most
        assert nees < 12.0


@pytest.mark.parametrize("model", ["cup", "ball", "container_green", "box"])
def test_what_is_partly_hidden_is_right_or_unsure_or_not_found(scene: ColorScene, model: str) -> None:
    rng = np.random.default_rng(4)
    shares = []
    for _ in range(8):
        truth, camera = standing(scene, model), looking_at((*PLACE, 0.05), 0.8, rng, spread=0.0)
        scene.put("screen", AWAY)
        alone = scene.pixels(model, camera)
        scene.put("screen", camera @ Pose((0.15 + rng.uniform(-0.03, 0.03), 0.0, 0.5)))
        shares.append(scene.pixels(model, camera) / alone)
        found = read(scene, camera)
        if shares[-1] < 0.2:
            assert not found
        elif found:
            assert judged(found[model], camera, truth)[1] < 12.0
        assert found or shares[-1] < 0.6
    assert min(shares) < 0.6 < max(shares)


@pytest.mark.parametrize("degrees", [30, 90, 135])
def test_what_was_never_seen_upright_is_found_as_it_is_turned(scene: ColorScene, degrees: float) -> None:
    rng, off = np.random.default_rng(5), []
    for model in ("cup", "container_green", "large_box"):
        for _ in range(3):
            axis = rng.normal(size=3) * (1.0, 1.0, 0.0)
            truth = Pose.from_rotvec((*PLACE, 0.25), axis / np.linalg.norm(axis) * math.radians(degrees))
            scene.put(model, truth)
            camera, reader = looking_at((*PLACE, 0.25), 0.9, rng), ColorReader(NO_BIAS)
            assert all(sighting.lean is None for sighting in read(scene, camera, reader).values())
            if (found := read(scene, camera, reader).get(model)) is not None:
                assert judged(found, camera, truth)[1] < 20.0
                off += [] if found.lean is None else [off_alike(found, truth, model == "large_box")]
        scene.put(model, AWAY)
    assert len(off) >= 2
    assert max(off) < 3.0 * LEANING


def off_alike(sighting: ColorSighting, truth: Pose, is_box: bool) -> float:
    """rad, by which a tilt is off; a box looks the same upside down."""
    off = tilted_off(sighting, truth)
    return min(off, math.pi - off) if is_box else off


@pytest.mark.parametrize(("model", "seed"), [("container_green", 0), ("cover_large", 1), ("cup", 2)])
def test_what_is_tilted_and_put_back_is_followed(scene: ColorScene, model: str, seed: int) -> None:
    rng, reader = np.random.default_rng(seed), ColorReader(NO_BIAS)
    camera, azimuth, yaw = looking_at((*PLACE, 0.25), 1.3, rng), rng.uniform(0.0, 2 * math.pi), rng.uniform(-0.1, 0.1)
    axis = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    off, degrees = [], (*(0,) * 3, *range(0, 140, 6), *(135,) * 3, *range(135, -1, -6), *(0,) * 4)
    for angle in degrees:
        lean = Pose.from_rotvec((*PLACE, 0.25), axis * math.radians(angle))
        truth = lean @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
        scene.put(model, truth)
        sighting = read(scene, camera, reader)[model]
        assert np.linalg.norm(sighting.position - camera.inverse().apply(truth.t)) < 0.025
        off += [] if sighting.lean is None else [tilted_off(sighting, truth)]
    assert len(off) > 0.8 * len(degrees)
    assert max(off) < 3.0 * LEANING
    assert np.median(off) < 0.5 * LEANING


@pytest.mark.parametrize(("model", "yaw"), [("container_green", 0.3), ("container_green", -0.1), ("cover_large", 0.5)])
def test_the_yaw_of_what_has_corners_is_seen(scene: ColorScene, model: str, yaw: float) -> None:
    rng, errors = np.random.default_rng(7), []
    truth = standing(scene, model, yaw)
    for distance in (0.7, 1.0, 1.3):
        camera, reader = looking_at((*PLACE, 0.05), distance, rng), ColorReader(NO_BIAS)
        for _ in range(6):
            sighting = read(scene, camera, reader)[model]
        if math.isfinite(sighting.yaw_sigma):
            errors.append(abs(nearest_alike(sighting.yaw, yaw, 4) - yaw))
            assert errors[-1] < 4.0 * sighting.yaw_sigma
            assert (camera @ sighting.pose(camera)).distance(truth)[1] < errors[-1] + 1e-6
    assert errors and max(errors) < 0.1


def test_nobody_sees_how_a_cup_or_a_ball_is_turned(scene: ColorScene) -> None:
    rng = np.random.default_rng(8)
    for model in ("cup", "ball"):
        standing(scene, model, 0.2)
        camera, reader = looking_at((*PLACE, 0.05), 0.8, rng), ColorReader(NO_BIAS)
        assert all(math.isinf(read(scene, camera, reader)[model].yaw_sigma) for _ in range(3))
        scene.put(model, AWAY)


def test_nobody_sees_a_ball_lean(scene: ColorScene) -> None:
    rng, reader = np.random.default_rng(0), ColorReader(NO_BIAS)
    camera = looking_at((*PLACE, 0.25), 1.4, rng)
    for degrees in range(0, 130, 6):
        scene.put("ball", Pose.from_rotvec((*PLACE, 0.25), (math.radians(degrees), 0.0, 0.0)))
        assert read(scene, camera, reader)["ball"].lean is None


def tilted_off(sighting: ColorSighting, truth: Pose) -> float:
    """rad, between where the object's own z axis is seen to point and where it does."""
    assert sighting.lean is not None
    seen = Pose((0.0, 0.0, 0.0), sighting.lean).rotation_matrix[:, 2]
    return math.acos(min(float(seen @ truth.rotation_matrix[:, 2]), 1.0))


def test_all_at_once(scene: ColorScene) -> None:
    """A ball in a container and things side by side, from above."""
    places = {"container_green": (0.25, 0.15), "ball": (0.25, 0.15)}
    places |= {"cup": (0.25, -0.1), "box": (0.4, 0.0), "lid": (0.45, 0.2)}
    truths = {name: Pose((x, y, scene.height(name) + 0.004 * (name == "ball"))) for name, (x, y) in places.items()}
    for name, truth in truths.items():
        scene.put(name, truth)
    camera = Pose((0.35, 0.03, 0.8), (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0))
    found = read(scene, camera)
    assert set(found) == set(places)
    assert max(judged(found[name], camera, truth)[0] for name, truth in truths.items()) < 0.006


TALL = ObjectSpec(
    name="tall", type="box", marker_id=203, size=(0.046, 0.047, 0.112), color=(0.64, 0.11, 0.32), position=AWAY.t
)


@pytest.fixture(scope="module")
def far() -> Iterator[ColorScene]:
    """A box whose tag is too far away to be read."""
    scene = ColorScene([], np.random.default_rng(0), [TALL], width=400)
    yield scene
    scene.close()


def from_afar(degrees: float) -> Pose:
    """The pose of a camera 1.4 m from a box, so far above the horizon."""
    up = math.radians(degrees)
    eye = (PLACE[0] + 1.4 * math.cos(up), PLACE[1], 0.05 + 1.4 * math.sin(up))
    return transforms.looking_at(eye, (*PLACE, 0.05))


@pytest.mark.parametrize("degrees", [45, 60, 70])
def test_what_has_a_tag_is_placed_by_the_faces_that_have_its_colour(far: ColorScene, degrees: float) -> None:
    """Seen from higher up, more of it is white."""
    assert TALL.color is not None
    errors, known = [], ColoredObject(TALL.name, TALL.color, TALL.size, (), tagged=True)
    camera = from_afar(degrees)
    for yaw in (0.0, 0.4, 0.8, 1.2):
        truth = Pose.from_rotvec((*PLACE, far.height(TALL.name)), (0.0, 0.0, yaw))
        far.put(TALL.name, truth)
        reader = ColorReader(NO_BIAS)
        for _ in range(2):
            (found,) = reader.read(far.frame(camera), [known], camera)
        error, nees = judged(found, camera, truth)
        errors.append(error)
        assert nees < 12.0
        assert found.lean is None and math.isinf(found.yaw_sigma), "only its tag tells sides apart that look alike"
    assert np.mean(errors) < 0.004


def test_the_agent_sees_by_its_colour_what_has_a_tag_that_is_not_read(
    far: ColorScene, make_bench: Callable[..., Bench]
) -> None:
    bench, camera = make_bench(), from_afar(45.0)
    bench.memory.add_edge("world", "camera_overhead", "RT", pose=camera)
    bench.memory.add_node(TALL.name, "box", size=TALL.size, color=TALL.color, marker_id=TALL.marker_id)
    truth = Pose((*PLACE, far.height(TALL.name)))
    far.put(TALL.name, truth)
    bench.run(PERIOD)
    bench.show(far.frame(camera), ticks=2)
    assert bench.perceived(TALL.name) is True
    assert bench.memory.transform("world", TALL.name).t == pytest.approx(truth.t, abs=0.015)


@pytest.mark.parametrize("brightness", [0.45, 0.7, 1.0])
def test_neither_table_nor_cubes_nor_other_models_match(brightness: float) -> None:
    models = {name: load_model(file).color for name, file in model_files().items()}
    around = (colors.TABLE, colors.FLOOR, colors.SKIN, colors.SLEEVE, colors.GREY)
    stripes = [*colors.PALETTE, *around, *models.values()]
    noise = np.random.default_rng(0).normal(0.0, 2.0, (60, 20 * len(stripes), 1))
    image = np.repeat(np.repeat(np.array([stripes]), 60, axis=0), 20, axis=1) * 255 * brightness + noise
    picture = ColorImage(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    for name, color in models.items():
        assert color is not None
        wanted = np.repeat([other == color for other in stripes], 20)
        mask = picture.mask(color)
        assert mask[:, ~wanted].mean() < 1e-3, name
        assert mask[:, wanted].mean() > 0.9, name


def test_no_depth_and_nothing_to_see_is_no_sighting(scene: ColorScene) -> None:
    camera = looking_at((*PLACE, 0.05), 0.8, np.random.default_rng(6))
    assert read(scene, camera) == {}
    standing(scene, "cup")
    frame = scene.frame(camera)
    colored = msgspec.structs.replace(frame, arrays={"color": frame.arrays["color"]})
    assert ColorReader(NO_BIAS).read(colored, scene.known, camera) == []
    for depth in (np.nan, 0.0, -1.0):
        nonsense = np.full_like(frame.arrays["depth"], depth)
        odd = msgspec.structs.replace(frame, arrays={**frame.arrays, "depth": nonsense})
        assert ColorReader(NO_BIAS).read(odd, scene.known, camera) == []
    endless = msgspec.structs.replace(frame, arrays={**frame.arrays, "depth": np.full_like(nonsense, 1e30)})
    with pytest.raises(WireError, match="in millimetres"):
        ColorReader(NO_BIAS).read(endless, scene.known, camera)


def test_the_agent_writes_what_it_sees(scene: ColorScene, make_bench: Callable[..., Bench]) -> None:
    bench = make_bench()
    camera = Pose((*PLACE, 0.7), (math.sqrt(0.5), -math.sqrt(0.5), 0.0, 0.0))
    bench.memory.add_edge("world", "camera_overhead", "RT", pose=camera)
    ball = next(known for known in scene.known if known.name == "ball")
    bench.memory.add_node("ball", "ball", size=ball.size, color=ball.color, shape=to_numbers(ball.shape))
    truth = standing(scene, "ball")
    bench.run(PERIOD)
    bench.show(scene.frame(camera), ticks=2)
    assert bench.perceived("ball") is True
    assert bench.memory.transform("world", "ball").t == pytest.approx(truth.t, abs=3e-3)
    scene.put("ball", AWAY)
    bench.show(scene.frame(camera), ticks=1)
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived("ball") is False


def searches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts searches of all rotations, all of them in vain, in a list with one number."""
    count = [0]

    def anyhow(*_: object) -> None:
        count[0] += 1

    monkeypatch.setattr(placing, "anyhow", anyhow)
    return count


def test_what_fits_in_no_way_is_searched_in_vain_ever_more_rarely(
    scene: ColorScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames in which it is out of view count as well, and those in which it fits do not make the pause longer."""
    count = searches(monkeypatch)
    monkeypatch.setattr(color_reader, "_LONGEST_PAUSE", 40)
    camera, reader = looking_at((*PLACE, 0.25), 0.9, np.random.default_rng(0)), ColorReader(NO_BIAS)
    empty = scene.frame(camera)
    standing(scene, "container_green")
    upright = scene.frame(camera)
    scene.put("container_green", Pose.from_rotvec((*PLACE, 0.25), (math.radians(50), 0.3, 0.0)))
    fallen, known = scene.frame(camera), [one for one in scene.known if one.name == "container_green"]
    searched = []
    for shown in (*[upright] * 30, *[fallen] * 34, *[empty] * 39, *[fallen] * 85, *[upright] * 15, *[fallen] * 12):
        before = count[0]
        reader.read(shown, known, camera)
        searched.append(count[0] > before)
    found = np.flatnonzero(searched)
    assert list(np.diff(found)) == [11, 21, 41, 41, 41, 18, 11]
    assert found[0] == 30, "it is searched at once when it falls"


def test_only_one_object_is_searched_in_a_frame(scene: ColorScene, monkeypatch: pytest.MonkeyPatch) -> None:
    count, names = searches(monkeypatch), ("container_green", "large_box", "cup")
    for k, name in enumerate(names):
        scene.put(name, Pose.from_rotvec((PLACE[0], PLACE[1] + 0.2 * (k - 1), 0.25), (math.radians(50), 0.3, 0.0)))
    camera, reader = looking_at((*PLACE, 0.25), 1.3, np.random.default_rng(0)), ColorReader(NO_BIAS)
    shown, known = scene.frame(camera), [one for one in scene.known if one.name in names]
    counts = [count[0] for _ in range(5) if reader.read(shown, known, camera) is not None]
    assert counts == [1, 2, 3, 3, 3]


def test_after_a_gap_nobody_knows_how_a_thing_is_turned_that_was_followed(
    scene: ColorScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And of what is not looked for any more nothing is kept: who makes up names could make up any number."""
    followed = []

    def noted(*told: object, **_: object) -> Placed:
        guess = next(one for one in told if isinstance(one, Guess))
        followed.append(guess.followed)
        return Placed(np.ones(3), np.eye(3), guess._replace(followed=True), True, None, math.inf)

    monkeypatch.setattr(color_reader, "place", noted)
    standing(scene, "cup")
    camera, reader = looking_at((*PLACE, 0.05), 0.9, np.random.default_rng(0)), ColorReader(NO_BIAS)
    shown, known = scene.frame(camera), [one for one in scene.known if one.name == "cup"]
    for stamp in (0.0, 0.1, 0.2, 10.0, 10.1):
        reader.read(msgspec.structs.replace(shown, stamp=stamp), known, camera)
    assert followed == [False, True, True, False, True]
    scene.put("cup", AWAY)
    reader.read(msgspec.structs.replace(scene.frame(camera), stamp=10.2), known, camera)
    reader.read(msgspec.structs.replace(shown, stamp=10.3), known, camera)
    assert len(followed) == 6 and not followed[-1], "it was out of view in between"
    reader.read(shown, scene.known[:1], camera)
    assert set(reader._known) == {scene.known[0].name}
