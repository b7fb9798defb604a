"""What a plan compiles, once on a computer: each large loop for one kind of arguments alone."""

import subprocess
import sys

PROGRAM = """
import numpy as np
from ident.robot.arm import ArmModel
from plan.command_options import SolveOptions
from plan.dynamics import power, rigid
from plan.geometry import compiled, separation, simplex, sweep
from plan.geometry.scene import Scene
from plan.planners import transcription
from plan.solving.solve import solve
from plan import spline
from tests.plan.worlds import MONITOR, problem

Scene.build(ArmModel.load("ur5"))
compiled.thin_corners(np.random.default_rng(0).normal(size=(200, 3)))
result = solve(problem(MONITOR), SolveOptions(evaluations=200, gap=False))
assert result.splines is not None
loops = (
    sweep.sweep, sweep.gaps_of_states, sweep._world_gap, separation.shape_gap, separation.body_gap,
    separation.box_gap, simplex.simplex_gap, simplex._farthest, rigid.rnea, rigid.place_frames,
    rigid.slopes_of_points, power._rigid_partials, power._torque_states,
    spline._states, spline._slopes, spline._extremes, transcription._bases_at,
)
for loop in loops:
    print(loop.py_func.__name__, len(loop.signatures))
"""  # fmt: skip


def test_large_loops_are_compiled_for_one_kind_of_arguments() -> None:
    """Law: an array that may be written is another kind than one that may not, and costs a second more."""
    run = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr[-2000:]
    counts = dict(line.split() for line in run.stdout.splitlines())
    assert "sweep" in counts
    assert {name: count for name, count in counts.items() if int(count) > 1} == {}
