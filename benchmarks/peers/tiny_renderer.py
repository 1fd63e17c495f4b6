"""The renderer of pybullet as a peer: a segmentation picture of boxes, cylinders and spheres, on the processor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet

from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose
from dsr.visibility import Body
from dsr.vocabulary.intrinsics import Intrinsics

_NEAR, _FAR = 0.01, 10.0  # m
_GEOMETRIES = (pybullet.GEOM_BOX, pybullet.GEOM_CYLINDER, pybullet.GEOM_SPHERE)


class TinyScene:
    """Bodies in a client of its own. A context manager."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._client = pybullet.connect(pybullet.DIRECT)
        for body in bodies:
            solids = body.solids
            for k in range(len(solids.kinds)):
                self._add(int(solids.kinds[k]), solids.centre[k], solids.rotation[k], solids.half[k])

    def __enter__(self) -> TinyScene:
        return self

    def __exit__(self, *_: object) -> None:
        pybullet.disconnect(self._client)

    def picture(self, view: Pose, intrinsics: Intrinsics) -> np.ndarray:
        """(h, w) number of the part that is seen in each pixel; -1 for none."""
        matrix = np.diag([1.0, -1.0, -1.0, 1.0]) @ view.inverse().matrix
        up = 2.0 * np.arctan(intrinsics.height / 2.0 / intrinsics.fy)
        projection = pybullet.computeProjectionMatrixFOV(
            np.degrees(up), intrinsics.width / intrinsics.height, _NEAR, _FAR
        )
        *_, segments = pybullet.getCameraImage(
            intrinsics.width, intrinsics.height, matrix.T.ravel().tolist(), projection, shadow=0,
            renderer=pybullet.ER_TINY_RENDERER, physicsClientId=self._client,
        )  # fmt: skip
        return np.asarray(segments).reshape(intrinsics.height, intrinsics.width)

    def _add(self, kind: int, centre: np.ndarray, turn: np.ndarray, half: np.ndarray) -> None:
        sizes = ({"halfExtents": half.tolist()}, {"radius": half[0], "length": 2 * half[2]}, {"radius": half[0]})[kind]
        shape = pybullet.createVisualShape(_GEOMETRIES[kind], physicsClientId=self._client, **sizes)
        turned = quaternions.from_matrix(turn.tolist())
        pybullet.createMultiBody(0, -1, shape, centre.tolist(), turned, physicsClientId=self._client)
