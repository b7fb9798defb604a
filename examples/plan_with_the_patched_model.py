"""Plans on a patched arm: the URDF that `ident patch` wrote, with friction fitted to recordings, round an obstacle.

python examples/plan_with_the_patched_model.py patch/robot.urdf out
"""

import sys
from pathlib import Path

from ident import FitOptions, fit_hybrid, open_sessions
from ident.robot.names import data_path
from plan import load_task, solve

SCENE = Path(__file__).parents[1] / "tests" / "plan" / "data" / "obstacle.toml"


def main(urdf: Path, out: Path, seconds: float = 20.0) -> None:
    recorded = open_sessions(data_path("logs/tm5_900/T1"), urdf)
    model = fit_hybrid(recorded, options=FitOptions(inertia="nominal", net="none")).model
    model.save(out / "model")
    out.joinpath("scene.toml").write_text(SCENE.read_text().replace('"tm5-900"', f'"{urdf}"'))
    task = load_task(out / "scene.toml")
    plan = solve(task, model, seconds=seconds, gap=False)
    print(plan.summary())
    plan.save(out / "plan.json")
    plan.plot().savefig(out / "plan.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
