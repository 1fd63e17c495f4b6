"""Where the files that come with the project lie: systems, scenarios, objects, robots, the planning domain."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_INSTALLED, _CHECKOUT = _PACKAGE / "etc", _PACKAGE.parent / "etc"
ETC = _INSTALLED if _INSTALLED.is_dir() else _CHECKOUT
"""Folder of all of them: within the package where that is installed, beside it in a checkout."""
