"""Errors of the bridge to ROS 2."""

from __future__ import annotations

from dsr.errors import ConfigError, DsrError


class RosError(DsrError):
    """Root of all errors of the bridge to ROS 2."""


class RosMessageError(RosError):
    """Bytes that are no valid message of the type, or a type or value that cannot be encoded."""


class RosLinkError(RosError):
    """The connection to ROS refuses what was asked, or nobody is there to do it."""


class RosSettingError(RosLinkError, ConfigError):
    """How ROS is to be reached makes no sense, or is not allowed: no further attempt would help."""


class RosTimeoutError(RosLinkError):
    """Nobody answered in time."""


class RosAbsentError(RosTimeoutError):
    """Nobody was there to be asked, for as long as was to be waited."""
