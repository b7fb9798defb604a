"""Loss figures with their 95 % intervals, and what was done to the inertias."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.model.hybrid import HybridModel
from ident.model.loss import NAMES
from ident.show.palette import model_colour
from ident.show.report.evaluation import ReportInput
from ident.show.report.figures import make_panel, to_svg
from ident.show.report.page import Section
from ident.show.report.words import fixed, significant

WORDS = {
    "motor_inertia": "Rotor inertia B_m",
    "viscous": "Viscous friction C_m",
    "coulomb": "Coulomb friction f_c",
    "offset": "Torque offset",
}


def parameters_section(source: ReportInput) -> Section:
    """Loss figures with their 95 % intervals: one picture each, joints in rows, models side by side; then numbers."""
    model = source.model
    shown = [name for name in NAMES if any(f.name == name for m in source.models for f in m.figures)]
    values = {
        "models": [(one.model, model_colour(k)) for k, one in enumerate(source.evaluations)],
        "pictures": [draw_figures(source.models, name) for name in shown],
        "model": source.evaluation.model,
        "columns": [(WORDS[name], next((f.unit for f in model.figures if f.name == name), "")) for name in shown],
        "figures": {(figure.joint, figure.name): figure for figure in model.figures},
        "shown": shown,
        "inertia": describe_inertia(model),
        "links": () if model.inertia == "nominal" else zip(model.nominal.links, *before_and_after(model), strict=True),
        "fitted": model,
        "tied": [" with ".join(pair["figures"]) for pair in model.provenance.get("tied", [])],
        "named": [law.describe(model.joint_names) for law in model.named],
        "left_out": model.provenance.get("named_left_out", []),
        "net": net_rows(model),
    }
    return Section("parameters", "What was fitted", "parameters.html", values)


def draw_figures(models: Sequence[HybridModel], name: str) -> dict[str, Any]:
    """One loss figure of all joints and models: a dot and its 95 % interval."""
    joints = list(max(models, key=lambda model: model.arm.n).joint_names)
    unit = next(figure.unit for model in models for figure in model.figures if figure.name == name)
    longest = max(len(joint) for joint in joints)
    height = 0.55 + 0.24 * len(joints) + 0.04 * len(joints) * (len(models) - 1)
    figure, axes = make_panel(f"[{unit}]", "", (3.5, height), left=min(1.5, 0.2 + 0.068 * longest))
    for k, model in enumerate(models):
        found = [f for f in model.figures if f.name == name and f.joint in joints]
        y = [joints.index(f.joint) + 0.16 * (k - (len(models) - 1) / 2) for f in found]
        x = np.array([f.value for f in found])
        reach = np.array([[f.value - f.low, f.high - f.value] for f in found]).T.reshape(2, -1)
        axes.errorbar(x, y, xerr=np.maximum(reach, 0.0), fmt="o", markersize=3, color=model_colour(k), linewidth=1.1)
    axes.set_yticks(range(len(joints)), joints)
    axes.set_ylim(len(joints) - 0.4, -0.6)
    axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    axes.grid(axis="y", visible=False)
    axes.axvline(0.0, color="#333333", linewidth=0.6)
    return {"title": f"{WORDS[name]} [{unit}]", "svg": to_svg(figure, f"{WORDS[name]} of every joint")}


def describe_inertia(model: HybridModel) -> str:
    """What was done to the link inertias, in a sentence or two."""
    if model.inertia == "nominal":
        text = "Link inertias are the URDF's; nothing was fitted."
    else:
        before, after = (links[:, 0] for links in before_and_after(model))
        if model.inertia == "consistent":
            text = (
                "Link inertias were fitted near the URDF's, under the condition that every link could be a real body: "
            )
        else:
            text = (
                "Base parameters were fitted and written back with as little change to the URDF as that needs; "
                "single link numbers need not be physical, only their sums act: "
            )
        text += f"moving mass {fixed(before.sum(), 2)} → {fixed(after.sum(), 2)} kg."
    condition = model.provenance.get("condition_number")
    if condition is not None:
        text += f" Condition number of the training motions: {significant(condition, 3)}."
    return text


def before_and_after(model: HybridModel) -> tuple[Float[Array, "l 10"], Float[Array, "l 10"]]:
    """Inertial numbers of every link, of the URDF and as fitted."""
    return model.nominal.inertial_parameters.reshape(-1, 10), model.arm.inertial_parameters.reshape(-1, 10)


def net_rows(model: HybridModel) -> list[dict[str, Any]]:
    """What the residual net did on runs that it never saw, and how much of it each joint keeps; none without a net."""
    gates = model.provenance.get("net_gate", [])
    if len(gates) != len(model.joint_names):
        return []
    return [{"joint": joint, **one} for joint, one in zip(model.joint_names, gates, strict=True)]
