"""Checks the consistency of a scenario beyond the types of its fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path as FilePath

from agents.scenario.format.coloring import color_clash
from agents.scenario.format.conditions import OF_ROBOT
from agents.scenario.format.events import (
    ArmError,
    Carry,
    Event,
    HandGraspEvent,
    HandMove,
    Kill,
    PersonEvent,
    PlaceEvent,
    SetInMotion,
    Slide,
    Swap,
)
from agents.scenario.format.expectations import (
    ActionsCheck,
    BeliefError,
    BeliefRecovered,
    Calibrations,
    Check,
    Edges,
    Inside,
    MissionCheck,
    Recovered,
    Replans,
    SurprisesCheck,
    TrueRelationsCheck,
    Windowed,
    WorldsCheck,
)
from agents.scenario.format.geometry import has_face, penetration, upright_box
from agents.scenario.format.inconsistency import InconsistencyError, check_given_name, require
from agents.scenario.format.layout import TOUCH, object_box, overlapping, table_box
from agents.scenario.format.mentions import (
    check_doer,
    check_hands,
    check_mentions,
    check_persons,
    check_plans,
    check_reach,
)
from agents.scenario.format.model import GEN3, CameraSpec, ObjectSpec, RobotSpec, Scenario
from agents.scenario.format.motion import check_change, check_motion
from agents.scenario.format.naming import GROUND, of_own_system, taken_names
from dsr.config.toml_lines import Path
from dsr.errors import ConfigError, GoalError, suggest
from dsr.runtime.system import agent_names, find_system
from dsr.vocabulary.arms import ARM
from dsr.vocabulary.goals import parse_goal
from dsr.vocabulary.observed_actions import parse_pattern


def inconsistencies(scenario: Scenario, etc: FilePath | None, folder: FilePath) -> list[InconsistencyError]:
    """List all values that contradict others or name no file of `etc`, in the order of the sections.

    What is built on wrong names or sections is not looked at: its errors would follow from theirs. Of each event and
    expectation the first error is told. Paths are relative to `folder`, that of the scenario's file.
    """
    sections: list[Callable[[], None]] = [
        lambda: check_given_name(("name",), scenario.name),
        lambda: _check_robot(scenario, etc),
        lambda: _check_system(scenario, folder),
        lambda: _check_settings(scenario),
        lambda: _check_equipment(scenario),
    ]
    names: list[Callable[[], None]] = [lambda: _check_names(scenario, folder)]
    contents: list[Callable[[], None]] = [
        lambda: check_persons(scenario, folder),
        lambda: _check_colors(scenario, etc),
        lambda: _check_mission(scenario),
        lambda: check_plans(scenario, folder),
        lambda: _check_places(scenario),
        *(partial(_check_event, event, ("event", index), scenario) for index, event in enumerate(scenario.events)),
        *(
            partial(_check_expectation, check, ("expect", index), scenario)
            for index, check in enumerate(scenario.expectations)
        ),
    ]
    return _found(sections) or _found(names) or _found(contents) or _found([lambda: check_hands(scenario)])


def _found(checks: Iterable[Callable[[], None]]) -> list[InconsistencyError]:
    """The errors that checks raise."""
    errors = []
    for check in checks:
        try:
            check()
        except InconsistencyError as error:
            errors.append(error)
    return errors


def _check_robot(scenario: Scenario, etc: FilePath | None) -> None:
    places: list[tuple[Path, RobotSpec]] = [(("robot",), scenario.robot)]
    places += [(("arm", index), spec) for index, spec in enumerate(scenario.more_arms)]
    for path, spec in places:
        if etc is not None and spec.exists and not FilePath(spec.model).suffix:
            _check_file((*path, "model"), spec.model, etc / "robots", ".urdf")
        require(spec.exists or path == ("robot",), (*path, "model"), "expected an arm; leave it out if there is none")
        fits = spec.model != GEN3 or len(spec.start) == len(RobotSpec().start)
        message = f"expected {len(RobotSpec().start)} joint positions (rad), got {len(spec.start)}"
        require(fits, (*path, "start"), message)
    _check_arm_names(scenario)


def _check_arm_names(scenario: Scenario) -> None:
    known = {ARM}
    for index, spec in enumerate(scenario.more_arms):
        require(scenario.robot.exists, ("arm", index), "expected a first arm in [robot]")
        check_given_name(("arm", index, "name"), spec.name)
        message = f"the name {spec.name!r} is taken; expected a name used once"
        require(spec.name not in known, ("arm", index, "name"), message)
        known.add(spec.name)


def _check_file(path: Path, name: str, folder: FilePath, suffix: str) -> None:
    """The name must be that of a file in `folder`, if there is any."""
    known = {file.stem for file in folder.glob(f"*{suffix}")}
    require(not known or name in known, path, f"unknown {path[-1]} {name!r}; {suggest(name, known)}")


def _check_system(scenario: Scenario, folder: FilePath) -> None:
    """The system is there and has the agents that the scenario needs or kills; their classes are not loaded."""
    try:
        agents = agent_names(find_system(scenario.system, folder))
    except ConfigError as error:
        raise InconsistencyError(("system",), str(error)) from error
    message = f"the system {scenario.system!r} has an arm; expected a robot, or another `system`, e.g. 'reasoner'"
    require(scenario.robot.exists or "arm_controller" not in agents, ("robot", "model"), message)
    message = f"the system {scenario.system!r} has no agent 'fixed_camera'; expected another `system`, e.g. 'reasoner'"
    require(isinstance(scenario.camera, str) or "fixed_camera" in agents, ("camera",), message)
    if not of_own_system(scenario):  # in which the camera's place and the mission may come from elsewhere
        message = f"the system {scenario.system!r} has a camera on a stand; expected [camera], with its place"
        require(not isinstance(scenario.camera, str) or "fixed_camera" not in agents, ("camera",), message)
        message = f"the system {scenario.system!r} has no agent 'mission'; expected another `system`, e.g. 'tabletop'"
        require(scenario.mission is None or "mission" in agents, ("mission",), message)
    for index, event in enumerate(scenario.events):
        if isinstance(event, Kill):
            message = f"unknown agent {event.agent!r}; {suggest(event.agent, agents)}"
            require(event.agent in agents, ("event", index, "agent"), message)


def _check_equipment(scenario: Scenario) -> None:
    """What is used of arm and cameras is there."""
    camera, has_arm = scenario.camera, scenario.robot.exists
    if isinstance(camera, CameraSpec):
        require(camera.position != camera.look_at, ("camera", "look_at"), "expected another place than its `position`")
    cameras = {"overhead", scenario.camera_name} | ({"wrist"} if has_arm else set())
    require(has_arm or camera != "wrist", ("camera",), "there is no robot to carry the camera")
    require(has_arm or scenario.mission is None, ("mission",), "there is no robot to do it")
    for index, event in enumerate(scenario.events):
        used = getattr(event, "camera", None)
        message = f"there is no camera {used!r}; {suggest(str(used), cameras)}"
        require(used is None or used in cameras, ("event", index, "camera"), message)
        require(has_arm or not isinstance(event, ArmError), ("event", index), "there is no robot")


def _check_settings(scenario: Scenario) -> None:
    require(
        scenario.settle < scenario.duration,
        ("settle",),
        f"settle = {scenario.settle} s; expected less than the duration, {scenario.duration} s",
    )
    low, high = scenario.sensor.depth_bias
    require(low <= high, ("sensor", "depth_bias"), f"[{low}, {high}] m: expected the smaller bound first")


def _check_names(scenario: Scenario, folder: FilePath) -> None:
    names = taken_names(scenario, folder)
    markers: dict[int, str] = {}
    for index, spec in enumerate(scenario.objects):
        _check_recognised(spec, ("object", index))
        path: Path = ("object", index, "name")
        check_given_name(path, spec.name)
        require(spec.name not in names, path, f"the name {spec.name!r} is taken; expected a name used once")
        names.add(spec.name)
        if spec.marker_id is not None:
            other = markers.setdefault(spec.marker_id, spec.name)
            message = f"{spec.name!r} has the marker {spec.marker_id} of {other!r}; expected one used once"
            require(other == spec.name, ("object", index, "marker_id"), message)


def _check_recognised(spec: ObjectSpec, path: Path) -> None:
    """An object has a face for its tag; one made of a model has a tag, a known colour, or the shape of a block."""
    if spec.marker_id is not None:
        message = f"{spec.name!r} has no closed upper face for a tag; leave `marker_id` out, to recognise it by colour"
        require(has_face(spec.shape, spec.size), (*path, "marker_id"), message)
    if (spec.model is None and not spec.shape) or spec.marker_id is not None:
        return
    require(spec.color is not None, path, f"{spec.name!r}: expected a `marker_id` or a `color` to recognise it by")
    message = f"{spec.name!r} is recognised by its colour: expected `known = true`, or a `marker_id`"
    require(spec.known or spec.by_depth, path, message)


def _check_colors(scenario: Scenario, etc: FilePath | None) -> None:
    """What is recognised by its colour is alone in having it."""
    if clash := color_clash(scenario, None if etc is None else etc / "robots"):
        index, message = clash
        raise InconsistencyError(("object", index), message)


def _check_mission(scenario: Scenario) -> None:
    """The goal can be read, and is about things that are there."""
    if scenario.mission is None:
        return
    try:
        goal = parse_goal(scenario.mission.goal)
        goal.check_names({*GROUND, *(spec.name for spec in scenario.objects)})
    except GoalError as error:
        raise InconsistencyError(("mission", "goal"), str(error)) from error


def _check_places(scenario: Scenario) -> None:
    """No object starts inside another one, or inside the table."""
    table = table_box(scenario.table)
    for index, spec in enumerate(scenario.objects):
        depth = penetration(object_box(spec), table)
        require(
            depth <= TOUCH,
            ("object", index, "position"),
            f"{spec.name!r} is {depth * 1000:.1f} mm inside the table; "
            f"expected z >= {table.top + spec.size[2] / 2:.4f} m",
        )
    if found := overlapping(scenario.objects):
        first, second, depth = found
        raise InconsistencyError(
            ("object", second, "position"),
            f"{scenario.objects[second].name!r} and {scenario.objects[first].name!r} overlap by "
            f"{depth * 1000:.1f} mm; expected objects that are apart or touch",
        )


def _check_event(event: Event, path: Path, scenario: Scenario) -> None:
    once = (event.at is None) != (event.when is None)
    require(once, path, "expected either `at` (s) or `when` (a condition)")
    late = "delay" if event.delay and (event.at is None or event.at <= scenario.duration) else "at"
    _check_time((event.at or 0.0) + event.delay, (*path, late), scenario)
    _check_condition(event, (*path, "when"), scenario)
    for field, name in event.named_objects.items():
        _check_objects([name], (*path, field), scenario)
    if isinstance(event, PersonEvent):
        persons = [person.name for person in scenario.persons]
        message = f"unknown person {event.person!r}; {suggest(event.person, persons)}"
        require(event.person in persons, (*path, "person"), message)
    if isinstance(event, PlaceEvent):
        once = (event.position is None) != (event.onto is None)
        require(once, path, "place: expected either `position` (m) or `onto` (an object)")
        require(event.onto != event.object, (*path, "onto"), "an object cannot be placed onto itself")
        _check_above_table(event, event.position, (*path, "position"), scenario)
    if isinstance(event, Slide):
        once = (event.to is None) != (event.by is None)
        require(once, path, "slide: expected either `to` (m, where it goes) or `by` (m, how far)")
        require(event.yaw is None or not event.turn, (*path, "turn"), "expected either `yaw` or `turn` (rad)")
        _check_objects(event.pushes, (*path, "pushes"), scenario)
        require(event.object not in event.pushes, (*path, "pushes"), "an object cannot push itself")
    check_change(event, path)
    if isinstance(event, Swap):
        require(event.other != event.object, (*path, "other"), "an object cannot swap with itself")
    if isinstance(event, SetInMotion):
        check_motion(event, path, scenario)
    if isinstance(event, HandMove):
        require(event.to is None or event.by is None, path, "hand_move: expected `to` or `by` (m), not both")
        some = event.to is not None or event.by is not None or event.turn
        require(bool(some), path, "hand_move: expected `to`, `by` (m) or `turn` (rad)")
    if isinstance(event, HandGraspEvent):
        check_reach(event, path, scenario)
    _check_direction(event, path)
    if isinstance(event, Carry):
        _check_above_table(event, event.to, (*path, "to"), scenario)


def _check_direction(event: Event, path: Path) -> None:
    """A side, a direction and an axis have a direction."""
    for field, along in (("side", "x and y"), ("direction", "x and y"), ("axis", "x, y and z")):
        given = getattr(event, field, None)
        require(given is None or any(given), (*path, field), f"expected a direction along {along} that is not zero")


def _check_condition(event: Event, path: Path, scenario: Scenario) -> None:
    try:
        condition = event.condition
    except ConfigError as error:
        raise InconsistencyError(path, str(error)) from error
    if condition is None:
        return
    _check_objects(condition.objects, path, scenario)
    for term in condition.terms:
        text = f"{term.predicate}({', '.join(term.objects)})"
        require(len({*term.objects}) == len(term.objects), path, f"{text}: expected two different objects")
        message = f"{text}: there is no robot that could hold or move anything"
        require(scenario.robot.exists or term.predicate not in OF_ROBOT, path, message)


def _check_above_table(
    event: PlaceEvent | Carry, position: tuple[float, float, float] | None, path: Path, scenario: Scenario
) -> None:
    if position is None:
        return
    spec, table = scenario.object(event.object), table_box(scenario.table)
    depth = penetration(upright_box(position, event.yaw or spec.yaw, spec.size), table)
    least = table.top + spec.size[2] / 2
    require(depth <= TOUCH, path, f"{spec.name!r} would be inside the table; expected z >= {least:.4f} m")


def _check_expectation(check: Check, path: Path, scenario: Scenario) -> None:
    named = path if isinstance(check, Inside) else (*path, "objects")
    _check_objects(check.named_objects, named, scenario)
    some = getattr(check, "objects", None) != ()
    require(some, named, "expected at least one object; leave it out to mean all")
    at = scenario.duration if check.at is None else check.at
    _check_time(at, (*path, "at"), scenario)
    if check.event is not None:
        _check_relative(check, path, scenario)
    after = getattr(check, "after", None)
    if isinstance(check, Windowed) and after is None:
        after = scenario.settle if check.event is None else 0.0
    if after is not None:
        message = f"the window begins at {after} s; expected before {at} s, when it is judged"
        given = getattr(check, "after", None) is not None
        require(after < at, (*path, "after" if given else "at"), message)
    if isinstance(check, WorldsCheck):
        require(bool(check.present or check.absent), path, "worlds: expected `present` or `absent`: lists of names")
    if isinstance(check, Edges | TrueRelationsCheck | Inside):
        name = check.__struct_config__.tag
        some = bool(check.present or check.absent)
        require(some, path, f"{name}: expected `present` or `absent`: lists of [source, destination]")
    if isinstance(check, TrueRelationsCheck):
        _check_relation_names(check, path, scenario)
    if isinstance(check, BeliefError):
        whole = check.share == 1.0 or check.after is not None
        require(whole, (*path, "share"), "expected `after` (s) with `share`: the window whose moments are counted")
    check_mentions(check, path, scenario)
    if isinstance(check, ActionsCheck):
        _check_actions(check, path, scenario)
    if isinstance(check, SurprisesCheck | Replans | Calibrations):
        message = f"at least {check.least} and at most {check.most} is impossible"
        require(check.most is None or check.least <= check.most, (*path, "most"), message)
    if isinstance(check, MissionCheck | Replans):
        wanted = scenario.mission is not None or bool(scenario.plans)
        require(wanted, path, "there is no [mission] in this file, and no [[plan]]")
    if isinstance(check, BeliefRecovered):
        some = any(not event.by_runner for event in scenario.events)
        require(some, path, "belief_recovered: expected an [[event]] to recover from")
    if isinstance(check, Recovered):
        killed = {event.agent for event in scenario.events if isinstance(event, Kill)}
        message = f"no event kills {check.agent!r}; {suggest(check.agent, killed)}"
        require(check.agent in killed, (*path, "agent"), message)


def _check_relative(check: Check, path: Path, scenario: Scenario) -> None:
    """Times that count from the end of an event."""
    count = len(scenario.events)
    known = check.event is not None and 1 <= check.event <= count
    require(known, (*path, "event"), f"there is no event {check.event}; expected a number from 1 to {count}")
    require(check.at is not None, path, "expected `at` (s) with `event`: how long after its end this is judged")
    by_plant = check.event is not None and not scenario.events[check.event - 1].by_runner
    require(by_plant, (*path, "event"), "expected an event in the true world, not `kill`")


def _check_actions(check: ActionsCheck, path: Path, scenario: Scenario) -> None:
    """Its terms can be read, and are about objects of the file that it looks at."""
    some = check.sequence is not None or bool(check.present or check.absent)
    require(some, path, "actions: expected `sequence`, `present` or `absent`: lists such as ['Pick(cup)']")
    for field, index, term in check.terms:
        try:
            pattern = parse_pattern(term)
        except GoalError as error:
            raise InconsistencyError((*path, field, index), f"{term!r}: {error.reason}") from error
        if pattern.thing is not None:
            _check_objects([pattern.thing], (*path, field, index), scenario)
            looked_at = check.objects is None or pattern.thing in check.objects
            require(looked_at, (*path, field, index), f"{pattern.thing!r} is not one of the `objects` of this check")
        if pattern.by is not None:
            check_doer(pattern.by, (*path, field, index), scenario)


def _check_relation_names(check: TrueRelationsCheck, path: Path, scenario: Scenario) -> None:
    known = {spec.name for spec in scenario.objects}
    for field, pairs in (("present", check.present), ("absent", check.absent)):
        for upper, lower in pairs:
            require(upper in known, (*path, field), f"unknown object {upper!r}; {suggest(upper, known)}")
            below = {*known, *GROUND}
            require(lower in below, (*path, field), f"unknown object {lower!r}; {suggest(lower, below)}")


def _check_time(at: float, path: Path, scenario: Scenario) -> None:
    message = f"{at} s is after the end; expected at most {scenario.duration} s"
    require(at <= scenario.duration, path, message)


def _check_objects(names: Iterable[str], path: Path, scenario: Scenario) -> None:
    known = {spec.name for spec in scenario.objects}
    for name in names:
        require(name in known, path, f"unknown object {name!r}; {suggest(name, known)}")
