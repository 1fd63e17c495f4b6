"""The error, shared by the checks of a scenario, that names a place in the file."""

from __future__ import annotations

from dsr.config.toml_lines import Path
from dsr.errors import ConfigError
from dsr.network.keys import check_name


class InconsistencyError(ConfigError):
    """A value that does not fit the rest of the scenario."""

    def __init__(self, path: Path, message: str) -> None:
        super().__init__(message)
        self.path = path


def require(holds: bool, path: Path, message: str) -> None:
    """Raise `InconsistencyError` unless something holds."""
    if not holds:
        raise InconsistencyError(path, message)


def check_given_name(path: Path, name: str) -> None:
    """Raise `InconsistencyError` for a name that cannot be used."""
    try:
        check_name("name", name)
    except ConfigError as error:
        raise InconsistencyError(path, str(error)) from error
