"""Whether things can be taken from above, or what they are in is in the way, and would have to be lifted first."""

from __future__ import annotations

from functools import cached_property

from dsr.believing.distribution import Alternative
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.visibility import Body, Perspective, VisibleScene, body_at, is_seen, read_posed
from dsr.vocabulary.intrinsics import Intrinsics
from planner.config import PlannerConfig
from planner.outlook import DOWN, HIDING, WIDTH

_LENS = Intrinsics(0.5 * WIDTH, 0.5 * WIDTH, 0.5 * (WIDTH - 1), 0.5 * (WIDTH - 1), WIDTH, WIDTH)
"""Of a picture from above, as wide as twice its height"""


class Covers:
    """What hides things from right above, as all is believed when it is asked first.

    Args:
        memory: the graph.
        config: how high above the table an arm looks.
    """

    def __init__(self, memory: Memory, config: PlannerConfig) -> None:
        self._memory, self._height = memory, config.look_height

    @cached_property
    def _bodies(self) -> list[Body]:
        posed = [one for one in read_posed(self._memory) if one.kind in HIDING]
        return VisibleScene.of(self._memory, posed).bodies

    def reaches(self, name: str, one: Alternative, *, without: str = "") -> bool:
        """Whether the thing of that name is under no cover in an alternative, but for the cover `without`."""
        return self.cover_of(name, one) in ("", without)

    def cover_of(self, name: str, one: Alternative) -> str:
        """Name of what the thing of that name is in, in an alternative, and by which it is hidden from above.

        Empty if it is in nothing, or in something that is open above it, such as a tray.
        """
        containers = {*one.containers, *(edge.dst for edge in self._memory.edges("in", src=name))}
        node = self._memory.get_node(name)
        if not containers or one.pose is None or node is None:
            return ""
        body = body_at(self._memory, node, one.pose)
        if body is None:
            return ""
        x, y, z = one.pose.t
        eye = Perspective("", Pose((x, y, z + self._height), DOWN), _LENS)
        others = [other for other in self._bodies if other.name != name]
        shown = VisibleScene(others, frozenset()).seen_from(eye).would_show(body)
        return shown.hidden_by if not is_seen(shown) and shown.hidden_by in containers else ""
