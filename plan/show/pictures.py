"""Pictures of plans.

Motion, torques before and after, power, and cost against evaluations and time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from ident.arrays import Array
from ident.errors import InputError
from ident.files import atomic_write
from ident.outputs import mark_file
from plan.geometry.scene import FLOOR
from plan.problem.cost import energy_cost
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.rule_values import Rules
from plan.problem.rules import ViaPoint
from plan.solving.compare import Comparison
from plan.spline import Splines

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.text import Text

SAMPLES = 400
# Axes of cones that are drawn along a way, and their length [m].
ARROWS = 12
ARROW = 0.1
# A motion that takes so many times longer than the other one has a time axis of its own.
OWN_AXIS = 1.5
# Where each kind of picture says who made it.
MAKER = {".png": {"Software": "armgap"}, ".svg": {"Title": "armgap", "Date": None}}
# The same picture has the same bytes; LaTeX is not started, in a program that draws its own
# pictures so either.
SETTINGS: dict[Any, Any] = {"svg.hashsalt": "armgap", "text.usetex": False}
BEFORE = "#9aa5b1"
AFTER = "#0b6e99"
LIMIT = "#b3261e"
OBSTACLE = LIMIT
TOOL = "#e08e0b"
# From the side and from above.
VIEWS = ([0, 2], [0, 1])


def save_figure(figure: Figure, path: str | Path) -> None:
    """Writes a figure that names its maker, whole or not at all."""
    path = Path(path)
    require_picture(path)
    for text in figure.findobj(Text):
        text.set_usetex(False)
    maker = MAKER[path.suffix.lower()]
    with atomic_write(path) as temporary, matplotlib.rc_context(SETTINGS):
        figure.savefig(temporary, dpi=130, bbox_inches="tight", metadata=maker)
    plt.close(figure)


def draw_energy_curve(result: PlanResult) -> Figure:
    """Least energy over duration, alone and with the cell's standby, and the plan that is taken."""
    durations, energies = np.array(result.energy_curve).reshape(-1, 2).T
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    axes.plot(durations, energies, color=BEFORE, marker=".", label="motion")
    if result.standby > 0.0:
        whole = energy_cost(energies, durations, result.standby)
        words = f"with {result.standby:g} W standby"
        axes.plot(durations, whole, color=AFTER, marker=".", label=words)
    if result.splines is not None:
        duration = float(result.splines.total[0])
        axes.plot([duration], [result.cost], "o", color=LIMIT, label="this plan")
    axes.set_xlabel("duration [s]")
    axes.set_ylabel(f"least {result.metric} energy [J]")
    axes.legend(frameon=False, fontsize=8)
    return figure


def save_energy_curve(result: PlanResult, path: Path) -> None:
    """Writes the least energy over the duration as a picture, or as a table, by the path's suffix.

    A table (.csv) has the columns duration_s, energy_J and cost_J.
    """
    if path.suffix.lower() != ".csv":
        save_figure(draw_energy_curve(result), path)
        return
    lines = ["duration_s,energy_J,cost_J"]
    for duration, energy in result.energy_curve:
        cost = energy_cost(energy, duration, result.standby)
        lines.append(f"{duration:.6g},{energy:.6g},{cost:.6g}")
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    mark_file(path)


def require_curve(path: Path) -> None:
    """Raises InputError for a name by which no curve can be written."""
    known = (*MAKER, ".csv")
    if path.suffix.lower() not in known:
        remedy = f"end it in one of: {', '.join(known)}"
        raise InputError("--curve", f"{path.name!r} is no curve's name", remedy)


def require_picture(path: Path) -> None:
    """Raises InputError for a name by which no picture can be written."""
    if path.suffix.lower() not in MAKER:
        remedy = f"end it in one of: {', '.join(MAKER)}"
        raise InputError("--picture", f"{path.name!r} is no picture's name", remedy)


def draw_motion(problem: PlanningProblem, result: PlanResult) -> Figure:
    """Angles, torques against their limits and power of a plan, a column a joint, with the initial
    motion behind.

    Below them stands the arm at start and goal, with what it carries and what is in its way.
    """
    assert result.splines is not None
    n = problem.n
    slides = problem.scene.arm.sliding_joints
    scale = np.where(slides, 1.0, np.degrees(1.0))
    figure = plt.figure(figsize=(max(3.2 * n, 7), 11), layout="constrained")
    curves, places = np.asarray(figure.subfigures(2, 1, height_ratios=(7, 4)), dtype=object)
    axes = curves.subplots(3, n, sharex=True, squeeze=False)
    _draw_places(places, problem, result.splines)
    before = problem.decode(problem.initial)
    initial = problem.initial_evaluation
    words = f"initial ({problem.label})"
    if not initial.feasible[0]:
        broken = "hits something" if initial.collision[0] > 0 else "breaks a limit"
        words += f": not allowed, it {broken}"
    slower = float(before.total[0] / max(result.splines.total[0], 1e-9))
    if 1.0 / OWN_AXIS < slower < OWN_AXIS:
        slower = 1.0
    for splines, colour, label in ((before, BEFORE, words), (result.splines, AFTER, "this plan")):
        times = np.linspace(0.0, float(splines.total[0]), SAMPLES)
        q, dq, ddq = splines.at(times)
        tau = problem.model.torque(q[None], dq[None], ddq[None])[0]
        times = times / slower if splines is before else times
        for j in range(n):
            axes[0, j].plot(times, scale[j] * q[:, j], color=colour, label=label)
            axes[1, j].plot(times, tau[:, j], color=colour)
            axes[2, j].plot(times, tau[:, j] * dq[:, j], color=colour)
    stamps = np.cumsum(result.splines.durations[0])[:-1]
    for j in range(n):
        if len(stamps) <= 10:
            angles = scale[j] * result.splines.points[0, 1:-1, j]
            axes[0, j].plot(stamps, angles, "o", color=AFTER, ms=4, label="via points")
        for limit in (-problem.limits.torque[j], problem.limits.torque[j]):
            axes[1, j].axhline(limit, color=LIMIT, lw=1, label="torque limit")
        if slower != 1.0:
            scales = (lambda t: t * slower, lambda t: t / slower)
            top = axes[0, j].secondary_xaxis("top", functions=scales)
            top.set_xlabel("initial: time [s]", color=BEFORE)
            top.tick_params(colors=BEFORE)
        name = problem.scene.arm.joint_names[j]
        axes[0, j].set_title(name, parse_math=False)  # a name is no formula
        axes[2, j].set_xlabel("time [s]")
        axes[2, j].axhline(0, color="#cccccc", lw=0.8, zorder=0)
    for j in sorted({0, *np.flatnonzero(slides)}):
        names = ("position [m]", "force [N]") if slides[j] else ("angle [deg]", "torque [N m]")
        for row, name in enumerate((*names, "power [W]")):
            axes[row, j].set_ylabel(name)
    figure.suptitle(_motion_title(result))
    of_angles, _ = axes[0, 0].get_legend_handles_labels()
    handles = [*of_angles, axes[1, 0].lines[-1]]
    curves.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _draw_places(figure: Any, problem: PlanningProblem, splines: Splines) -> None:
    """Boxes round all shapes from the side and from above.

    The arm at the start and, lighter, at the goal.
    """
    scene = problem.scene
    data = scene.arm.model.createData()
    model = scene.arm.model
    carried = {}
    for body in problem.carried:
        carried[str(body["name"])] = f"{body['name']} on {body['link']}"
    views = figure.subplots(1, 2)
    for q, alpha in ((splines.points[0, -1], 0.25), (splines.points[0, 0], 0.7)):
        pin.forwardKinematics(model, data, np.array(q))
        for box in scene.boxes:
            if box.name == FLOOR:
                continue
            pose = data.oMi[box.joint]
            colour = TOOL if box.name in carried else AFTER
            if box.body < 0:
                colour = OBSTACLE
            label = carried.pop(box.name, None) if alpha > 0.5 else None
            for piece in box.parts:
                corners = piece.corners
                if box.joint != 0:
                    corners = corners @ pose.rotation.T + pose.translation
                for axis, columns in zip(views, VIEWS, strict=True):
                    flat = corners[:, columns]
                    outline = flat[ConvexHull(flat).vertices]
                    axis.fill(*outline.T, color=colour, alpha=alpha, lw=0, label=label)
    _draw_way(views, problem, splines)
    for axis, name in zip(views, ("z", "y"), strict=True):
        axis.set(aspect="equal", xlabel="x [m]", ylabel=f"{name} [m]")
    handles, labels = views[0].get_legend_handles_labels()
    if handles:
        place = "outside lower center"
        legend = figure.legend(handles, labels, loc=place, frameon=False, fontsize=8)
        for text in legend.get_texts():
            text.set_parse_math(False)
    title = "boxes round the arm's shapes at the start, and lighter at the goal"
    figure.suptitle(title, fontsize=9)


def _place_of(via: ViaPoint, rules: Rules) -> Array:
    """Where the tool is at a via point [m]."""
    return via.target if via.of_tool else rules.tool(via.target[None])[0][0]


def _draw_way(views: Any, problem: PlanningProblem, splines: Splines) -> None:
    """The tool's way where it has to keep something: via points and the axes of cones, too."""
    rules = problem.rules
    if rules is None:
        return
    times = np.linspace(0.0, float(splines.total[0]), SAMPLES)
    place, turn, _, _ = rules.tool(splines.at(times)[0])
    vias = [_place_of(via, rules) for via in rules.rules.vias]
    some = slice(None, None, SAMPLES // ARROWS)
    for axis, columns in zip(views, VIEWS, strict=True):
        axis.plot(*place[:, columns].T, color="black", lw=1.2, label=f"way of {rules.frame}")
        for passed in vias:
            axis.plot(*passed[columns], "x", color="black", ms=6)
        for cone in rules.rules.cones:
            for begin, pointing in zip(place[some], turn[some] @ cone.axis, strict=True):
                ends = np.stack([begin, begin + ARROW * pointing])
                axis.plot(*ends[:, columns].T, color=TOOL, lw=0.8)


def _motion_title(result: PlanResult) -> str:
    splines = result.splines
    certificate = result.certificate
    if splines is None or certificate is None or not result.solved:
        return f"{result.method}: no allowed motion ({result.status})"
    duration = float(splines.total[0])
    energy = certificate.energy[result.metric]
    clearance = 1000 * certificate.closest.proven
    unit = "N² m² s" if result.metric == "copper" else "J"
    near = f", at least {clearance:.0f} mm clear of everything" if clearance < 1000 else ""
    return f"{result.method}: {duration:.3f} s, {energy:.2f} {unit} ({result.metric}){near}"


def draw_comparison(comparison: Comparison) -> Figure:
    """Best allowed cost so far against evaluations and time.

    Each method's median run; its other seeds thinner.
    """
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True)
    timed = comparison.objective == "time"
    everything = []
    for i, method in enumerate(comparison.methods):
        runs = sorted(comparison.of(method), key=lambda run: run.cost)
        middle = runs[len(runs) // 2]
        colour = plt.get_cmap("tab10")(i)
        cost = f"{middle.cost:.4g}{' s' * timed}" if middle.solved else "no plan"
        for run in runs:
            rows = np.array([row for row in run.history if np.isfinite(row[2])])
            if len(rows) == 0:
                continue
            everything += rows[:, 2].tolist()
            thick, alpha, dot = (1.8, 1.0, 4) if run is middle else (0.6, 0.4, 2)
            costs = np.append(rows[:, 2], rows[-1, 2])
            label = f"{method}: {cost}" if run is middle else None
            ends = (run.evaluations, run.cpu_seconds)
            for axis, column, spent in zip(axes, (0, 1), ends, strict=True):
                x = np.maximum(rows[:, column], 1e-3)
                x = np.append(x, max(spent, x[-1]))
                axis.step(x, costs, where="post", color=colour, lw=thick, alpha=alpha, label=label)
                axis.plot(x[-1], costs[-1], "o", color=colour, ms=dot)
    if everything:
        low = min(everything)
        high = float(np.quantile(everything, 0.9))
        axes[0].set_ylim(low - 0.05 * (high - low), high + 0.3 * (high - low))
    metric = comparison.results[0].metric
    unit = "duration [s]"
    if not timed:
        unit = "∫ τ² dt [N² m² s]" if metric == "copper" else f"{metric} energy [J]"
    axes[0].set_ylabel(f"best allowed plan so far: {unit}")
    names = ("trajectories evaluated", "processor time of the search [s]")
    for axis, name in zip(axes, names, strict=True):
        axis.set(xscale="log", xlabel=name)
        axis.grid(alpha=0.25)
    axes[0].legend(frameon=False, fontsize=8)
    words = "Lower is better; thick: the median seed, thin: the others, dot: the search's end"
    figure.suptitle(f"{comparison.name}. {words}", parse_math=False)
    figure.tight_layout()
    return figure
