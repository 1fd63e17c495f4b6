"""The system of agents that plays a scenario, configured for it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec

from agents.arm_controller.model.arm_model import load_arm
from agents.scenario.format.events import Kill
from agents.scenario.format.model import RobotSpec, Scenario
from agents.scenario.format.scenario import find_scenario, load_scenario
from agents.urdf_files import find_robot
from dsr.config.extras import check_installed
from dsr.config.toml import convert
from dsr.errors import ConfigError
from dsr.runtime.system import System, find_system, load_system
from dsr.vocabulary.arms import ARM, CONTROLLER

Sensor = Literal["pixels", "poses"]
"""The output of the plant's camera: rendered images, or the poses that would be measured in them."""
PlantSensor = Literal["pixels", "poses", "none"]
"""The same, or nothing at all: what the camera could recognise is not worked out then."""

Policy = Literal["hypotheses", "algorithm1", "published"]
"""Explain surprises by simulated hypotheses, or by Algorithm 1 of the CORTEX paper; or reason as Sallami et al. did,
and infer actions as they did."""
HandFinder = Literal["model", "colour"]
"""Find hands in images by the real model, or by the colour of skin."""
PLANT = "plant"
"""Name of the agent that plays the simulated reality."""
ESTIMATOR = "scene_estimator"
"""Name of the agent that recognises objects."""
MISSION = "mission"
"""Name of the agent that pursues the scenario's `[mission]`."""
HAND_TRACKER = "hand_tracker"
"""Name of the agent that finds hands."""


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
    hands: HandFinder | None = None
    """How hands are found in images; None for the hand tracker's own choice."""
    untagged: bool = False
    """Play it without tags: blocks are found by depth."""
    folder: Path | None = None
    """Gets recording, logs and result; None for nothing of that."""
    viewer: bool = False
    """Let the viewer run along in lockstep; in a live run it always does."""
    window: bool = False
    """Open the viewer's window."""
    beside: bool = True
    """Modules beside the file of the system may be imported."""


def make_run(name_or_path: str | Path, **options: Any) -> Run:
    """Prepare the run of a built-in scenario or a file, with these fields of `Run`. Raises `ConfigError`."""
    file = find_scenario(name_or_path)
    scenario = load_scenario(file, without_tags=options.get("untagged", False))
    return Run(scenario=scenario, file=file.resolve(), **options)


def staged_system(run: Run) -> System:
    """The system of the scenario, configured for this run. Raises `ConfigError`.

    An agent that the scenario kills has a process of its own: no other agent dies with it.
    An agent that the system does not have needs no configuration; without a folder nothing is recorded.
    Without tags, the runner gives the mission once it is known what things are called (`MissionGiver`).
    A run without tags is refused where nothing would be found: by true poses, or without an agent that finds objects.
    A mission is refused where the libraries of those who would pursue it are not installed: nothing would happen.
    So is a finder of hands where none would be found by it: the tracker alone would go on by colour.
    """
    system = load_system(find_system(run.scenario.system, run.file.parent), beside=run.beside)
    _check_finds_blocks(run, system)
    if run.scenario.mission is None or run.untagged:
        system = without(system, MISSION)
    if run.scenario.mission is not None:
        for spec in system.agents:
            check_installed(spec.kind.goal_libraries, f"scenario {run.scenario.name!r} has a mission for {spec.name!r}")
    for agent, fields in _settings(run).items():
        if agent in _names(system):
            system = system.with_config(agent, **fields)
    system = _with_robots(system, run)
    system = system.apart(*_names(system).intersection(_killed(run.scenario)))
    system = system.final(*_names(system).intersection(_killed(run.scenario, for_good=True)))
    _check_hands(run, system)
    if "recorder" in _names(system):
        system = system.with_config("recorder", about=_about(run, system))
    return system if run.folder else without(system, "recorder", "viewer")


def _check_finds_blocks(run: Run, system: System) -> None:
    """Raise `ConfigError` if things without tags, of which nobody is told, are expected where nothing finds them."""
    is_found = ESTIMATOR in _names(system) and bool(system.agent(ESTIMATOR).config.get("blocks"))
    blocks = [spec.name for spec in run.scenario.objects if spec.by_depth]
    if run.sensor != "pixels" and blocks and (run.untagged or is_found):
        raise ConfigError(
            f"{run.scenario.name!r}: without tags, {', '.join(blocks)} are found in images only; expected the sensor "
            f"`pixels`, not `{run.sensor}`"
        )
    if run.untagged and ESTIMATOR not in _names(system):
        raise ConfigError(
            f"the system {run.scenario.system!r} has no agent {ESTIMATOR!r}, which would find objects without tags"
        )


def plant_alone(run: Run, sensor: PlantSensor = "none") -> System:
    """The simulated reality of the scenario without anybody who looks at it. Raises `ConfigError`."""
    system = load_system(find_system(run.scenario.system, run.file.parent), only=[PLANT], beside=run.beside)
    if not system.agents:
        raise ConfigError(f"the system {run.scenario.system!r} has no agent {PLANT!r}: nothing happens in it")
    return system.with_config(PLANT, scenario=str(run.file), sensor=sensor, untagged=run.untagged)


def without(system: System, *agents: str) -> System:
    """The system without those of `agents` that it has."""
    return system.without(*_names(system).intersection(agents))


def _killed(scenario: Scenario, *, for_good: bool = False) -> list[str]:
    kills = [event for event in scenario.events if isinstance(event, Kill)]
    return [event.agent for event in kills if not (for_good and event.restart)]


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
        **({ESTIMATOR: {"blocks": True}} if run.untagged else {}),
        PLANT: {"scenario": str(run.file), "sensor": run.sensor, "untagged": run.untagged, "robot": _robot_file(run)},
        HAND_TRACKER: {} if run.hands is None else {"finder": run.hands},
        "scene_setup": {"scenario": str(run.file), "untagged": run.untagged},
        "fixed_camera": {"scenario": str(run.file)},
        "recorder": {"folder": folder},
        "viewer": {"folder": folder, "spawn": run.window, "awaits_start": True},
    }


def _is_other_robot(robot: RobotSpec) -> bool:
    """Whether the scenario has another arm than the systems that come along, or has it elsewhere."""
    plain = RobotSpec()
    told = [(one.model, one.args, one.position, one.yaw) for one in (robot, plain)]
    return robot.exists and told[0] != told[1]


def _robot_file(run: Run) -> str:
    """The file of the robot that takes the place of the scenario's; empty for none. Raises `ConfigError`."""
    return str(find_robot(run.robot, Path()).resolve()) if run.robot else ""


def _with_robots(system: System, run: Run) -> System:
    """The system whose arm controllers know the arms that the plant has. Raises `ConfigError` for an arm without one.

    A controller without an arm is refused, too: it would wait for ever.
    """
    arms, controllers = run.scenario.arms, _controllers(system)
    if len(arms) == len(controllers) == 1:
        controllers = dict.fromkeys(arms, next(iter(controllers.values())))
    for name in [*arms, *controllers] if len(arms) > 1 or len(controllers) > 1 else ():
        if name not in controllers or name not in arms:
            whose, lacks = ("the scenario", "system") if name in arms else ("the system", "scenario")
            raise ConfigError(f"{whose} has an arm {name!r}, and its {lacks} has none of that name")
    for name in [name for name in arms if name in controllers]:
        given = run.robot if name == ARM else ""
        if given or name != ARM or _is_other_robot(arms[name]):
            system = _with_robot(system, run, name, controllers[name])
    return system


def _controllers(system: System) -> dict[str, str]:
    """The agents that move arms, by the arms' names."""
    own = [spec for spec in system.agents if spec.kind.name == CONTROLLER]
    return {spec.config.get("arm", ARM): spec.name for spec in own}


def _with_robot(system: System, run: Run, arm: str, agent: str) -> System:
    """The system whose controller of an arm knows its description and place.

    Links, home posture and fingers are those of the description; a camera on a link that it lacks is not there.
    """
    robot, first = run.scenario.arms[arm], run.scenario.robot
    other = run.robot and arm == ARM
    file = Path(_robot_file(run)) if other else find_robot(robot.model, run.file.parent).resolve()
    args = {} if other else robot.args
    links = load_arm(file, args=args).robot.parents
    cameras = system.agent(agent).config.get("cameras", {})
    place = first.base.inverse() @ robot.base
    return system.with_config(
        agent,
        urdf=str(file),
        urdf_args=args,
        mount={"translation": first.position, "rotation": first.base.q},
        **({} if arm == ARM else {"arm_mount": {"translation": place.t, "rotation": place.q}}),
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


def _check_hands(run: Run, system: System) -> None:
    """Raise `ConfigError` if hands cannot be found in the way that the run asks for."""
    if run.hands is None:
        return
    if run.sensor != "pixels":
        raise ConfigError(f"hands by {run.hands} are found in images: expected the sensor pixels, not {run.sensor}")
    if HAND_TRACKER not in _names(system):
        raise ConfigError(f"no agent {HAND_TRACKER!r} in the system {run.scenario.system!r}: no hand would be found")
    if run.hands == "model":
        from agents.hand_tracker.config import HandTrackerConfig
        from agents.hand_tracker.model.loading import load_landmarker

        config = convert(system.agent(HAND_TRACKER).config, HandTrackerConfig, f"configuration of {HAND_TRACKER!r}")
        load_landmarker(config)().close()


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
