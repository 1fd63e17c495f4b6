"""The system of agents that plays a scenario, configured for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec

from agents.arm_controller.arm_model import load_arm
from agents.scenario.format.events import Kill
from agents.scenario.format.model import RobotSpec, Scenario
from agents.scenario.format.scenario import find_scenario, load_scenario
from agents.urdf_files import find_robot
from dsr.config.extras import check_installed
from dsr.errors import ConfigError
from dsr.runtime.system import System, find_system, load_system

Sensor = Literal["pixels", "poses"]
"""The output of the plant's camera: rendered images, or the poses that would be measured in them."""


Policy = Literal["hypotheses", "algorithm1", "published"]
"""Explain surprises by simulated hypotheses, or by Algorithm 1 of the CORTEX paper; or reason as Sallami et al. did,
and infer actions as they did."""
PLANT = "plant"
"""Name of the agent that plays the simulated reality."""
ARM = "arm_controller"
"""Name of the agent that moves the arm."""
MISSION = "mission"
"""Name of the agent that pursues the scenario's `[mission]`."""


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """A run of a scenario, before it begins."""

    scenario: Scenario
    file: Path
    """The scenario's file; agents read it again."""
    seed: int = 0
    sensor: Sensor = "pixels"
    robot: str = ""
    """Name of a robot in `etc/robots`, or path of a URDF file, in place of the scenario's."""
    policy: Policy | None = None
    """Name of the method that explains surprises; None for the simulation handler's own choice."""
    folder: Path | None = None
    """Gets recording, logs and result; None for nothing of that."""
    viewer: bool = False
    """Let the viewer run along in lockstep; in a live run it always does."""
    window: bool = False
    """Open the viewer's window."""
    beside: bool = True
    """Modules beside the file of the system may be imported."""


def make_run(name_or_path: str | Path, **options: Any) -> Run:
    """Prepare the run of a built-in scenario or a file. Raises `ConfigError`."""
    file = find_scenario(name_or_path)
    return Run(scenario=load_scenario(file), file=file.resolve(), **options)


def staged_system(run: Run) -> System:
    """The system of the scenario, configured for this run. Raises `ConfigError`.

    An agent that the scenario kills has a process of its own: no other agent dies with it.
    An agent that the system does not have needs no configuration; without a folder nothing is recorded.
    A mission is refused where the libraries of those who would pursue it are not installed: nothing would happen.
    """
    system = load_system(find_system(run.scenario.system, run.file.parent), beside=run.beside)
    if run.scenario.mission is None:
        system = without(system, MISSION)
    else:
        for spec in system.agents:
            check_installed(spec.kind.goal_libraries, f"scenario {run.scenario.name!r} has a mission for {spec.name!r}")
    for agent, fields in _settings(run).items():
        if agent in _names(system):
            system = system.with_config(agent, **fields)
    if ARM in _names(system) and (run.robot or _is_other_robot(run.scenario.robot)):
        system = _with_robot(system, run)
    system = system.apart(*_names(system).intersection(_killed(run.scenario)))
    if "recorder" in _names(system):
        system = system.with_config("recorder", about=_about(run, system))
    return system if run.folder else without(system, "recorder", "viewer")


def plant_alone(run: Run) -> System:
    """The simulated reality of the scenario without anybody who looks at it. Raises `ConfigError`."""
    system = load_system(find_system(run.scenario.system, run.file.parent), only=[PLANT], beside=run.beside)
    if not system.agents:
        raise ConfigError(f"the system {run.scenario.system!r} has no agent {PLANT!r}: nothing happens in it")
    return system.with_config(PLANT, scenario=str(run.file), sensor="none")


def without(system: System, *agents: str) -> System:
    """The system without those of `agents` that it has."""
    return system.without(*_names(system).intersection(agents))


def _killed(scenario: Scenario) -> list[str]:
    return [event.agent for event in scenario.events if isinstance(event, Kill)]


def _settings(run: Run) -> dict[str, dict[str, Any]]:
    """What each agent has to know about the run."""
    folder = str(run.folder)
    mission = run.scenario.mission
    return {
        MISSION: {} if mission is None else msgspec.structs.asdict(mission),
        **_policy_settings(run.policy),
        **(
            {"imagination": {"plans": [msgspec.structs.asdict(plan) for plan in run.scenario.plans]}}
            if run.scenario.plans
            else {}
        ),
        PLANT: {"scenario": str(run.file), "sensor": run.sensor, **({"robot": run.robot} if run.robot else {})},
        "scene_setup": {"scenario": str(run.file)},
        "fixed_camera": {"scenario": str(run.file)},
        "recorder": {"folder": folder},
        "viewer": {"folder": folder, "spawn": run.window, "awaits_start": True},
    }


def _is_other_robot(robot: RobotSpec) -> bool:
    """Whether the scenario has another arm than the systems that come along, or has it elsewhere."""
    plain = RobotSpec()
    return robot.exists and (robot.model, robot.position, robot.yaw) != (plain.model, plain.position, plain.yaw)


def _with_robot(system: System, run: Run) -> System:
    """The system whose arm controller knows the description and place of the arm that the plant has.

    Links, home posture and fingers are those of the description; a camera on a link that it lacks is not there.
    """
    robot = run.scenario.robot
    file = find_robot(run.robot, Path()) if run.robot else find_robot(robot.model, run.file.parent)
    links = load_arm(file).robot.parents
    cameras = system.agent(ARM).config.get("cameras", {})
    return system.with_config(
        ARM,
        urdf=str(file.resolve()),
        mount={"translation": robot.position, "rotation": robot.base.q},
        observe_joints=(),
        posture=(),
        cameras={name: camera for name, camera in cameras.items() if camera.get("link", "") in ("", *links)},
    )


def _policy_settings(policy: Policy | None) -> dict[str, dict[str, Any]]:
    """How the agents that know several methods are to work."""
    if policy is None:
        return {}
    if policy == "published":
        return {"simulation_handler": {"reasoner": policy}, "action_inference": {"policy": policy}}
    return {"simulation_handler": {"policy": policy}}


def _about(run: Run, system: System) -> dict[str, str]:
    """What the recording says about the run, so that its agents can be run anew as they were."""
    configs = {spec.name: spec.config for spec in system.agents if spec.name not in ("recorder", "viewer")}
    return {
        "scenario": run.scenario.name,
        "system": _lasting(run),
        "seed": str(run.seed),
        "sensor": run.sensor,
        "agents": msgspec.json.encode(configs).decode(),
    }


def _lasting(run: Run) -> str:
    """What the system is called wherever the recording is read: a name of its own, or the whole path."""
    system = run.scenario.system
    return str(find_system(system, run.file.parent)) if system.endswith(".toml") else system


def _names(system: System) -> set[str]:
    return {spec.name for spec in system.agents}
