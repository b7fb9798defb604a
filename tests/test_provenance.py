"""Where a result comes from: code, engines, units, what the torque's scale rests on, and what the recordings hold."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.origin import ENGINES, code_commit, engine_versions
from ident.recordings.load import load_session
from ident.recordings.recording import Recording, Session
from ident.results import SCALES, Provenance, made_by, stamp_sessions
from ident.robot.names import data_path
from ident.show.report.page import Section, facts_section, provenance_facts, render_page

ROOT = Path(__file__).parents[1]
E1 = Path(data_path("logs/tm5_900")) / "E1"
COMMIT = "0123456789abcdef0123456789abcdef01234567"


def checkout(folder: Path, head: str) -> Path:
    """A package in a made-up checkout."""
    (folder / ".git/refs/heads").mkdir(parents=True)
    (folder / "pyproject.toml").write_text("")
    (folder / ".git/HEAD").write_text(head)
    return folder / "ident"


def test_the_commit_is_gits(tmp_path: Path) -> None:
    """Law: of a branch, of a packed one, of a commit by itself, of a further worktree; no program is started."""
    package = checkout(tmp_path / "branch", "ref: refs/heads/main\n")
    (tmp_path / "branch/.git/refs/heads/main").write_text(f"{COMMIT}\n")
    assert code_commit(package) == COMMIT
    package = checkout(tmp_path / "packed", "ref: refs/heads/main\n")
    (tmp_path / "packed/.git/packed-refs").write_text(f"# pack-refs with: peeled\n{COMMIT} refs/heads/main\n")
    assert code_commit(package) == COMMIT
    assert code_commit(checkout(tmp_path / "alone", COMMIT)) == COMMIT
    (tmp_path / "tree/ident").mkdir(parents=True)
    (tmp_path / "tree/pyproject.toml").write_text("")
    (tmp_path / "tree/.git").write_text(f"gitdir: {tmp_path / 'branch/.git'}\n")
    assert code_commit(tmp_path / "tree/ident") == COMMIT


def test_without_a_checkout_there_is_no_commit(tmp_path: Path) -> None:
    assert code_commit(tmp_path / "nowhere/ident") is None
    assert code_commit(checkout(tmp_path / "loop", "ref: HEAD\n")) is None
    assert code_commit(checkout(tmp_path / "odd", "nonsense\n")) is None


def test_the_commit_is_that_of_this_checkout() -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    asked = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert asked.returncode != 0 or code_commit() == asked.stdout.strip()


def test_every_result_says_what_made_it() -> None:
    record = Provenance("ident inspect", sessions=stamp_sessions([load_session(E1)])).to_dict()
    assert record["units"].startswith("SI")
    assert {"numpy", "scipy", "pin"} <= set(record["engines"]) <= set(ENGINES)
    assert record["commit"] == code_commit()
    (stamp,) = record["sessions"]
    assert len(stamp["content"]) == len(stamp["sha256"]) == 64
    assert stamp["scale"] == SCALES["recorded"]


def test_content_is_that_of_the_numbers() -> None:
    """Law: the same whatever the file, its name and the order of its columns; another where any number is another."""
    session = load_session(E1)
    turned = session.replace(runs=tuple(run.select(run.joints[::-1]) for run in session.runs), name="other")
    moved = session.runs[0].replace(position=session.runs[0].position + 1e-12)
    other = session.replace(runs=(moved, *session.runs[1:]))
    marks = [stamp_sessions([one])[0].content for one in (session, turned, other)]
    assert marks[0] == marks[1] != marks[2]


def test_the_scales_anchor_is_told() -> None:
    run = Recording("run", ("a",), np.arange(4.0), np.zeros((4, 1)), np.ones((4, 1)))
    session = Session("s", (run,))
    current = Session("s", (run.replace(current=np.ones((4, 1))),))
    guessed = replace(current, guessed_gains={"a": 1.0})
    scales = [stamp_sessions([one])[0].scale for one in (session, current, guessed)]
    assert scales == [SCALES["recorded"], SCALES["given"], SCALES["guessed"]]


def test_every_page_says_what_made_it() -> None:
    """Law: the foot of a page names version, commit, engines and units; its facts name the content of each session."""
    record = {"provenance": Provenance("ident x", sessions=stamp_sessions([load_session(E1)])).to_dict()}
    facts = facts_section(provenance_facts(record))
    page = render_page("title", [facts, Section("a", "A", "facts.html", {"facts": []})])
    assert f"numpy {engine_versions()['numpy']}" in page
    assert (code_commit() or "armgap")[:12] in page
    assert record["provenance"]["sessions"][0]["content"] in page
    assert "SI: rad" in made_by()
