"""`dsr ros list` and `dsr ros check`: what is there, and why nothing arrives."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, cast

import msgspec
import pytest
from typer.testing import CliRunner

from agents.ros_bridge.cli import app
from agents.ros_bridge.link.link import Endpoint, LinkConfig, Publisher, Qos, RosLink, Topic
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from agents.ros_bridge.watching import RosFindings, TopicSeen, check, look
from dsr.clock import WALL_CLOCK
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.samples import TYPES
from tests.agents.ros_bridge.told import eventually

STRING, TRIGGER = "std_msgs/msg/String", "std_srvs/srv/Trigger"
HELLO = TYPES.encode(STRING, TYPES.new(STRING, data="hello"))
Connect = Callable[..., ZenohLink]


@contextmanager
def sending(publisher: Publisher, hz: float) -> Iterator[None]:
    """Send again and again, until the end."""
    end = threading.Event()

    def send() -> None:
        while not WALL_CLOCK.wait(end, 1 / hz):
            publisher.send(HELLO)

    thread = threading.Thread(target=send)
    thread.start()
    yield
    end.set()
    thread.join()


@pytest.fixture
def robot(connect: Connect) -> Iterator[ZenohLink]:
    """A node that sends, a topic without publisher, a type that nobody knows, another definition, and a service."""
    link, old = connect("/robot"), connect("/old", distro="humble")
    link.subscribe(Topic("/wanted", STRING), lambda _: None)
    link.serve("/reset", TRIGGER, lambda request: request)
    old.publisher(Topic("/other", STRING))
    silent = link.publisher(Topic("/silent", STRING))
    unknown = f"@ros2_lv/0/ff/0/9/MP/%/%/odd/%odd/odd_msgs::msg::dds_::Odd_/{TYPES.hash(STRING)}/::,10:,:,:,,"
    token = link._session.liveliness().declare_token(unknown)
    with sending(link.publisher(Topic("/said", STRING, Qos(depth=5))), 100.0):
        yield link
    assert token and silent


def test_topics_have_types_rates_and_nodes(robot: ZenohLink, connect: Connect) -> None:
    seen = {one.name: one for one in look(connect("/looking"), TYPES, 1.0)}
    said = seen["/said"]
    assert (said.types, said.publishers, said.subscribers, said.note) == ([STRING], ["/robot"], [], "")
    assert said.hz is not None and 20 < said.hz < 110 and said.bytes_per_s == pytest.approx(said.hz * len(HELLO))
    assert seen["/wanted"] == TopicSeen("/wanted", [STRING], [], ["/robot"])
    assert seen["/silent"].hz == 0.0
    assert seen["/reset"] == TopicSeen("/reset", [TRIGGER], ["/robot"], [], service=True)
    assert seen["/odd"].note == "odd_msgs/msg/Odd is not known here" and seen["/odd"].hz is None
    assert seen["/other"].note == f"{STRING} has another definition than in ROS 2 jazzy"


class Slow:
    """A link that sees what is there late, one after the other, as on a busy machine."""

    def __init__(self, link: ZenohLink, seconds: float) -> None:
        self._link, self._began, self._seconds = link, WALL_CLOCK.monotonic(), seconds

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def endpoints(self) -> list[Endpoint]:
        seen = int((WALL_CLOCK.monotonic() - self._began) / self._seconds)
        return self._link.endpoints()[:seen]


def test_a_look_waits_for_what_comes_to_be_seen_late(robot: ZenohLink, connect: Connect) -> None:
    looking = connect("/looking")
    eventually(lambda: len(looking.endpoints()) == 6)
    found = look(cast(RosLink, Slow(looking, 0.4)), TYPES, 0.0)
    assert {one.name for one in found} == {"/said", "/wanted", "/silent", "/reset", "/odd", "/other"}


class Nameless:
    """A link over DDS: for a second nobody is visible, then endpoints are, and their nodes a second later."""

    def __init__(self, link: ZenohLink) -> None:
        self._link, self._began = link, WALL_CLOCK.monotonic()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def problems(self) -> list[str]:
        return [] if self.endpoints() else ["nobody is visible"]

    def endpoints(self) -> list[Endpoint]:
        passed = WALL_CLOCK.monotonic() - self._began
        found = self._link.endpoints() if passed > 1.5 else []
        return found if passed > 3.5 else [msgspec.structs.replace(one, node="") for one in found]


def test_a_look_waits_for_the_names_of_nodes_and_takes_nobody_at_first_for_no_answer(
    robot: ZenohLink, connect: Connect
) -> None:
    looking = connect("/looking")
    eventually(lambda: len(looking.endpoints()) == 6)
    found = check(cast(RosLink, Nameless(looking)), LinkConfig(), TYPES, [], 0.1)
    assert found.nodes == ["/odd", "/old", "/robot"] and not found.problems


def test_check_tells_why_nothing_arrives(robot: ZenohLink, connect: Connect, router: Router) -> None:
    config = LinkConfig(router=router.endpoint)
    asked = ["/said", "/wanted", "/odd", "/other", "/silent", "/reset", "/nowhere"]
    found = check(connect("/looking"), config, TYPES, asked, 3.0)
    assert found.problems == [
        "/nowhere: nobody has this topic",
        "/wanted: nobody publishes (/robot listens)",
        "/odd: odd_msgs/msg/Odd is not known here",
        f"/other: {STRING} has another definition than in ROS 2 jazzy",
        "/silent: /robot publishes, but nothing came within 3 s",
        "/reset: is a service, no topic",
    ]
    assert found.nodes == ["/odd", "/old", "/robot"] and found.versions["rosbags"].startswith("0.11.")
    assert found.unauthenticated == [
        f"whoever reaches the Zenoh router {router.endpoint} may speak in domain 0, in the name of any node"
    ]
    assert found.reached == f"zenoh, domain 0, ROS 2 jazzy, router {router.endpoint}, this machine only"


def test_the_commands(robot: ZenohLink, router: Router) -> None:
    place = ["--ros-router", router.endpoint]
    shown = CliRunner().invoke(app, ["list", *place, "--for", "0"], env={"COLUMNS": "160"})
    assert shown.exit_code == 0, shown.output
    words = " ".join(shown.output.split())  # whatever the width of the table
    assert [text for text in ("/said", STRING, "/robot", "(service)", "is not known here") if text not in words] == []
    listed = CliRunner().invoke(app, ["list", *place, "--for", "0.3", "--json"])
    rows = msgspec.json.decode(listed.output, type=list[TopicSeen])
    assert {row.name for row in rows} >= {"/said", "/wanted", "/reset", "/odd"}
    fine = CliRunner().invoke(app, ["check", "/said", *place, "--for", "0.5"])
    assert (fine.exit_code, "nothing stands in the way" in fine.output) == (0, True), fine.output
    assert "in the name of any node" in " ".join(fine.output.split())
    wrong = CliRunner().invoke(app, ["check", "/wanted", *place, "--for", "0.1", "--json"])
    assert wrong.exit_code == 1
    assert msgspec.json.decode(wrong.output, type=RosFindings).problems == [
        "/wanted: nobody publishes (/robot listens)"
    ]
    assert json.loads(wrong.output)["nodes"]


def test_without_a_router_the_commands_say_so(router: Router) -> None:
    router.stop()
    for command in ("list", "check"):
        said = CliRunner().invoke(app, [command, "--ros-router", router.endpoint])
        assert f"no Zenoh router answers at {router.endpoint}" in " ".join(said.output.split())
