"""System files: read, checked, changed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dsr.config.extras import MissingExtraError
from dsr.errors import ConfigError
from dsr.runtime.system import find_system, load_class, load_system

SYSTEMS = Path(__file__).parent / "systems"
COUNTER = '[[agent]]\nname = "a"\nclass = "toy_counter:Counter"\n'


def write(folder: Path, text: str) -> Path:
    for name in ("toy_agents.py", "toy_counter.py", "toy_owner.py"):
        (folder / name).symlink_to(SYSTEMS / name)
    file = folder / "system.toml"
    file.write_text('graph = "g"\n' + text)
    return file


def test_a_system_is_read_in_order_with_its_classes_and_configurations() -> None:
    system = load_system(SYSTEMS / "counters.toml")
    assert system.graph == "counters"
    first, second = system.agents
    assert (first.name, first.kind.__name__, first.program) == ("first", "Counter", "toy_counter:Counter")
    assert first.config == {}
    assert second.config == {"node": "cube_2", "step": 2.0}


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        (COUNTER + "rstart = true\n", 5, "unknown field 'rstart' in agent[0]; did you mean 'restart'?"),
        (COUNTER + "[agent.config]\nstp = 1.0\n", 6, "unknown field 'stp'; did you mean 'step'?"),
        (COUNTER + '[agent.config]\nstep = "far"\n', 6, "step: expected `float`, got `str`"),
        (COUNTER + COUNTER, 6, "two agents are called 'a'"),
        ('[[agent]]\nname = "a"\nclass = "toy_counter:Countr"\n', 4, "class 'toy_counter:Countr' cannot be loaded"),
        ('[[agent]]\nname = "a"\nclass = "nowhere"\n', 4, "class 'nowhere' cannot be loaded"),
        ('[[agent]]\nname = "a"\nclass = "pathlib:Path"\n', 4, "class 'pathlib:Path' is no dsr.agent.Agent"),
        ("agent = []\n", 2, "expected an agent at least"),
        ('[[agent]]\nname = "a b"\nclass = "toy_counter:Counter"\n', 3, "agent name 'a b': expected 1 to 64"),
    ],
)
def test_a_mistake_is_told_with_file_line_and_what_was_expected(
    tmp_path: Path, text: str, line: int, expected: str
) -> None:
    file = write(tmp_path, text)
    with pytest.raises(ConfigError, match=re.escape(f"{file}:{line}: {expected}")):
        load_system(file)


def test_a_system_of_which_all_agents_are_left_out_is_refused(tmp_path: Path) -> None:
    (tmp_path / "toy_heavy.py").write_text(
        "from dsr import Agent\n\n\nclass Heavy(Agent):\n    libraries = ('no_such_library',)\n"
    )
    file = write(tmp_path, '[[agent]]\nname = "a"\nclass = "toy_heavy:Heavy"\noptional = true\n')
    with pytest.raises(ConfigError, match="no agent is left to run"):
        load_system(file)


def test_two_exclusive_writers_of_one_thing_are_refused(tmp_path: Path) -> None:
    file = write(tmp_path, COUNTER + '[[agent]]\nname = "owner"\nclass = "toy_owner:Owner"\n')
    with pytest.raises(ConfigError, match=r"system\.toml: agents 'owner' and 'a' cannot run together.*'mass'"):
        load_system(file)


def test_an_unknown_system_names_a_known_one() -> None:
    with pytest.raises(ConfigError, match="unknown system 'tabletp'; did you mean 'tabletop'"):
        find_system("tabletp")


def test_a_configuration_is_changed_in_a_copy_and_checked() -> None:
    system = load_system(SYSTEMS / "counters.toml")
    changed = system.with_config("second", step=3.0)
    assert changed.agent("second").config == {"node": "cube_2", "step": 3.0}
    assert system.agent("second").config["step"] == 2.0
    with pytest.raises(ConfigError, match="agent 'second': unknown field 'stp'"):
        system.with_config("second", stp=3.0)
    with pytest.raises(ConfigError, match="no agent 'secnd'; did you mean 'second'"):
        system.with_config("secnd", step=3.0)


def test_agents_are_left_out_and_the_graph_is_renamed() -> None:
    system = load_system(SYSTEMS / "counters.toml").without("first").on_graph("other")
    assert ([spec.name for spec in system.agents], system.graph) == (["second"], "other")
    with pytest.raises(ConfigError, match="graph name 'a/b'"):
        system.on_graph("a/b")


def test_the_folder_of_the_run_is_filled_in() -> None:
    system = load_system(SYSTEMS / "counters.toml").with_config("first", node="{run}/x")
    assert system.in_folder(Path("/tmp/r")).agent("first").config == {"node": "/tmp/r/x"}


def test_a_class_that_is_no_agent_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"no dsr\.agent\.Agent"):
        load_class("dsr.agent:make_agent")


@pytest.mark.parametrize("file", sorted(Path("etc/systems").glob("*.toml")), ids=str)
def test_every_system_that_comes_along_can_be_loaded(file: Path) -> None:
    assert load_system(file).agents


OFFLINE = """
from dsr import Agent

class Drawer(Agent):
    name = "drawer"
    libraries = ("json", "library_that_is_not_there")
"""


def test_an_agent_without_one_of_its_libraries_is_left_out_if_it_is_optional(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Its class names what `setup` imports: nobody else has to, to find out."""
    (tmp_path / "toy_drawer.py").write_text(OFFLINE)
    drawer = '[[agent]]\nname = "drawer"\nclass = "toy_drawer:Drawer"\n'
    file = write(tmp_path, COUNTER + drawer)
    missing = "class 'toy_drawer:Drawer' cannot be loaded: the library 'library_that_is_not_there' is not installed"
    with pytest.raises(MissingExtraError, match=re.escape(missing)):
        load_class("toy_drawer:Drawer", tmp_path)
    with pytest.raises(ConfigError, match=re.escape(missing)):
        load_system(file)
    file.write_text(file.read_text() + "optional = true\n")
    assert [spec.name for spec in load_system(file).agents] == ["a"]
    assert f"drawer is left out: {missing}" in caplog.text
