"""When a flag is raised and cleared: at once for a reason, and only when percept and belief agree again."""

from __future__ import annotations

import math
from collections.abc import Sequence

from surprise.config import SurpriseConfig
from surprise.evidence import Reason

_NEWS = 0.2  # share by which a figure must change to be told again


class Suspicion:
    """Decides whether one object or camera is surprising, and why."""

    def __init__(self, config: SurpriseConfig, *, raised: bool = False, text: str = "") -> None:
        """`raised` and `text` are what an earlier run of this agent wrote."""
        self._config = config
        self.raised = raised
        self.text = text
        self._told: list[Reason] = []
        self._told_at = -math.inf
        self._calm_since: float | None = None

    def update(self, now: float, reasons: Sequence[Reason], *, agrees: bool, undecided: bool) -> bool:
        """Take in the reasons at `now` (s), and return whether flag or text changed.

        Args:
            now: s.
            reasons: why it is surprising; none if nothing speaks for that.
            agrees: percept and belief agree: the flag goes at once.
            undecided: there is something new that neither agrees nor contradicts: the flag stays.
        """
        if reasons:
            self._calm_since = None
            return self._tell(now, reasons)
        if not self.raised:
            return False
        if undecided and not agrees:
            self._calm_since = None
            return False
        self._calm_since = now if self._calm_since is None else min(self._calm_since, now)
        if agrees or now - self._calm_since >= self._config.telling:
            self.raised, self.text, self._told, self._calm_since = False, "", [], None
            return True
        return False

    def _tell(self, now: float, reasons: Sequence[Reason]) -> bool:
        """Raise the flag; the same reasons with other figures are told again now and then."""
        same = [reason.kind for reason in reasons] == [reason.kind for reason in self._told]
        if self.raised and same and not (self._is_due(now) and self._are_news(reasons)):
            return False
        text = "; ".join(reason.text for reason in reasons)
        changed = not self.raised or text != self.text
        self.raised, self.text, self._told, self._told_at = True, text, list(reasons), now
        return changed

    def _is_due(self, now: float) -> bool:
        return not self._told_at <= now < self._told_at + self._config.telling

    def _are_news(self, reasons: Sequence[Reason]) -> bool:
        pairs = zip(reasons, self._told, strict=True)
        return any(abs(new.extent - old.extent) > _NEWS * old.extent for new, old in pairs)
