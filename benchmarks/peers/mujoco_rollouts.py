"""MuJoCo as a peer: many rollouts of one scene of boxes at once, by its own pool of threads (`mujoco.rollout`)."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from dsr.math3d.quaternions import Quaternion
from simulation_handler.physics.rollouts.scene import RolloutBody, RolloutScene
from simulation_handler.physics.simulator import TIME_STEP

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_POSE = 7  # coordinates of a free joint: position, quaternion


class MujocoRollouts:
    """Scenes with the bodies of one scene, which are boxes. A context manager.

    Args:
        scene: its fixed bodies stay where they are.
        threads: that simulate at the same time.
    """

    def __init__(self, scene: RolloutScene, threads: int) -> None:
        self._model = mujoco.MjModel.from_xml_string(_model_text(scene))
        self._data = [mujoco.MjData(self._model) for _ in range(threads)]
        self._free = [body.name for body in scene.bodies if not body.fixed]
        self._rollout = Rollout(nthread=threads)

    def __enter__(self) -> MujocoRollouts:
        return self

    def __exit__(self, *_: object) -> None:
        self._rollout.close()

    def run(self, scenes: Sequence[RolloutScene], seconds: float) -> np.ndarray:
        """Simulate all scenes to the end (s); positions (scenes, bodies, 3) of what is not fixed, m."""
        states = np.array([self._state(scene) for scene in scenes])
        ends = self._rollout.rollout([self._model], self._data, states, nstep=round(seconds / TIME_STEP))[0][:, -1]
        poses = ends[:, 1 : 1 + _POSE * len(self._free)]  # the time stands before them
        return np.array(poses.reshape(len(scenes), -1, _POSE)[:, :, :3])

    def _state(self, scene: RolloutScene) -> np.ndarray:
        data, state = self._data[0], np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = np.concatenate([(*scene[name].position, *_wxyz(scene[name].rotation)) for name in self._free])
        mujoco.mj_getState(self._model, data, state, _STATE)
        return state


def _model_text(scene: RolloutScene) -> str:
    bodies = "".join(_body_text(body) for body in scene.bodies)
    return f'<mujoco><option timestep="{TIME_STEP}"/><worldbody>{bodies}</worldbody></mujoco>'


def _body_text(body: RolloutBody) -> str:
    half, place = (" ".join(str(number) for number in numbers) for numbers in (np.divide(body.size, 2), body.position))
    joint, mass = ("", "") if body.fixed else ("<freejoint/>", f'mass="{body.mass}"')
    geometry = f'<geom type="box" size="{half}" friction="{body.friction}" {mass}/>'
    return f'<body name="{body.name}" pos="{place}">{joint}{geometry}</body>'


def _wxyz(rotation: Quaternion) -> tuple[float, float, float, float]:
    x, y, z, w = rotation
    return w, x, y, z
