"""Every result file of every command names robot, joints and sessions; nothing is said to be written that was not.

The commands come from the command line itself: a new one that writes results has to be added to `LINES`.
"""

import importlib
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from ident.robot.names import data_path
from ident.schemas.publish import list_kinds, make_schema
from tests.schemas import check_file

HERE = Path(__file__).parent
E1 = Path(data_path("logs/tm5_900")) / "E1"
ROBOT = ("--robot", "tm5-900")
# Parameters by which a command is given recordings, and by which it is told where to write.
READS = {"sessions", "session", "before", "on"}
WRITES = {"out", "html", "rrd", "picture", "mend", "json_file", "store"}
# Their results take minutes: the tests named here hold them to their schema, which asks for the same keys.
ELSEWHERE = {
    "ident demo": None,
    "ident diagnose": "ident/diagnosis/contract.py",
    "ident blind": "ident/benchmark/test_blind_worlds.py",
    "ident board": "ident/benchmark/test_board.py",
    "ident close": "ident/closed_loop/test_closing.py",
    "ident compare": "ident/cli/test_cli.py",
}
# Results of many arms or robots name them for each.
EACH = {"ident.blind": ("outcomes", "BlindOutcomeRecord"), "ident.close": ("arms", "ClosedArmRecord")}
EACH |= {"ident.watch": ("arms", "WatchedArmRecord"), "ident.telemetry": ("sessions", "InspectedRecord")}

EACH |= {f"ident.board_{deed}": ("arms", "BoardArmRecord") for deed in ("made", "answered", "sealed", "score")}

# Files of a public board: what they hold, they hold by the session's name, and board.json says its arm and joints.
OF_A_BOARD = {"ident.board": ("sessions", "BoardSessionRecord"), "ident.board_answer": ("session", None)}
OF_A_BOARD |= {"ident.board_truths": ("sealed", None), "ident.board_kept": ("answers", "BoardTruthRecord")}
OF_A_BOARD |= {"ident.board_effects": ("effects", "BoardEffectRecord")}
KINDS = {f"{package}.{name}" for package in ("ident", "plan") for name in list_kinds(package)}


@dataclass(frozen=True)
class Place:
    """Files to work on, and a folder to work in."""

    corpus: Path
    out: Path


def _servo_table(folder: Path) -> str:
    time = np.arange(0.0, 20.0, 0.01)
    goal = 0.5 * np.sin(1.3 * time) + 0.3 * np.sin(3.1 * time)
    rows = np.column_stack([time, np.interp(time - 0.04, time, goal), goal])
    header = "time,shoulder/position,shoulder/position_command"
    np.savetxt(folder / "servo.csv", rows, delimiter=",", header=header, comments="")
    return str(folder / "servo.csv")


def _cycle(folder: Path) -> str:
    """A scene of two motions with a stop between them."""
    scene = (HERE / "plan/data/table3.toml").read_text(encoding="utf-8").replace("duration_s = 0.65\n", "")
    stop = "[[leg]]\ndeg = [65, 15, -105]\ndwell_s = 0.2\n"
    (folder / "cycle.toml").write_text(f"{scene}{stop}", encoding="utf-8")
    return str(folder / "cycle.toml")


def _cell(folder: Path) -> str:
    shutil.copytree(E1, folder / "cell" / "monday")
    return str(folder / "cell")


def lines(at: Place) -> dict[str, tuple[str, ...]]:
    """A quick line of each command, without places to write to but those that it must be given."""
    run, model, scene = (
        str(E1 / "01_trajectory_1.parquet"),
        str(at.corpus / "model"),
        str(HERE / "plan/data/table3.toml"),
    )
    out, store = ("--out", str(at.out / "out")), ("--store", str(at.out / "store"))
    shutil.copy(at.corpus / "run.csv", at.out / "run.csv")
    return {
        "ident inspect": (run, *ROBOT),
        "ident fit": (str(E1), *ROBOT, "--net", "none", *out),
        "ident evaluate": (run, "--model", model),
        "ident patch": (str(at.corpus / "diagnosis.json"), *ROBOT, *out),
        "ident view": (run, *ROBOT),
        "ident export": (model, *out, "--format", "toml"),
        "ident ranges": (str(E1), *ROBOT),
        "ident verify": (model, str(E1), "--limits", str(at.corpus / "limits.toml")),
        "ident simulate": (*out, "--runs", "1", "--duration", "2", "--rate", "50"),
        "ident new": (str(at.out / "run.csv"), *ROBOT),
        "ident servo": (_servo_table(at.out),),
        "ident watch": (_cell(at.out), *ROBOT, *store, "--once", "--settle", "0", "--no-diagnose"),
        "plan solve": (scene, "--method", "toppra", "--objective", "time", "--no-gap", "--beyond"),
        "plan cycle": (_cycle(at.out), "--objective", "time", "--evaluations", "300"),
        "plan compare": (scene, "--methods", "toppra", "--objective", "time", "--seeds", "1", "--beyond"),
        "plan excite": ("--separate", "torque_gain_error,all_masses", "--minutes", "0.3", "--evaluations", "8"),
    }


@cache
def commands() -> Mapping[str, Any]:
    """Every command that writes results, as the command line knows it."""
    found = {}
    for package in ("ident", "plan"):
        group: Any = typer.main.get_command(importlib.import_module(f"{package}.cli.app").app)
        found |= {f"{package} {name}": one for name, one in group.commands.items() if _names(one) & WRITES}
    return found


def _names(command: Any) -> set[str]:
    return {parameter.name for parameter in command.params}


# A page of figures of the paper's own arm: no result file, and always written.
PAGES = {"plan paper"}


@pytest.fixture
def at(corpus: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ident.show.timeline.writing.show_timeline", lambda *given: None)  # no window opens in a test
    monkeypatch.setattr("ident.show.timeline.writing.require_screen", lambda: None)
    return Place(corpus, tmp_path)


def run(name: str, *arguments: str) -> Result:
    package, command = name.split()
    done = CliRunner().invoke(importlib.import_module(f"{package}.cli.app").app, [command, *arguments])
    assert done.exit_code in (0, 3), (done.output, done.exception)
    return done


def is_named(record: Mapping[str, Any]) -> bool:
    """Whether a record, or the table of its robot, names robot and joints."""
    robot, joints = record.get("robot"), record.get("joints")
    if isinstance(robot, Mapping):
        robot, joints = robot.get("name"), robot.get("joints")
    return bool(robot) and bool(joints)


def test_every_command_is_looked_at(at: Place) -> None:
    """Law: a command that writes results stands in one of the lists."""
    assert set(lines(at)) | set(ELSEWHERE) | PAGES == set(commands())
    for name, place in ELSEWHERE.items():
        if place is not None:
            assert "check_" in (HERE / place).read_text(), name


@pytest.mark.parametrize("name", sorted(KINDS - set(OF_A_BOARD)))
def test_every_schema_asks_for_robot_joints_and_sessions(name: str) -> None:
    """Law: for the record itself, or each of its arms; sessions stand in its provenance."""
    schema = make_schema(name, name.partition(".")[0])
    holder = schema
    if name in EACH:
        key, record = EACH[name]
        assert schema["properties"][key]["items"] == {"$ref": f"#/$defs/{record}"}
        holder = schema["$defs"][record]
    assert "robot" in holder["required"]
    if "$ref" in holder["properties"]["robot"]:
        holder = schema["$defs"][holder["properties"]["robot"]["$ref"].rpartition("/")[2]]
    assert "joints" in holder["required"]
    assert "sessions" in schema["$defs"]["Provenance"]["required"]


def test_a_board_says_arm_and_joints_of_each_session() -> None:
    """Law: its other files need not, for they name sessions, or none as the list of effects."""
    assert set(OF_A_BOARD) <= KINDS
    for name, (key, record) in OF_A_BOARD.items():
        schema = make_schema(name, "ident")
        assert key in schema["required"]
        if record is not None:
            assert schema["properties"][key]["additionalProperties"] == {"$ref": f"#/$defs/{record}"}
    session = make_schema("ident.board", "ident")["$defs"]["BoardSessionRecord"]
    assert {"arm", "joints"} <= set(session["required"])


@pytest.mark.parametrize("name", sorted(set(commands()) - set(ELSEWHERE) - PAGES))
def test_results_name_robot_joints_and_sessions(name: str, at: Place) -> None:
    """Law: whatever a command was given; and the file holds to its published schema."""
    file = at.out / "result.json"
    run(name, *lines(at)[name], "--json", str(file))
    record = check_file(file)
    each = EACH.get(record["schema"].split("/")[0])
    assert all(map(is_named, record[each[0]] if each else [record])), record
    given = {parameter.name for parameter in commands()[name].params if parameter.required}
    if given & READS:
        assert [Path(one["path"]).name for one in record["provenance"]["sessions"]]
        assert all(len(one["sha256"]) == 64 for one in record["provenance"]["sessions"])
    for other in at.out.rglob("*.json"):
        inside = other.read_text(encoding="utf-8")
        if other.name != ".armgap.json" and '"schema"' in inside:
            check_file(other)


@pytest.mark.parametrize("name", sorted(set(commands()) - set(ELSEWHERE) - PAGES))
def test_nothing_is_said_to_be_written_that_was_not(name: str, at: Place) -> None:
    """Law: what is said to be written is there; a command that was given no place to write to tells of none."""
    arguments = lines(at)[name]
    before = set(at.out.rglob("*"))
    seen = re.sub(r"\s+", " ", run(name, *arguments).output)
    places = re.findall(r"(?:written to|wrote) (\S+?)[:;,]?(?= |$)", seen)
    assert [place for place in places if not Path(place).exists()] == []
    made = set(at.out.rglob("*")) - before
    if not any(option in arguments for option in ("--out", "--store")) and name != "ident new":
        assert (places, made) == ([], set())
        assert not re.search(r"\b(?:written|wrote|saved)\b", seen.replace("nothing written", ""))
    else:
        assert made
