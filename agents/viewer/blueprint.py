"""How the views are arranged; saved in the recording, so that it opens like this everywhere."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from agents.viewer import calibrations, chronicle, events, graph_view, mind, scene, series, told, topology_view
from agents.viewer.elapsed import ELAPSED
from agents.viewer.framing import ANYWHERE, Focus

APPLICATION = "dsr"
"""Of the recordings, by which rerun knows what arrangement belongs to them."""
_AFAR, _ALL = (1.35, -0.9, 0.85), (0.2, 0.03, 0.34)
"""m, where the eye of the overview is and where it looks, if the objects are at the height of the world's origin."""
_FROM = (0.74, -0.52, 0.42)
"""Direction from what the close-up shows to its eye: from the front, at the right, from above."""
_BACKGROUND = (24, 27, 32)


def make_blueprint(cameras: Sequence[str], with_truth: bool, focus: Focus = ANYWHERE) -> rrb.Blueprint:
    """The arrangement: the scene large, around it what explains it.

    Args:
        cameras: that send images.
        with_truth: errors against the truth are known.
        focus: of the close-up.
    """
    left = rrb.Vertical(_scenes(cameras, focus), _graph(), row_shares=[6, 5])
    right = rrb.Vertical(*_thoughts(), _numbers(with_truth), _happenings(), row_shares=[8, 8, 5, 6])
    overview = rrb.Horizontal(left, right, column_shares=[5, 3], name="Overview")
    return _blueprint(rrb.Tabs(overview, _memory("Working memory, large"), active_tab=0))


def make_graph_blueprint() -> rrb.Blueprint:
    """The arrangement with nothing but the graph."""
    return _blueprint(_memory("Working memory"))


def _blueprint(content: rrb.Container | rrb.View) -> rrb.Blueprint:
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=ELAPSED, play_state="following"),
    )


def _scenes(cameras: Sequence[str], focus: Focus) -> rrb.Container:
    """All of it and what cameras see of it, and its objects from nearby."""
    all_of_it = _scene("Scene", ["$origin/**", f"- $origin/{scene.NAMES}"], _afar(focus))
    parts = ("table", "percepts", "beliefs", "surprising", "robot/grippers", scene.NAMES)
    close_up = _scene(
        "Belief solid, held green; percepts orange; surprising red",
        [f"$origin/{part}" for part in parts],
        _nearby(focus),
    )
    return rrb.Horizontal(rrb.Vertical(all_of_it, _images(cameras)), close_up, column_shares=[2, 3])


def _afar(focus: Focus) -> rrb.EyeControls3D:
    raised = focus.at[2] - ANYWHERE.at[2]
    position, target = ((x, y, z + raised) for x, y, z in (_AFAR, _ALL))
    return rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 0.0, 1.0))


def _nearby(focus: Focus) -> rrb.EyeControls3D:
    position = [at + focus.distance * along for at, along in zip(focus.at, _FROM, strict=True)]
    return rrb.EyeControls3D(position=position, look_target=focus.at, eye_up=(0.0, 0.0, 1.0))


def _scene(name: str, contents: list[str], eye: rrb.EyeControls3D) -> rrb.View:
    background = rrb.Background(color=_BACKGROUND)
    return rrb.Spatial3DView(
        origin=scene.ENTITY, name=name, contents=contents, line_grid=False, background=background, eye_controls=eye
    )


def _thoughts() -> tuple[rrb.View, rrb.Container]:
    """What the robot is about to do, and what it makes of what it sees."""
    plan = rrb.TextDocumentView(origin=mind.PLAN, name="Mission and plan")
    explanations = rrb.TextDocumentView(origin=mind.EXPLANATIONS, name="Surprises and explanations")
    words = rrb.TextDocumentView(origin=told.PAGE, name="In words")
    cameras = rrb.TextDocumentView(origin=calibrations.PAGE, name="Calibrations")
    return plan, rrb.Tabs(explanations, words, cameras, active_tab=0)


def _graph() -> rrb.Container:
    return rrb.Tabs(_memory("Working memory"), _worlds(), active_tab=0)


def _memory(name: str) -> rrb.View:
    return rrb.Spatial2DView(origin=graph_view.ENTITY, name=name, background=graph_view.BACKGROUND)


def _worlds() -> rrb.View:
    return rrb.GraphView(origin=topology_view.ENTITY, name="Worlds")


def _images(cameras: Sequence[str]) -> rrb.Container | rrb.View:
    views = [rrb.Spatial2DView(origin=scene.camera_entity(camera), name=camera) for camera in cameras]
    return rrb.Tabs(*views) if views else rrb.TextDocumentView(origin="none", name="no camera image yet")


def _numbers(with_truth: bool) -> rrb.Container:
    errors = rrb.TimeSeriesView(
        origin=series.ERRORS,
        name="Error [mm]: percepts, beliefs",
        plot_legend=rrb.PlotLegend(visible=True, corner=rrb.Corner2D.LeftTop),
    )
    distances = rrb.TimeSeriesView(origin=series.DISTANCES, name="Percept to belief [mm]")
    rates = rrb.TimeSeriesView(origin=series.RATES, name="Agents [Hz]")
    residuals = rrb.BarChartView(origin=calibrations.RESIDUALS, name="Calibration [mm]: objects before, after")
    return rrb.Tabs(*([errors] if with_truth else []), distances, rates, residuals, active_tab=0)


def _happenings() -> rrb.Container:
    """What was said, and what lasted from when to when."""
    lasting = rrb.StateTimelineView(origin=chronicle.ENTITY, name="Timeline")
    return rrb.Tabs(_lines(events.ENTITY, "Events"), lasting, _lines(events.LOGS, "Logs of agents"), active_tab=0)


def _lines(origin: str, name: str) -> rrb.View:
    """The lines say when and who, in less room than columns would take."""
    columns = rrb.TextLogColumns(
        timeline_columns=[rrb.encodings.TimelineColumn(ELAPSED, visible=False)], text_log_columns=["Body"]
    )
    return rrb.TextLogView(origin=origin, name=name, columns=columns)
