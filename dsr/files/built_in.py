"""Where the files that come with the project lie: systems, scenarios, objects, robots, the planning domain."""

from __future__ import annotations

from pathlib import Path

ETC = Path(__file__).resolve().parents[2] / "etc"
"""Folder of all of them."""
