"""Where searches begin: trees look near first, and a way for which there is no time is taken only where no other is."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plan.api.planning import open_task
from plan.initial import starts
from plan.initial.starts import any_way
from plan.problem.problem import PlanningProblem

DATA = Path(__file__).parents[1] / "data"


def blocked() -> PlanningProblem:
    return open_task(DATA / "obstacle.toml").problem


def far_way(task: PlanningProblem, seconds: float) -> np.ndarray:
    """A via point from which the first joint needs so many seconds there and back, at its top speed."""
    via = 0.5 * (task.start + task.goal)
    via[0] = task.start[0] + 0.5 * (seconds * task.limits.speed[0] + task.goal[0] - task.start[0])
    return via[None]


class Drawn:
    """Trees whose ways are known."""

    def __init__(self, *ways: np.ndarray) -> None:
        self.ways, self.asked = iter(ways), list[tuple[int, float]]()

    def vias(self, _: object, __: object, nodes: int, reach: float) -> np.ndarray | None:
        self.asked.append((nodes, reach))
        return next(self.ways, None)


@pytest.mark.parametrize(("objective", "taken"), [("energy", 1), ("time", 0)])
def test_a_way_must_fit_into_the_duration(objective: str, taken: int) -> None:
    """At a fixed duration a longer way is passed over; where time is what is sought, the first way is as good."""
    task = replace(blocked(), objective=objective, free="vias" if objective == "energy" else "both")
    ways = [far_way(task, factor * float(task.durations.sum())) for factor in (1.5, 0.9, 0.5)]
    assert any_way(task, Drawn(*ways)) is ways[taken]  # type: ignore[arg-type]


def test_the_quickest_of_late_ways_and_patience_only_without_any() -> None:
    """All ways take too long: the quickest one, and no more trees; no way at all: the patient trees are asked."""
    task = blocked()
    late = [far_way(task, factor * float(task.durations.sum())) for factor in (3.0, 1.5, 2.0, 4.0)]
    some, none = Drawn(*late), Drawn()
    assert any_way(task, some) is late[1]  # type: ignore[arg-type]
    assert some.asked == list(starts.QUICK)
    assert any_way(task, none) is None  # type: ignore[arg-type]
    assert none.asked == [*starts.QUICK, starts.PATIENT]


def test_a_plan_without_a_net_loads_no_heavy_library() -> None:
    """The rigid arm's plan by the default method: neither torch nor cma, which take seconds."""
    code = (
        "import sys; from plan import solve; "
        f"result = solve({str(DATA / 'table3.toml')!r}, evaluations=30, gap=False); assert result.splines is not None; "
        "print([name for name in ('torch', 'cma', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")
