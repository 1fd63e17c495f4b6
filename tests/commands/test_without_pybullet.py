"""The set-up without a C++ compiler tells which commands work without pybullet; these do."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from tests.command_tree import leaves

SETUP = Path(__file__).parents[2] / ".ci" / "setup"


def commands_that_work() -> list[str]:
    """The commands that the message of the set-up lists."""
    text = re.search(r"works: .*?dsr (.*?)\n  does not work", SETUP.read_text(encoding="utf-8"), re.DOTALL)
    assert text is not None
    return [name.strip() for name in text[1].split(",")]


def test_the_set_up_names_commands_that_there_are() -> None:
    assert len(commands_that_work()) > 15
    assert all(any(path.split()[0] == name for path in leaves()) for name in commands_that_work())


def test_they_are_imported_without_it() -> None:
    program = (
        "import sys; sys.modules['pybullet'] = sys.modules['pybullet_data'] = None\n"
        "from dsr.cli.commands import load_command\n"
        f"for name in {commands_that_work()!r}: load_command(name)\n"
    )
    subprocess.run([sys.executable, "-c", program], timeout=60, check=True)
