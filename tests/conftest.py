"""What all tests share: no time limit for single examples of hypothesis, because machines are shared."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("dsr", deadline=None)
settings.load_profile("dsr")
