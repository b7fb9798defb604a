"""The recipe of a further file format, followed to the letter: its files are sessions of every command."""

import json
import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
HOW_TO = ROOT / "docs" / "how-to.md"
READER = '"""JSON lines'
ENDINGS = "SUFFIXES = ("
CASE = 'if suffix == ".ndjson"'
LAST_LINE = '    raise RecordingError(\n        path, f"unknown kind of file'
SHIPPED_ENDINGS = 'SUFFIXES = (".parquet", *BAGS, ".npz", *TEXTS)'
# What a process does that has the reader in its package; it prints what became of each file.
COMMANDS = """
import json
from pathlib import Path
import numpy as np
from ident.errors import InputError
from ident.infer.guess import read_foreign
from ident.recordings.load import load_session

JOINTS = ("joint_1", "joint_2")
time = 0.01 * np.arange(400)
rows = []
for t in time:
    row = {"time": t, "mode": "teach"}
    for k, joint in enumerate(JOINTS):
        row |= {f"{joint}/position": np.sin(t + k), f"{joint}/effort": np.cos(t + k)}
    rows.append(json.dumps(row))
good = "\\n".join(rows) + "\\n"
folder = Path("session")
folder.mkdir()
(folder / "a.ndjson").write_text(good)
run = load_session(folder).runs[0]

def outcome(path, read):
    try:
        read(path)
    except InputError as error:
        return "told" if len(str(error).splitlines()) == 1 else str(error)
    except Exception as error:
        return repr(error)
    return "read"

spoilt = {
    "empty": b"",
    "blank": b"\\n\\n",
    "no JSON": b"time, position\\n1, 2\\n",
    "a list": b"[1, 2]\\n[3, 4]\\n",
    "a number": b"5\\n",
    "deep": b'{"time": ' + b"[" * 5000 + b"]" * 5000 + b"}\\n",
    "a huge integer": b'{"time": ' + b"9" * 400 + b"}\\n",
    "no text": bytes(range(256)),
    "words": good.replace("0.01", '"soon"').encode(),
    "lists": good.replace('"time": ', '"time": [1, 2], "clock": ').encode(),
    "cut short": good.encode()[:-30],
    "one row": good.encode().splitlines()[0],
    "other keys": good.replace("joint_1", "elbow", 1).encode(),
    "nulls": good.replace("0.02", "null").encode(),
}
rng = np.random.default_rng(0)
for number in range(60):
    data = bytearray(good.encode())
    for place in rng.integers(len(data), size=4):
        data[place] = rng.integers(256)
    spoilt[f"bytes {number}"] = bytes(data)
outcomes = {}
for name, data in spoilt.items():
    path = Path("spoilt.ndjson")
    path.write_bytes(data)
    outcomes[name] = [outcome(path, read) for read in (load_session, read_foreign)]
told = {
    "joints": list(run.joints),
    "position": run.position[:, 1].tolist(),
    "foreign": list(read_foreign(folder / "a.ndjson").columns),
    "outcomes": outcomes,
}
print(json.dumps(told))
"""


def block(begins: str) -> str:
    """The indented lines of the recipe from those on that begin so, to where the text goes on."""
    lines = HOW_TO.read_text(encoding="utf-8").splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith(f"    {begins}"))
    taken = []
    for line in lines[first:]:
        if line and not line.startswith("    "):
            break
        taken.append(line.removeprefix("    "))
    return "\n".join(taken).strip() + "\n"


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a copy of the package that has the reader says of its files."""
    place = tmp_path_factory.mktemp("package")
    (place / "ident").mkdir()
    for source in (ROOT / "ident").glob("*"):
        (place / "ident" / source.name).symlink_to(source)
    (place / "ident/recordings").unlink()
    copytree(ROOT / "ident/recordings", place / "ident/recordings")
    (place / "ident/recordings/json_lines.py").write_text(block(READER), encoding="utf-8")
    load = place / "ident/recordings/load.py"
    text = load.read_text(encoding="utf-8")
    assert text.count(SHIPPED_ENDINGS) == 1, "a format has come: say it in SHIPPED_ENDINGS and in the recipe"
    assert text.count(LAST_LINE) == 1
    case = "".join(f"    {line}\n" if line else "\n" for line in block(CASE).splitlines())
    text = text.replace(SHIPPED_ENDINGS, block(ENDINGS).splitlines()[0])
    load.write_text(text.replace(LAST_LINE, f"{case}{LAST_LINE}"), encoding="utf-8")
    work = tmp_path_factory.mktemp("work")
    environment = {**os.environ, "PYTHONPATH": str(place)}
    command = [sys.executable, "-c", COMMANDS]
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return dict(json.loads(done.stdout.splitlines()[-1]))


def test_a_folder_of_such_files_is_a_session(told: dict[str, Any]) -> None:
    """Law: the numbers are those that were written, columns of words are passed over."""
    assert told["joints"] == ["joint_1", "joint_2"]
    assert len(told["position"]) == 400
    assert told["position"][0] == pytest.approx(0.8414709848)
    assert "mode" not in told["foreign"]


def test_a_spoilt_file_is_read_or_told_in_a_line(told: dict[str, Any]) -> None:
    """Law: never a traceback, in a session or in the guesses of `ident new`."""
    outcomes = told["outcomes"]
    assert {each for pair in outcomes.values() for each in pair} <= {"read", "told"}, outcomes
    assert outcomes["empty"] == ["told", "told"]
    assert outcomes["words"][0] == "told"
