"""The peer: without OMPL its lack is told; with it, its paths are timed and certified like any plan."""

import importlib.util

import numpy as np
import pytest

from ident.errors import InputError
from plan.initial.rrt import TreeOptions, connect, prune
from plan.planners import make_planner
from plan.planners.ompl_toppra import OmplToppra
from plan.problem.problem import PlanningProblem
from plan.problem.result import certify
from plan.solving.compare import able
from tests.plan.worlds import MONITOR, ledger, problem


def by_our_trees(planner: OmplToppra, task: PlanningProblem, rng: np.random.Generator) -> np.ndarray:
    """A path as OMPL would give it, where OMPL may be missing."""
    options = TreeOptions(margins=task.limits.clearance + 0.005)
    found = connect(task.scene, task.start, task.goal, task.limits.lower, task.limits.upper, options, rng)
    return prune(task.scene, found.points, options)


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_a_path_is_timed_and_certified(objective: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Time is found under the full model; for energy the motion is drawn out to the duration that is asked for."""
    if importlib.util.find_spec("ompl") is None:
        monkeypatch.setattr(OmplToppra, "_path", by_our_trees)
    task = problem(MONITOR, duration=2.0, objective=objective, free="vias" if objective == "energy" else "both")
    best = OmplToppra().run([task], ledger(), np.random.default_rng(0)).best
    assert best is not None
    assert certify(best.problem, best.splines).broken == []
    total = float(best.splines.total[0])
    assert (total == pytest.approx(2.0)) if objective == "energy" else (total < 1.5)


def test_without_ompl_its_lack_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Naming it where it is not installed names the remedy; nobody gets it unasked."""
    assert "ompl" not in able(problem())
    monkeypatch.setattr("plan.planners.ompl_toppra.is_installed", lambda: False)
    with pytest.raises(InputError, match="pip install ompl"):
        make_planner("ompl", "energy")
