"""Every command that a page shows is run, one after the other as a reader would, in a folder with the reader's files.

What lasts long is cut short (`CUT`), nothing else is changed: the names of the pages are those of the folder.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import mujoco
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow.csv import write_csv

from ident.robot.names import data_path
from tests.examples.test_examples import ROOT, shown_commands

pytestmark = pytest.mark.slow

REAL = Path(os.environ.get("IDENT_REAL_DATA", ROOT.parent / "shared/real"))
# A stand-in for the reader's own program that moves the arm: command files in, recordings out.
MY_ROBOT = f"""#!{sys.executable}
import subprocess, sys
subprocess.run(["ident", "simulate", "--commands", sys.argv[1], "--out", sys.argv[2]], check=True)
"""
CUT = {
    "--worlds all --cases 480": "--worlds all --cases 1 --seed 1",
    "--semi-real DIR": f"--semi-real {REAL} --cases 1 --seed 1 --out real",
    "--arms 30 --seed 865922131 --out closed": "--arms 1 --rounds 2 --no-compare --out closed_30",
    "--minutes 1 --evaluations 80": "--minutes 0.3 --evaluations 8",
    "--arms 3": "--arms 1 --rounds 2 --no-compare",
    "--record": "--rounds 2 --no-compare --record",
    "--seeds 5": "--seeds 1",
    "SESSION": "my_session",
    "DIR": "mended",
    "ident new my_session": "ident new foreign",
    "ident servo my_session": "ident servo goals",
}
LAG = 10
# Commands that go on until they are stopped, and what they say once they are at work.
ENDLESS = {
    "ident watch arms --robot my_arm.urdf --store watched": "look at watched",
    "ident open my_session my_arm.urdf": "http://127.0.0.1",
}
# What a page does in Python or leaves to the reader: no command of ours makes it.
NEEDED = {
    "ident simulate --plan plan.json --out moved": "plan solve scene.toml --model model --seconds 3 --json plan.json"
}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reader's folder: an arm, sessions, a scene, a program that moves the arm."""
    desk = tmp_path_factory.mktemp("desk")
    shutil.copy(data_path("urdf/tm5_900.urdf"), desk / "my_arm.urdf")
    spec = mujoco.MjSpec.from_file(str(desk / "my_arm.urdf"))
    spec.compile()
    (desk / "my_arm.xml").write_text(spec.to_xml())
    recorded = {
        "my_session": "payload_516g",
        "other_session": "E2",
        "before": "E1",
        "after": "E2",
        "arms/one/2026-01-05": "E1",
        **dict(zip(("day_1", "day_2", "day_3"), ("E1", "E2", "payload_516g"), strict=True)),
    }
    for name, session in recorded.items():
        shutil.copytree(data_path(f"logs/tm5_900/{session}"), desk / name)
        for path in (desk / name).iterdir():  # written long ago, as far as `ident watch` can see
            os.utime(path, (1.7e9, 1.7e9))
    write_table(desk / "my_session", desk / "foreign", {"/position": "", "/effort": "_torque", "joint_": "q"})
    goals = {"/position": "/position_command"}
    write_table(desk / "my_session", desk / "goals", goals, keep="/position")
    (desk / "logs").symlink_to(data_path("logs"))
    shutil.copy(ROOT / "tests/plan/data/table3.toml", desk / "scene.toml")
    (desk / "my_robot.py").write_text(MY_ROBOT)
    (desk / "my_robot.py").chmod(0o755)
    return desk


def write_table(session: Path, folder: Path, names: dict[str, str], keep: str = "") -> None:
    """One run of a session as a table of another's making, its columns renamed; some kept, too, `LAG` rows late."""
    folder.mkdir()
    table = pq.read_table(min(session.glob("*.parquet")))
    table = table.select([one for one in table.column_names if one == "time" or one.endswith(("/position", "/effort"))])
    renamed = []
    for name in table.column_names:
        for old, new in names.items():
            name = name.replace(old, new)
        renamed.append("t" if name == "time" and not keep else name)
    columns = dict(zip(renamed, table.columns, strict=True))
    late = {name: table[name][:-LAG] for name in table.column_names if keep and name.endswith(keep)}
    columns = {name: one[LAG:] if late else one for name, one in columns.items()} | late
    write_csv(pa.table(columns), folder / "run.csv")


def surroundings(desk: Path) -> dict[str, str]:
    """Our commands and the reader's program are found, and the code is the one that is tested."""
    path = os.pathsep.join([str(Path(sys.executable).parent), str(desk), os.environ["PATH"]])
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}


def run(command: str, desk: Path) -> None:
    ended = subprocess.run(command, shell=True, cwd=desk, env=surroundings(desk), capture_output=True, text=True)
    assert ended.returncode == 0, f"{command}\n{ended.stderr[-2000:]}"


@pytest.mark.parametrize("command", [one for one in shown_commands() if " ".join(one.split()) not in ENDLESS])
def test_a_shown_command_runs(command: str, desk: Path) -> None:
    command = re.sub(" +", " ", command)
    if "--semi-real" in command and not REAL.is_dir():
        pytest.skip(f"no recordings of real arms at {REAL} (set IDENT_REAL_DATA)")
    for words, shorter in CUT.items():
        command = command.replace(words, shorter)
    if command in NEEDED:
        run(NEEDED[command], desk)
    run(command, desk)


@pytest.mark.parametrize("command", ENDLESS)
def test_the_command_that_goes_on_is_stopped(desk: Path, command: str) -> None:
    """Law: `ident watch` and `ident open` tell where to look, and go on until they are stopped."""
    assert command in [" ".join(shown.split()) for shown in shown_commands()]
    words = [*command.split(), *(["--no-browser"] if " open " in command else [])]
    unbuffered = {**surroundings(desk), "PYTHONUNBUFFERED": "1"}
    watching = subprocess.Popen(words, cwd=desk, env=unbuffered, stdout=subprocess.PIPE, text=True)
    assert watching.stdout is not None
    try:
        assert any(ENDLESS[command] in line for line in watching.stdout)
        assert watching.poll() is None
    finally:
        watching.send_signal(signal.SIGINT)
    assert watching.wait(60) == 128 + signal.SIGINT


def test_tables_are_read_by_others(desk: Path) -> None:
    """After `ident watch`."""
    duckdb = pytest.importorskip("duckdb")
    assert duckdb.sql(f"from '{desk}/watched/figures/*/*.parquet'").fetchall()
