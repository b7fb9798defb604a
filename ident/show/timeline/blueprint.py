"""How the viewer lays the timeline out: a tab a joint, the arm beside it, the log below."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

TIMELINE = "time"


def make_blueprint(joints: Sequence[str], with_model: bool, reach: float) -> rrb.Blueprint:
    """The layout.

    Args:
        joints: Joint names.
        with_model: Whether there are rungs to compare.
        reach: How far the arm reaches [m], for the camera's place; 0 where there are no boxes to show.
    """
    tabs = [_joint_tab(joint, with_model) for joint in joints]
    what = "residual" if with_model else "torque"
    overview = rrb.Grid(*[_series(joint, what, joint) for joint in joints], grid_columns=2, name=f"all joints: {what}")
    series = rrb.Tabs(overview, *tabs, active_tab=0)
    log = rrb.TextLogView(origin="/log", name="runs, telemetry, marks")
    left = rrb.Vertical(
        *([_arm_view(reach)] if reach > 0 else []),
        log,
        row_shares=[3, 2] if reach > 0 else [1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, series, column_shares=[2, 5]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="paused"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _arm_view(reach: float) -> rrb.Spatial3DView:
    """The arm from the side and a little above, whole in any posture."""
    eye = rrb.EyeControls3D(
        position=[1.5 * reach, -1.5 * reach, 1.0 * reach], look_target=[0.0, 0.0, 0.3 * reach], eye_up=[0.0, 0.0, 1.0]
    )
    return rrb.Spatial3DView(origin="/arm", name="arm", eye_controls=eye)


def _joint_tab(joint: str, with_model: bool) -> rrb.Container:
    rows = [("torque", "torque [N m]")]
    if with_model:
        rows += [("residual", "residual: measured − modelled [N m]"), ("energy", "energy since the run's start [J]")]
    rows += [("power", "power [W]"), ("motion", "position and velocity")]
    shares = [3] + [2] * (len(rows) - 1)
    return rrb.Vertical(*[_series(joint, key, name) for key, name in rows], row_shares=shares, name=joint)


def _series(joint: str, key: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=str(entity(joint, key)),
        name=name,
        plot_legend=rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop),
    )


def entity(joint: str, *parts: str) -> str:
    """Path of a joint's series."""
    return "/joints/" + "/".join(rr.escape_entity_path_part(part) for part in (joint, *parts))
