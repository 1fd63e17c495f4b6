"""What `dsr scenario check` finds by playing the true course of a file: faults that no reading of it shows."""

from __future__ import annotations

from agents.scenario.explain import value_error
from agents.scenario.faults import faults
from agents.scenario.runner import true_course
from agents.scenario.staging import make_run
from dsr.errors import ConfigError


def played_errors(name_or_path: str, *, beside: bool = True) -> list[ConfigError]:
    """The faults of the course with seed 0, as errors with file and line; without events nothing is played.

    Unless `beside`, modules beside the file of the system are not imported.

    Raises:
        ConfigError: if the file is wrong or cannot be played.
    """
    run = make_run(name_or_path, beside=beside)
    if not run.scenario.events:
        return []
    found = faults(true_course(run))
    text = run.file.read_text(encoding="utf-8")
    return [value_error(fault.text, ("event", fault.event - 1), text, name_or_path) for fault in found]
