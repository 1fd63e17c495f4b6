"""What must be consistent in a scenario beyond the types of its fields."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath

from agents.scenario.events import Carry, Event, Kill, Place
from agents.scenario.expectations import Check, Edges, Recovered
from agents.scenario.geometry import footprint_overlap
from agents.scenario.layout import TOUCH, object_box, overlapping, table_box
from agents.scenario.lines import Path
from agents.scenario.model import RobotSpec, Scenario
from dsr.errors import ConfigError, suggest
from dsr.keys import check_name

_RESERVED = {"world", "robot", "table", "camera_overhead", "camera_wrist", "arm", "gripper", "body", "mind"}


class Inconsistent(ConfigError):
    """A value that does not fit the rest of the scenario."""

    def __init__(self, path: Path, message: str) -> None:
        super().__init__(message)
        self.path = path


def check_scenario(scenario: Scenario, etc: FilePath | None) -> None:
    """Raise `Inconsistent` for the first value that contradicts another, or names a missing file of `etc`."""
    check_name_at(("name",), scenario.name)
    _check_files(scenario, etc)
    _check_robot(scenario.robot)
    if scenario.settle >= scenario.duration:
        raise Inconsistent(("settle",), f"settle = {scenario.settle} s; expected less than the duration")
    low, high = scenario.sensor.depth_bias
    if low > high:
        raise Inconsistent(("sensor", "depth_bias"), f"[{low}, {high}] m: expected the smaller bound first")
    _check_names(scenario)
    _check_places(scenario)
    for index, event in enumerate(scenario.events):
        _check_event(event, ("event", index), scenario)
    for index, check in enumerate(scenario.expectations):
        _check_expectation(check, ("expect", index), scenario)


def check_name_at(path: Path, name: str) -> None:
    """Raise `Inconsistent` if `name` cannot be the name of a node or a scenario."""
    try:
        check_name("name", name)
    except ConfigError as error:
        raise Inconsistent(path, str(error)) from error


def _check_files(scenario: Scenario, etc: FilePath | None) -> None:
    if etc is None:
        return
    systems = {file.stem for file in (etc / "systems").glob("*.toml")}
    if systems and scenario.system not in systems:
        raise Inconsistent(
            ("system",), f"unknown system {scenario.system!r}; {suggest(scenario.system, systems)}"
        )
    models = {file.stem for file in (etc / "robots").glob("*.urdf")}
    model = scenario.robot.model
    if models and model not in models:
        raise Inconsistent(("robot", "model"), f"unknown robot {model!r}; {suggest(model, models)}")


def _check_robot(robot: RobotSpec) -> None:
    if robot.model != "gen3" and robot.start == RobotSpec().start:
        raise Inconsistent(("robot",), f"robot {robot.model!r} needs `start`: its joint positions in rad")


def _check_names(scenario: Scenario) -> None:
    names: set[str] = set()
    markers: dict[int, str] = {}
    for index, spec in enumerate(scenario.objects):
        path: Path = ("object", index, "name")
        check_name_at(path, spec.name)
        if spec.name in names | _RESERVED:
            raise Inconsistent(path, f"the name {spec.name!r} is taken; expected a name used once")
        names.add(spec.name)
        if spec.marker_id is None:
            continue
        if spec.marker_id in markers:
            other = markers[spec.marker_id]
            raise Inconsistent(
                ("object", index, "marker_id"),
                f"{spec.name!r} has the marker {spec.marker_id} of {other!r}; expected a marker used once",
            )
        markers[spec.marker_id] = spec.name


def _check_places(scenario: Scenario) -> None:
    """No object starts inside another one or inside the table."""
    table = table_box(scenario.table)
    for index, spec in enumerate(scenario.objects):
        depth = table.top - object_box(spec).bottom
        if depth > TOUCH and footprint_overlap(object_box(spec), table) > 0:
            least = table.top + spec.size[2] / 2
            raise Inconsistent(
                ("object", index, "position"),
                f"{spec.name!r} is {depth * 1000:.1f} mm inside the table; expected z >= {least:.4f} m",
            )
    if found := overlapping(scenario.objects):
        first, second, depth = found
        raise Inconsistent(
            ("object", second, "position"),
            f"{scenario.objects[second].name!r} and {scenario.objects[first].name!r} overlap by "
            f"{depth * 1000:.1f} mm; expected objects that are apart or touch",
        )


def _check_event(event: Event, path: Path, scenario: Scenario) -> None:
    if (event.at is None) == (event.when is None):
        raise Inconsistent(path, "expected either `at` (s) or `when` (a condition)")
    if event.at is not None and event.at > scenario.duration:
        raise Inconsistent(
            (*path, "at"), f"at = {event.at} s is after the end; expected at most {scenario.duration} s"
        )
    _check_condition(event, path, scenario)
    _check_objects(event.named_objects, path, scenario)
    if isinstance(event, Place) and (event.position is None) == (event.onto is None):
        raise Inconsistent(path, "place: expected either `position` (m) or `onto` (an object)")
    if isinstance(event, Place) and event.onto == event.object:
        raise Inconsistent((*path, "onto"), f"{event.object!r} cannot be placed onto itself")
    if isinstance(event, Kill) and event.at is None:
        raise Inconsistent(path, "kill: expected `at` (s): conditions are judged by the plant")
    if isinstance(event, Place | Carry):
        _check_above_table(event, path, scenario)


def _check_condition(event: Event, path: Path, scenario: Scenario) -> None:
    try:
        condition = event.condition
    except ConfigError as error:
        raise Inconsistent((*path, "when"), str(error)) from error
    if condition:
        _check_objects(condition.objects, (*path, "when"), scenario)


def _check_above_table(event: Place | Carry, path: Path, scenario: Scenario) -> None:
    key, position = ("position", event.position) if isinstance(event, Place) else ("to", event.to)
    if position is None:
        return
    spec = scenario.object(event.object)
    table = table_box(scenario.table)
    over = all(abs(position[i] - scenario.table.position[i]) < scenario.table.size[i] / 2 for i in (0, 1))
    if over and table.top - position[2] + spec.size[2] / 2 > TOUCH:
        least = table.top + spec.size[2] / 2
        raise Inconsistent(
            (*path, key), f"{event.object!r} would be put into the table; expected z >= {least:.4f} m"
        )


def _check_expectation(check: Check, path: Path, scenario: Scenario) -> None:
    _check_objects(check.named_objects, (*path, "objects"), scenario)
    at = scenario.duration if check.at is None else check.at
    if at > scenario.duration:
        raise Inconsistent(
            (*path, "at"), f"at = {at} s is after the end; expected at most {scenario.duration} s"
        )
    after = getattr(check, "after", None)
    if after is not None and after >= at:
        raise Inconsistent(
            (*path, "after"), f"after = {after} s; expected less than {at} s, when it is judged"
        )
    if isinstance(check, Edges) and not (check.present or check.absent):
        raise Inconsistent(path, "edges: expected `present` or `absent`: lists of [source, destination]")
    killed = {event.agent for event in scenario.events if isinstance(event, Kill)}
    if isinstance(check, Recovered) and check.agent not in killed:
        raise Inconsistent(
            (*path, "agent"), f"no event kills {check.agent!r}; {suggest(check.agent, killed)}"
        )


def _check_objects(names: Iterable[str], path: Path, scenario: Scenario) -> None:
    known = {spec.name for spec in scenario.objects}
    for name in names:
        if name not in known:
            raise Inconsistent(path, f"unknown object {name!r}; {suggest(name, known)}")
