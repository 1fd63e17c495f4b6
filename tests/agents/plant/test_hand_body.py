"""The looks of hands in the physics client: each figure has a mesh, all have one picture of the skin."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from agents.plant.bullet import Bullet
from agents.plant.hand_body import NOWHERE, HandBody, _skin_folder
from agents.plant.hand_figure import relaxed
from agents.plant.renderer import Renderer
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

FOREARM = (np.array((0.0, -0.1, 0.0)), np.array((0.0, -0.3, 0.0)))


def test_figures_share_a_picture_and_leave_no_files() -> None:
    """The renderer keeps what it read by the name of the file: a picture for each figure filled the memory."""
    bullet = Bullet()
    renderer = Renderer(bullet, "tiny")
    hand = HandBody(bullet, "right")
    camera, intrinsics = Pose.from_rotvec((0.0, 0.0, 0.5), (np.pi, 0.0, 0.0)), Intrinsics.from_fov(64, 48, 0.98)
    shown = []
    for tips in (relaxed("right"), relaxed("right") + 0.005):
        hand.put(Pose((0.0, 0.0, 0.0)), tips, FOREARM)
        shown.append(renderer.render(camera, intrinsics, bodies=True))
    hand.put(NOWHERE, relaxed("right"), FOREARM)
    bullet.close()
    for body, picture in enumerate(shown, start=1):  # the sleeve is the first one
        assert len(np.unique(picture.color[picture.bodies == body], axis=0)) > 10  # shaded and painted
    assert sorted(path.name for path in Path(_skin_folder("right").name).iterdir()) == ["hand.mtl", "hand.png"]
