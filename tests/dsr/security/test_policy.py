"""The policy file, and the rules for Zenoh that follow from it."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

from dsr.errors import ConfigError
from dsr.network.keys import Keys
from dsr.runtime.system import load_system
from dsr.security.configuration import access_control, own_keys
from dsr.security.policy import AccessPolicy, Grant, checked, read_policy, system_grants, write_policy

SYSTEMS = Path(__file__).parents[1] / "runtime" / "systems"


def test_a_policy_is_read_as_it_was_written(policy: AccessPolicy, tmp_path: Path) -> None:
    write_policy(tmp_path / "policy.json", policy)
    assert read_policy(tmp_path / "policy.json") == policy


def test_the_agents_of_a_system_are_granted_what_they_declare() -> None:
    grants = system_grants(load_system("tabletop"))
    assert {"Virtual_RT", "on", "sees"} <= set(grants["simulation_handler"].edges)
    assert grants["arm_controller"].publishes == ("blob/*", "device/*/command", "device/halted/*")
    assert grants["plant"].nodes == () and "truth" in grants["plant"].publishes
    assert grants["dsr"].read_only and grants["launcher"].trusted
    assert [name for name, grant in grants.items() if grant.trusted] == ["launcher"]


@pytest.mark.parametrize(
    "grants, message",
    [
        ({"arm": Grant(), "arm-left": Grant()}, "no name may be another's followed by '-'"),
        ({"a/b": Grant()}, "agent name"),
        ({"arm": Grant(publishes=("d/scene-1",))}, "publishes 'd/scene-1'"),
        ({"arm": Grant(publishes=("holders/**",))}, "publishes 'holders/"),
        ({"arm": Grant(publishes=("**",))}, "publishes"),
        ({"arm": Grant(publishes=("*/scene-1",))}, "publishes"),
        ({"arm": Grant(publishes=("device/a$*",))}, "publishes"),
        ({"arm": Grant(parts=("the kitchen",))}, "part 'the kitchen'"),
        ({"arm": Grant(publishes=("part/kitchen/d/scene-1",))}, "publishes"),
        ({"hub": Grant(nodes=("cube",), relay=True)}, "a relay, but may do more"),
        ({"arm": Grant(nodes=("cube",), read_only=True)}, "read-only, but may do more"),
    ],
)
def test_a_policy_that_cannot_be_kept_is_refused(grants: dict[str, Grant], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        checked(grants)


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "dsr security init"),
        ("{", "dsr security init"),
        ('{"agents": {"arm": {"node": []}}}', "unknown field 'node'"),
        ('{"agents": {"arm": {"nodes": "cube"}}}', "agents.nodes"),
    ],
)
def test_a_broken_policy_file_is_a_clear_error(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "policy.json"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_policy(file)


def test_every_key_on_which_something_can_be_said_has_one_owner(policy: AccessPolicy) -> None:
    owners = [key for name, grant in policy.agents.items() for key in own_keys(name, grant)]
    assert len(owners) == len(set(owners))


def test_a_grant_names_the_parts_in_which_an_agent_may_speak() -> None:
    def parts(grant: Grant) -> set[str]:
        return {key for key in own_keys("arm", grant) if "/part/" in key}

    one, all_of_them = Grant(parts=("kitchen",)), Grant()
    assert "dsr/v1/*/part/kitchen/d/arm-$*" in parts(one) and "dsr/v1/*/part/*/d/arm-$*" in parts(all_of_them)
    assert len(parts(one)) == len(parts(all_of_them)) == 5 and not parts(Grant(parts=()))
    assert one.includes_part("kitchen") and one.includes_part("") and not one.includes_part("hall")
    assert all_of_them.includes_part("hall")


def test_a_reader_is_told_everything_and_may_say_nothing(policy: AccessPolicy) -> None:
    rules = access_control(policy)
    granted = {entry["subjects"][0]: entry["rules"] for entry in rules["policies"]}
    assert granted["dsr"] == ["ask", "be told"]
    assert granted["arm"] == ["ask", "be told", "tell as arm"]
    told = [rule for rule in rules["rules"] if "put" in rule["messages"] and "ingress" in rule["flows"]]
    tellers = {f"tell as {name}" for name in ("arm", "scene", "launcher", "halt", "confirm")}
    assert {rule["id"] for rule in told} == tellers | {"pass on"}
    assert [name for name, rules in granted.items() if "pass on" in rules] == ["hub"]
    assert rules["default_permission"] == "deny"


def test_no_agent_can_be_granted_what_each_has_for_itself() -> None:
    """Keys that name a replica or an agent prove who sends on them."""
    keys = Keys("g")
    own = [keys.delta(), keys.stream(), keys.digest(), keys.sync(), keys.presence(), keys.holders(), keys.mesh(),
           keys.live(), keys.status(), keys.log()]  # fmt: skip
    takers = {name for name, made in inspect.getmembers(Keys, inspect.isfunction)
              if {"rid", "agent"} & inspect.signature(made).parameters.keys()}  # fmt: skip
    assert len(takers) == len(own)
    for key in own:
        with pytest.raises(ConfigError, match="publishes"):
            checked({"arm": Grant(publishes=(f"{key.removeprefix(keys.root).split('/')[1]}/**",))})
