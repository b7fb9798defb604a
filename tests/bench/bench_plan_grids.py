"""Time plans on grids that are finer where limits switch, beside the same search on even grids.

    python tests/bench/bench_plan_grids.py [TASKS] [--joints 3,6] [--boxes 0,12] [--seconds S]
                                           [--limits torque,acceleration] [--first SEED] [--rows FILE]

Tasks as in bench_plan_optimum.py (torque and speed bind) and bench_plan_first.py (acceleration and
speed bind), least time. Each is solved twice in turn from the same seed, once with every section
parted in two (`even`), once as the planner does it; S processor seconds at most (30), so that most
searches end by themselves. Told are durations and processor seconds of the planner's as a share of
the even grids', how many are solved, and whose certificate breaks anything. FILE gets a line for
each task, and the summary speaks of all its lines.
"""

import argparse
import json
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np

from ident.arrays import Int
from plan.command_options import SolveOptions
from plan.planners import refinement
from plan.planners.descent import Course
from plan.problem.certificate import certify
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.solve import solve
from tests.bench.bench_plan_first import limit_acceleration
from tests.bench.bench_plan_optimum import arm_of, draw, torque_of

# Sections of a finer grid for each of the one before, where all go in two.
EVENLY = 2.0


@dataclass(frozen=True)
class Row:
    """A task's figures; a duration is infinite where there is no plan."""

    joints: int
    limit: str
    boxes: int
    number: int
    even: float
    parted: float
    even_seconds: float
    parted_seconds: float
    broken: tuple[str, ...]

    @property
    def kind(self) -> str:
        """The table's row that the task belongs to."""
        return f"{self.joints} joints, {self.limit}, {self.boxes} boxes"

    @property
    def solved_by_both(self) -> bool:
        """Whether durations can be compared."""
        return bool(np.isfinite(self.even) and np.isfinite(self.parted))


def part_evenly(course: Course) -> Int:
    """Every section in two."""
    return np.full(course.local.grid.sections, 2)


def draw_task(joints: int, limit: str, boxes: int, number: int) -> PlanningProblem:
    """A time task in which torque or acceleration binds."""
    arm = arm_of(joints)
    rng = np.random.default_rng([2041, joints, boxes, number])
    task = draw(arm, torque_of(arm, None), "time", boxes, rng)
    return limit_acceleration(task) if limit == "acceleration" else task


def find_broken(task: PlanningProblem, result: PlanResult) -> list[str]:
    """What the certificate of a plan finds broken."""
    if not result.solved or result.splines is None:
        return []
    return [str(fault) for fault in certify(task, result.splines).broken]


def compare(task: PlanningProblem, head: tuple[int, str, int, int], seconds: float) -> Row:
    """A task's row; which of the two goes first alternates."""
    options = SolveOptions(evaluations=10**6, seconds=seconds, gap=False)
    plans: dict[bool, PlanResult] = {}
    for evenly in (True, False) if head[-1] % 2 else (False, True):
        with ExitStack() as stack:
            if evenly:
                stack.enter_context(patch.object(refinement, "FINER", EVENLY))
                stack.enter_context(patch.object(refinement, "choose_parts", part_evenly))
            plans[evenly] = solve(task, options)
    even, parted = plans[True], plans[False]
    broken = find_broken(task, parted)
    costs = [plan.cost if plan.solved else np.inf for plan in (even, parted)]
    return Row(*head, *costs, even.cpu_seconds, parted.cpu_seconds, tuple(broken))


def summarise(name: str, rows: list[Row]) -> None:
    """A kind's line."""
    both = [row for row in rows if row.solved_by_both]
    even = sum(np.isfinite(row.even) for row in rows)
    parted = sum(np.isfinite(row.parted) for row in rows)
    broken = sum(bool(row.broken) for row in rows)
    line = f"{name}: {len(rows)} tasks, solved {even} evenly, {parted} parted, {broken} broken"
    if both:
        longer = np.array([row.parted / row.even - 1.0 for row in both])
        line += f"; duration {np.mean(longer):+.2%} mean, {np.median(longer):+.2%} median"
        line += f", {longer.min():+.2%} to {longer.max():+.2%}"
    spent = sum(row.parted_seconds for row in rows) / sum(row.even_seconds for row in rows)
    each = np.median([row.parted_seconds / row.even_seconds for row in rows])
    print(f"{line}; processor time {spent:.2f} times together, {each:.2f} median", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=5)
    parser.add_argument("--joints", default="3,6")
    parser.add_argument("--boxes", default="0,12")
    parser.add_argument("--limits", default="torque,acceleration")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rows", type=Path, default=None)
    options = parser.parse_args()
    warm = draw_task(3, "torque", 1, 10**6)
    solve(warm, SolveOptions(evaluations=300, seconds=60.0, gap=False))  # loops are compiled before
    rows: list[Row] = []
    for number in range(options.first, options.first + options.tasks):
        for joints in map(int, options.joints.split(",")):
            for limit in options.limits.split(","):
                for boxes in map(int, options.boxes.split(",")):
                    task = draw_task(joints, limit, boxes, number)
                    row = compare(task, (joints, limit, boxes, number), options.seconds)
                    rows.append(row)
                    print(row, flush=True)
                    if options.rows is not None:
                        with options.rows.open("a") as stream:
                            stream.write(json.dumps(asdict(row)) + "\n")
    if options.rows is not None:
        rows = [Row(**json.loads(text)) for text in options.rows.read_text().splitlines()]
    for kind in dict.fromkeys(row.kind for row in rows):
        summarise(kind, [row for row in rows if row.kind == kind])
    summarise("all", rows)


if __name__ == "__main__":
    main()
