"""Fitted parameters on an evaluation's page: losses with intervals, inertias, the net's part."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.fitting.in_words import pair_in_words
from ident.model.hybrid import HybridModel
from ident.model.loss import NAMES
from ident.show.fit_lines import describe_carried, describe_foretold, foretold_of
from ident.show.palette import INK, model_colour
from ident.show.report.evaluation import ReportInput
from ident.show.report.figures import make_panel, to_svg
from ident.show.report.page import Section
from ident.show.report.words import fixed, significant, with_units

NEAR_THE_URDF = "Link inertias were fitted near the URDF's"
WRITTEN_BACK = (
    "Base parameters were fitted and written back with as little change to the URDF as that needs; "
    "single link numbers need not be physical, only their sums act: "
)
WORDS = {
    "motor_inertia": "Rotor inertia B_m",
    "viscous": "Viscous friction C_m",
    "coulomb": "Coulomb friction f_c",
    "offset": "Torque offset",
}


def parameters_section(source: ReportInput) -> Section:
    """Loss parameters with their 95 % intervals: one picture each, joints in rows, models side by
    side.
    """
    names = [evaluation.model for evaluation in source.evaluations]
    values = parameters_values(source.models, names, source.main)
    return Section("parameters", "What was fitted", "parameters.html", values)


def parameters_values(
    models: Sequence[HybridModel], names: Sequence[str], main: int, losses: bool = True
) -> dict[str, Any]:
    """What the template of parameters gets.

    Args:
        models, names: Fitted models, and what each is called.
        main: Which of them the page speaks of first.
        losses: Whether losses and the error on unseen parts are to be shown, too.
    """
    model = models[main]
    known = {figure.name for fitted in models for figure in fitted.figures}
    shown = [name for name in NAMES if name in known] if losses else []
    units = {figure.name: figure.unit for figure in reversed(model.figures)}
    links: Iterable[Any] = ()
    if model.inertia != "nominal":
        links = zip(model.nominal.links, *before_and_after(model), strict=True)
    named = [with_units(law.describe(model.joint_names)) for law in model.named]
    return {
        "models": [(name, model_colour(k)) for k, name in enumerate(names)],
        "pictures": [draw_figures(models, name) for name in shown],
        "model": names[main],
        "columns": [(WORDS[name], units.get(name, "")) for name in shown],
        "figures": {(figure.joint, figure.name): figure for figure in model.figures},
        "shown": shown,
        "inertia": describe_inertia(model),
        "links": links,
        "fitted": model,
        "tied": [pair_in_words(*pair["figures"]) for pair in model.provenance.get("tied", [])],
        "named": named,
        "carried": describe_carried(model),
        "foretold": describe_foretold(model) if losses else "",
        "foretold_rows": [joint.cells for joint in foretold_of(model)] if losses else [],
        "left_out": model.provenance.get("named_left_out", []),
        "net": net_rows(model),
    }


def draw_figures(models: Sequence[HybridModel], name: str) -> dict[str, Any]:
    """One loss parameter of all joints and models: a dot and its 95 % interval."""
    joints = list(max(models, key=lambda model: model.arm.n).joint_names)
    figures = [figure for model in models for figure in model.figures if figure.name == name]
    unit = figures[0].unit
    longest = max(len(joint) for joint in joints)
    height = 0.55 + 0.24 * len(joints) + 0.04 * len(joints) * (len(models) - 1)
    figure, axes = make_panel(f"[{unit}]", "", (3.5, height), left=min(1.5, 0.2 + 0.068 * longest))
    for k, model in enumerate(models):
        beside = 0.16 * (k - (len(models) - 1) / 2)
        rows = []
        x = []
        below = []
        above = []
        for parameter in model.figures:
            if parameter.name == name and parameter.joint in joints:
                rows.append(joints.index(parameter.joint) + beside)
                x.append(parameter.value)
                below.append(max(parameter.value - parameter.low, 0.0))
                above.append(max(parameter.high - parameter.value, 0.0))
        colour = model_colour(k)
        reach = np.array([below, above])
        axes.errorbar(x, rows, xerr=reach, fmt="o", markersize=3, color=colour, linewidth=1.1)
    axes.set_yticks(range(len(joints)), joints)
    axes.set_ylim(len(joints) - 0.4, -0.6)
    axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    axes.grid(axis="y", visible=False)
    axes.axvline(0.0, color=INK, linewidth=0.6)
    svg = to_svg(figure, f"{WORDS[name]} of every joint")
    return {"title": f"{WORDS[name]} [{unit}]", "svg": svg}


def describe_inertia(model: HybridModel) -> str:
    """What was done to the link inertias, in a sentence or two."""
    if model.inertia == "nominal":
        text = "Link inertias are the URDF's; nothing was fitted."
    else:
        before, after = before_and_after(model)
        text = WRITTEN_BACK
        if model.inertia == "consistent":
            text = f"{NEAR_THE_URDF}, under the condition that every link could be a real body: "
        masses = f"{fixed(before[:, 0].sum(), 2)} → {fixed(after[:, 0].sum(), 2)} kg"
        text += f"moving mass {masses}."
    condition = model.provenance.get("condition_number")
    if condition is not None:
        text += f" Condition number of the training motions: {significant(condition, 3)}."
    return text


def before_and_after(model: HybridModel) -> tuple[Float[Array, "l 10"], Float[Array, "l 10"]]:
    """Ten inertial numbers of every link: of the URDF, and as fitted."""
    before = model.nominal.inertial_parameters.reshape(-1, 10)
    after = model.arm.inertial_parameters.reshape(-1, 10)
    return before, after


def net_rows(model: HybridModel) -> list[dict[str, Any]]:
    """What the residual net did on runs that it never saw, and how much of it each joint keeps;
    none without a net.

    Returns:
        Rows of "joint" and the fields of its gate (`JointGate.to_dict`); empty without a net.
    """
    gates = model.provenance.get("net_gate", [])
    if len(gates) != len(model.joint_names):
        return []
    return [{"joint": joint, **gate} for joint, gate in zip(model.joint_names, gates, strict=True)]
