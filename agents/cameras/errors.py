"""What can go wrong with a camera while it is read."""

from __future__ import annotations

from dsr.errors import DsrError


class DeviceError(DsrError):
    """The device is not there, may not be used, or gives nothing any more: it is to be opened again."""


class CorruptFrameError(DsrError):
    """One picture cannot be used; the next one may be well."""


class EndOfPicturesError(DsrError):
    """The file is at its end: nothing comes any more."""
