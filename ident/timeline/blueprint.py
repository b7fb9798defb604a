"""How the viewer lays the timeline out: a tab a joint, the arm beside it, the log below."""

from __future__ import annotations

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

TIMELINE = "time"


def make_blueprint(joints: Sequence[str], with_model: bool, with_arm: bool) -> rrb.Blueprint:
    """The layout.

    Args:
        joints: Joint names.
        with_model: Whether there are rungs to compare.
        with_arm: Whether there are boxes to show.
    """
    tabs = [_joint_tab(joint, with_model) for joint in joints]
    what = "residual" if with_model else "torque"
    overview = rrb.Grid(*[_series(joint, what, joint) for joint in joints], grid_columns=2, name=f"all joints: {what}")
    series = rrb.Tabs(overview, *tabs, active_tab=0)
    log = rrb.TextLogView(origin="/log", name="runs, telemetry, marks")
    left = rrb.Vertical(
        *([rrb.Spatial3DView(origin="/arm", name="arm")] if with_arm else []),
        log,
        row_shares=[3, 2] if with_arm else [1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, series, column_shares=[2, 5]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _joint_tab(joint: str, with_model: bool) -> rrb.Container:
    rows = [("torque", "torque [N m]")]
    if with_model:
        rows += [("residual", "residual: measured − modelled [N m]"), ("energy", "energy since the run's start [J]")]
    rows += [("power", "power [W]"), ("motion", "position and velocity")]
    shares = [3] + [2] * (len(rows) - 1)
    return rrb.Vertical(*[_series(joint, key, name) for key, name in rows], row_shares=shares, name=joint)


def _series(joint: str, key: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=str(entity(joint, key)), name=name, plot_legend=rrb.PlotLegend(visible=True, corner=rrb.Corner2D.LeftTop)
    )


def entity(joint: str, *parts: str) -> str:
    """Path of a joint's series."""
    return "/joints/" + "/".join(rr.escape_entity_path_part(part) for part in (joint, *parts))
