"""The `plan` command, from scene file to exit status."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader
from typer.testing import CliRunner

from ident.errors import InputError
from plan.api.planning import OpenedTask, open_task
from plan.cli.app import app, main
from plan.command_options import CompareOptions, SolveOptions, TaskOptions
from plan.problem.task_file import load_task
from tests.schemas import check_file

DATA = Path(__file__).parents[1] / "data"
TABLE3 = (DATA / "table3.toml").read_text()


def scene(folder: Path, text: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def opened(path: Path, model: Path | None = None, **changes: Any) -> OpenedTask:
    return open_task(path, model, TaskOptions(**{"beyond": True, **changes}))


def test_solves_and_writes_everything(tmp_path: Path) -> None:
    """One command: the plan as JSON, a picture and a Rerun recording."""
    files = [tmp_path / name for name in ("plan.json", "plan.png", "plan.rrd")]
    arguments = ["solve", str(DATA / "table3.toml"), "--json", str(files[0]), "--picture", str(files[1])]
    outcome = CliRunner().invoke(app, [*arguments, "--beyond", "--rrd", str(files[2])])
    assert outcome.exit_code == 0, outcome.output
    assert "solved by sqp" in outcome.output
    assert "proven between samples too" in outcome.output
    record = json.loads(files[0].read_text())
    assert record["status"] == "solved"
    assert files[1].stat().st_size > 10_000
    assert files[2].read_bytes()[:4] == b"RRF2"


def test_compares_and_draws(tmp_path: Path) -> None:
    """A table of methods, a JSON record, pictures of costs and of the best motion."""
    arguments = ["compare", str(DATA / "table3.toml"), "--methods", "cma,reference", "--seeds", "2"]
    arguments += ["--evaluations", "300", "--beyond"]
    outcome = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "c.json"), "--out", str(tmp_path / "o")])
    assert outcome.exit_code == 0, outcome.output
    record = check_file(tmp_path / "c.json")
    assert [row["method"] for row in record["summary"]] == ["cma", "reference"]
    assert {path.name for path in (tmp_path / "o").iterdir()} == {"comparison.png", "best.png", "best.json", "best.rrd"}


@pytest.mark.parametrize("name", ["motion.csv", "motion.yaml", "motion.parquet"])
def test_a_motion_file_is_never_older_than_its_task(tmp_path: Path, name: str) -> None:
    """Written over our own file, never over the user's; a task without a plan exits 3 and leaves no old motion."""
    path, out = scene(tmp_path, TABLE3), tmp_path / name
    arguments = ["solve", str(path), "--evaluations", "30", "--no-gap", "--beyond", "--out", str(out)]
    for _ in range(2):
        assert CliRunner().invoke(app, arguments).exit_code == 0
    motion = out.read_bytes()
    path.write_text(TABLE3.replace("duration_s = 0.65", "duration_s = 0.05"))
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code == 3
    assert "0.05 s is too short" in outcome.output
    assert {one.name for one in tmp_path.iterdir()} == {"scene.toml"}
    out.write_bytes(motion + b"#" if name != "motion.yaml" else b"mine")
    outcome = CliRunner().invoke(app, arguments)
    assert isinstance(outcome.exception, InputError) == (name != "motion.parquet")


def test_timeline_holds_arm_and_obstacle(tmp_path: Path) -> None:
    """Read back, the recording has the moving arm, the obstacle, torques and clearance."""
    task = opened(DATA / "obstacle.toml")
    result = task.solve(SolveOptions(method="cma", evaluations=3000, gap=False))
    from plan.show.timeline import save_timeline

    save_timeline(task.problem, result, tmp_path / "plan.rrd")
    paths = {chunk.entity_path for chunk in RrdReader(tmp_path / "plan.rrd").stream().to_chunks()}
    assert "/world/obstacles/monitor" in paths
    assert any(path.startswith("/world/arm/joint_3") for path in paths)
    assert "/torque_Nm/joint_2" in paths
    assert "/clearance_m" in paths


def test_bad_options() -> None:
    """Unknown objective, metric, variables and method name what there is."""
    path = DATA / "table3.toml"
    for changes, words in (
        ({"objective": "speed"}, "use one of: energy, time"),
        ({"metric": "heat"}, "use one of: signed"),
        ({"variables": "all"}, "use one of: vias, times, both"),
        ({"objective": "time", "variables": "vias"}, "use times or both"),
    ):
        with pytest.raises(InputError, match=words):
            opened(path, **changes)
    with pytest.raises(InputError, match="use one of: sqp"):
        opened(path).solve(SolveOptions(method="magic"))
    with pytest.raises(InputError, match="use some of: sqp"):  # before it spends any time
        opened(path).compare(CompareOptions(methods="cma,magic"))


def test_a_model_is_planned_with_where_it_is_this_robots(tmp_path: Path) -> None:
    """Its losses raise the energy; a model fitted for another robot, and a folder that holds none, are refused."""
    from ident.model.hybrid import HybridModel
    from ident.model.loss import LossParameters
    from ident.robot.arm import ArmModel

    for name in ("ur10", "tm5-900"):
        arm = ArmModel.load(name)
        loss = LossParameters(*(np.full(arm.n, value) for value in (0.5, 5.0, 5.0, 0.0, 0.01)))
        HybridModel(arm, arm, arm, loss).save(tmp_path / name)
    with pytest.raises(InputError, match="fit a model for this robot"):
        opened(DATA / "table3.toml", model=tmp_path / "ur10")
    with pytest.raises(InputError, match="not a model folder"):
        opened(DATA / "table3.toml", model=tmp_path)
    with_loss, without = (
        opened(DATA / "table3.toml", model=folder).solve(SolveOptions(method="reference", gap=False))
        for folder in (tmp_path / "tm5-900", None)
    )
    assert with_loss.cost > without.cost + 5.0


def test_taught_via_points(tmp_path: Path) -> None:
    """Those of a scene are read with their stamps, or refused with the place of the fault."""
    head = 'robot = "tm5-900"\n[task]\nstart_deg = [50, 0, -120]\ngoal_deg = [80, 30, -90]\nduration_s = 3\n'
    text = "via_points_deg = [[50, 10, -100], [70, 20, -95]]\ntimes_s = [1, 2]\n"
    task = load_task(scene(tmp_path, head + text))
    assert task.taught is not None
    assert (task.taught.shape, task.taught_times.shape) == ((2, 3), (2,))
    for text, words in (
        ("via_points_deg = [[1, 2]]\n", "has 2 numbers, not 3"),
        ("via_points_deg = [[1, 2, 3]]\ntimes_s = [0]\n", "not above zero"),
        ("via_points_deg = [[1, 2, 3], [2, 3, 4]]\ntimes_s = [2, 1]\n", "do not increase"),
    ):
        with pytest.raises(InputError, match=words):
            load_task(scene(tmp_path, head + text))


CRATE = '[[obstacle]]\nname = "crate"\nxyz_m = [1, 0, 0]\nsize_m = '


@pytest.mark.parametrize(
    ("old", "new", "options", "words"),
    [
        ("[50, 0, -120]", "[50, 0, -300]", (), "stay within"),
        ("[80, 30, -90]", "[80, 300, -90]", (), "task.goal_deg"),
        ("[50, 0, -120]", "[50, 100, 150]", (), "move that position or the obstacle"),
        ("[80, 30, -90]", "[80, 100, 150]", (), "move that position or the obstacle"),
        ("via_points = 2", f"via_points = 2\n{CRATE}[0, 0.1, 0.1]", (), "give lengths"),
        ("via_points = 2", "via_points = 2", ("--method", "magic"), "use one of: sqp"),
        ("via_points = 2", "via_points = 2", ("--method", "toppra"), "use --objective time"),
    ],
)
def test_solve_ends_with_status_two(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    options: tuple[str, ...],
    words: str,
) -> None:
    """Ends out of limits or in collision, boxes of zero size, unknown methods: status 2 and the remedy in one line."""
    path = scene(tmp_path, TABLE3.replace(old, new))
    monkeypatch.setattr(sys, "argv", ["plan", "solve", str(path), "--json", str(tmp_path / "plan.json"), *options])
    with pytest.raises(SystemExit) as stop:
        main()
    said = capsys.readouterr().err
    assert stop.value.code == 2
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "plan.json").exists()


def test_usage_errors(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """An option that does not exist is the user's mistake too."""
    monkeypatch.setattr(sys, "argv", ["plan", "solve", "x.toml", "--nothing"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "plan solve --help" in capsys.readouterr().err
