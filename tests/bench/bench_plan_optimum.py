"""How near the optimum the default plans are, how fast they come, and whether TOPP-RA can still shorten them.

    python tests/bench/bench_plan_optimum.py [TASKS] [--joints 3,6,7] [--obstacles 0,1,12] [--objectives energy,time]
                                             [--long STARTS] [--limit SECONDS] [--equal SECONDS]
                                             [--first SEED] [--model FOLDER] [--rows FILE]

Each drawn task is solved by the default method, by the same method from many more starts of another seed and then, for
the last fifth of `--limit`, by CMA-ES from the best of all ("long", the best known), and by trees and TOPP-RA on their
path (OMPL's RRTConnect where that is installed, our own trees where not), drawn again and again until as much processor
time is spent as the default method took, `--equal` seconds at most; that best is held against the default method's best
by then. What the lower bound leaves to be saved below the trees' best is told beside what was: where that is little,
nobody can save more. Every time plan is retimed by TOPP-RA under the full model, stretched until a dense check finds
every limit kept. Processor seconds throughout; all figures of a row come from one run. FILE gets a line a task as it is
done, and the summary speaks of all its lines: so a long run can be made in pieces.

Three joints: the TM5-900 with its wrist held. Six: the whole TM5-900. Seven: the Panda of example-robot-data.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.command_options import SolveOptions
from plan.dynamics.power import ChainTorque, torque_of_model
from plan.geometry.scene import Scene
from plan.geometry.solids import Box
from plan.initial.trees import Trees
from plan.initial.vias import from_vias, straight
from plan.paper.toppra import Toppra
from plan.planners.base import Ledger
from plan.planners.evolution import Evolution
from plan.planners.sequential import Sequential
from plan.problem.certificate import certify
from plan.problem.problem import Limits, PlanningProblem
from plan.solving.solve import solve
from tests.bench.peers.ompl_toppra import OmplToppra, is_installed

# Share of a long search that is CMA-ES's.
POLISHED = 0.2


@dataclass(frozen=True)
class Row:
    """One task's figures: costs, processor seconds, and what retiming gained; infinite where nothing was found."""

    joints: int
    objective: str
    boxes: int
    seed: int
    ours: float
    best: float
    peer: float
    by_then: float
    bound: float
    first: float
    near: float
    spent: float
    peer_spent: float
    gain: float

    @property
    def name(self) -> str:
        return f"{self.joints} joints, {self.objective}, {self.boxes} boxes, {self.seed}"

    @property
    def saved(self) -> float:
        """Share of the trees' cost that the default method had saved after the same time."""
        return 1.0 - self.by_then / self.peer

    @property
    def room(self) -> float:
        """Largest share of the trees' cost that any motion could save."""
        return 1.0 - self.bound / self.peer


def arm_of(joints: int) -> ArmModel:
    if joints == 7:
        arm = ArmModel.load("panda")
        return arm.locked(arm.joint_names[7:], [0.0] * (arm.n - 7))
    arm = ArmModel.load("tm5-900")
    return arm if joints == 6 else arm.locked(arm.joint_names[3:], [0.0, 0.0, 0.0])


def torque_of(arm: ArmModel, folder: str | None) -> ChainTorque:
    """A fitted model where one is given for the TM5-900; else friction of a usual size for each joint's rating."""
    if folder is not None and arm.n < 7:
        model = HybridModel.load(folder)
        return torque_of_model(model, arm.n, [0.0] * (len(model.joint_names) - arm.n))
    rated = arm.effort_limit
    losses = LossParameters(0.004 * rated, 0.04 * rated, 0.05 * rated, 0 * rated, np.full(arm.n, 0.01))
    return ChainTorque(arm.chain, losses)


def draw(arm: ArmModel, model: ChainTorque, objective: str, boxes: int, rng: np.random.Generator) -> PlanningProblem:
    """Free ends far enough apart; with obstacles, the straight line is blocked or all but."""
    low, high = np.maximum(arm.lower, -2.2) * 0.8, np.minimum(arm.upper, 2.2) * 0.8
    speed = np.minimum(arm.velocity_limit, np.pi)
    # Links of a Panda's hand are never farther apart than some millimetres.
    some = np.random.default_rng(0).uniform(low, high, (200, arm.n))  # leaves the task's own draws as they are
    near = min(0.02, 0.5 * float(Scene.build(arm).separation(some).max()))
    while True:
        scene = Scene.build(arm, [box(k, boxes, rng) for k in range(boxes)])
        for _ in range(200):
            ends = rng.uniform(low, high, (2, arm.n))
            ends[1] = np.clip(ends[1], ends[0] - 1.5, ends[0] + 1.5)
            line = ends[0] + np.linspace(0.0, 1.0, 40)[:, None] * (ends[1] - ends[0])
            far, blocked = np.abs(ends[1] - ends[0]).max() > 0.8, scene.separation(line).min() < near / 4
            if scene.separation(ends).min() > near and far and (blocked or not boxes):
                need = float(np.max(np.abs(ends[1] - ends[0]) / speed))
                limits = Limits(arm.lower, arm.upper, speed, arm.effort_limit, 0.005)
                vias, durations = straight(ends[0], ends[1], 2), np.full(3, 2.5 * need / 3)
                free = "vias" if objective == "energy" else "both"
                return PlanningProblem(
                    scene, model, limits, ends[0], ends[1], vias, durations, objective=objective, free=free
                )


def box(number: int, of: int, rng: np.random.Generator) -> Box:
    """A box beside the base; the more there are, the smaller."""
    angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.9)
    place = [away * np.cos(angle), away * np.sin(angle), rng.uniform(0.1, 1.0)]
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    size = 0.12 if of < 12 else 0.06 if of < 50 else 0.03
    return Box(f"box {number}", 0, q * np.linalg.det(q), place, rng.uniform(0.5, 1.0, 3) * size)


def long_search(task: PlanningProblem, starts: int, known: PlanningProblem | None, seconds: float) -> float:
    """The best of many starts, and of CMA-ES from the best known on a grid that is coarse enough for it."""
    ledger = Ledger(10**7, (1.0 - POLISHED) * seconds)
    Sequential(starts=starts, kept=(8, 6, 4, 2)).run([task], ledger, np.random.default_rng(99))
    around = [p for p in (known, ledger.best.problem if ledger.best else None) if p is not None and p.dimension < 60]
    polish = Ledger(10**7, POLISHED * seconds)
    if around:
        Evolution(step=0.01, most=6000).run([replace(p, radius=0.3) for p in around], polish, np.random.default_rng(98))
    return min((one.best.cost for one in (ledger, polish) if one.best and one.best.feasible), default=np.inf)


def peer(task: PlanningProblem, seconds: float) -> tuple[float, float]:
    """Best cost of trees timed by TOPP-RA, or stretched to the time that the task gives, and a try's processor time."""
    started, best, tries = time.process_time(), np.inf, 0
    while tries == 0 or time.process_time() - started < seconds:
        best, tries = min(best, one_try(task, tries)), tries + 1
    return best, (time.process_time() - started) / tries


def one_try(task: PlanningProblem, seed: int) -> float:
    """Cost of one path of the trees; infinite where there is none or it is not allowed."""
    ledger = Ledger(10**6, 60.0)
    if is_installed():
        OmplToppra(seconds=2.0).run([task], ledger, np.random.default_rng(seed))
        return ledger.best.cost if ledger.best is not None and ledger.best.feasible else np.inf
    path = tree_path(task, seed)
    if path is None:
        return np.inf
    timed = from_vias(replace(task, objective="time", free="times"), path[1:-1], "trees", 2)
    Toppra().run([timed], ledger, np.random.default_rng(0))
    best = ledger.best
    if best is None or not best.feasible:
        return np.inf
    if task.objective == "time":
        return best.cost
    motion = best.splines
    stretched = replace(motion, durations=motion.durations * float(task.durations.sum() / motion.total[0]))
    carrier = task.with_initial(stretched, free="vias")
    found = carrier.evaluate(carrier.initial[None])
    return float(found.cost[0]) if found.feasible[0] else np.inf


def by(history: Sequence[tuple[int, float, float]], seconds: float) -> float:
    """The lowest cost that a search had entered by a time."""
    return min((row[2] for row in history if row[1] <= seconds), default=np.inf)


def tree_path(task: PlanningProblem, seed: int) -> np.ndarray | None:
    trees = Trees.of(task, np.random.default_rng(seed))
    found = trees.connect(task.start, task.goal, 20000, np.pi)
    return None if isinstance(found, str) else trees.prune(found)


def retimed(task: PlanningProblem, splines) -> float:  # type: ignore[no-untyped-def]
    """Duration of the same path timed by TOPP-RA, all limits of the full model checked."""
    ledger = Ledger(10**6, 60.0)
    Toppra().run([task.with_initial(splines, free="times")], ledger, np.random.default_rng(0))
    return ledger.best.cost if ledger.best is not None and ledger.best.feasible else np.inf


def measure(task: PlanningProblem, head: tuple[int, str, int, int], options: argparse.Namespace) -> Row:
    """One task's row."""
    result = solve(task, SolveOptions(evaluations=10**6, seconds=30.0, gap=False))
    bound = np.nan if result.bound is None else result.bound
    if not result.solved or result.splines is None:
        print(f"{head}: no plan ({result.reason})", flush=True)
        best, none = long_search(task, options.long, None, options.limit), np.inf
        cost, spent = peer(task, min(options.equal, result.cpu_seconds))
        return Row(*head, none, best, cost, none, bound, none, none, result.cpu_seconds, spent, 0.0)
    assert certify(task, result.splines).broken == []
    allowed = [row for row in result.history if np.isfinite(row[2])]
    near = next(row[1] for row in allowed if row[2] <= 1.01 * allowed[-1][2])
    known = task.with_initial(result.splines)
    best = min(result.cost, long_search(task, options.long, known, options.limit))
    gain = max(0.0, 1.0 - retimed(task, result.splines) / result.cost) if task.objective == "time" else 0.0
    equal = min(options.equal, result.cpu_seconds)
    cost, spent = peer(task, equal)
    spans = (allowed[0][1], near, result.cpu_seconds, spent)
    return Row(*head, result.cost, best, cost, by(allowed, equal), bound, *spans, gain)


def show(rows: list[Row]) -> None:
    heads = ["task", "ours", "best known", "above", "trees + TOPP-RA", "ours by then", "saved", "bound", "room"]
    heads += ["first [s]", "near [s]", "CPU [s]", "theirs [s]", "retimed"]
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for r in rows:
        print(line(r))
    found = [r for r in rows if np.isfinite(r.ours)]
    without = sum(np.isfinite(min(r.best, r.peer)) for r in rows if r not in found)
    print(f"{len(found)} of {len(rows)} tasks planned; of the others a longer search or the trees planned {without}")
    above = np.array([r.ours / r.best - 1 for r in found])
    print(f"above the best known {np.median(above):.2%} median, {above.max():.2%} worst")
    for objective in ("energy", "time"):
        held = [r for r in found if r.objective == objective and np.isfinite(r.peer)]
        if held:
            saved, least = [r.saved for r in held], min(held, key=lambda r: r.saved)
            seen = f"{np.median(saved):.1%} median, {least.saved:.1%} least (the bound leaves {least.room:.1%} there)"
            print(f"{objective}: less than trees and TOPP-RA after the same time by {seen}, {len(held)} tasks")
    for joints in sorted({r.joints for r in found}):
        own = [r for r in found if r.joints == joints]
        first, near = (np.array([getattr(r, key) for r in own]) for key in ("first", "near"))
        seen = f"first plan after {np.median(first):.2f} s median, {first.max():.2f} s worst"
        print(f"{joints} joints: {seen}; within 1 % of its end after {np.median(near):.2f} s, {near.max():.2f} s")
    gains = [r.gain for r in found if r.objective == "time"]
    if gains:
        print(f"retiming gains {np.median(gains):.2%} median, {max(gains):.2%} worst")


def line(r: Row) -> str:
    return (
        f"| {r.name} | {r.ours:.4g} | {r.best:.4g} | {r.ours / r.best - 1:+.2%} | {r.peer:.4g} | "
        f"{r.by_then:.4g} | {r.saved:.1%} | {r.bound:.4g} | {r.room:.1%} | {r.first:.2f} | {r.near:.2f} | "
        f"{r.spent:.2f} | {r.peer_spent:.2f} | {r.gain:.2%} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=2)
    parser.add_argument("--joints", default="3,6,7")
    parser.add_argument("--obstacles", default="0,1,12,100")
    parser.add_argument("--objectives", default="energy,time")
    parser.add_argument("--long", type=int, default=40)
    parser.add_argument("--limit", type=float, default=300.0)
    parser.add_argument("--equal", type=float, default=1e9)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--model", default=None)
    parser.add_argument("--rows", type=Path, default=None)
    options = parser.parse_args()
    rows = []
    warm = draw(arm_of(3), torque_of(arm_of(3), None), "time", 1, np.random.default_rng(0))
    solve(
        warm, SolveOptions(evaluations=300, seconds=60.0, gap=False)
    )  # compiled loops are compiled before anything is timed
    for joints in map(int, options.joints.split(",")):
        arm = arm_of(joints)
        model = torque_of(arm, options.model)
        for objective in options.objectives.split(","):
            for boxes in map(int, options.obstacles.split(",")):
                for i in range(options.first, options.first + options.tasks):
                    task = draw(arm, model, objective, boxes, np.random.default_rng([joints, boxes, i]))
                    rows.append(measure(task, (joints, objective, boxes, i), options))
                    print(line(rows[-1]), flush=True)
                    if options.rows is not None:
                        with options.rows.open("a") as stream:
                            stream.write(json.dumps(asdict(rows[-1])) + "\n")
    if options.rows is not None:
        rows = [Row(**json.loads(text)) for text in options.rows.read_text().splitlines()]
    if rows:
        show(rows)


if __name__ == "__main__":
    main()
