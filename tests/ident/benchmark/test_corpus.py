"""Laws of the corpus: its index, its order, what is kept back, and how a case is run."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_corpus import entry, truth

from ident.benchmark.corpus import (
    Entry,
    index_of_others,
    interleaved,
    make_index,
    read_index,
    write_index,
)
from ident.benchmark.corpus_run import result_path, run_entry
from ident.benchmark.corpus_worlds import MOST_ROWS, plan_world_cases, shortened
from ident.errors import InputError
from ident.recordings.recording import Recording, Session
from ident.recordings.save import fill_session
from ident.simulation.real.moved_arm import MovedArm
from ident.simulation.real.sources import (
    Source,
    kept_back_arms,
    known_recordings,
    load_sources,
    recorded_causes,
)
from ident.simulation.world import PRESETS

PENDULUM = """<robot name="bar"><link name="base"/><link name="bar"><inertial>
<origin xyz="0 0 -0.1"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="5" velocity="5"/></joint></robot>"""


def swing(seconds: float = 12.0) -> Recording:
    """A pendulum that follows a sine, logged at 100 Hz with gravity, friction and noise."""
    t = np.arange(0.0, seconds, 0.01)
    q = np.sin(2.0 * t)[:, None]
    noise = 0.02 * np.random.default_rng(0).standard_normal(q.shape)
    torque = 0.981 * np.sin(q) + 0.2 * np.sign(np.cos(2.0 * t))[:, None] + noise
    return Recording("run_00", ("joint",), t, q, torque)


def test_an_index_is_read_as_it_was_written(tmp_path: Path) -> None:
    entries = [
        entry("real/case_1", truth("payload", "joint_2", mass_kg=1.5)),
        entry("other/case_2", kind="healthy"),
    ]
    write_index(tmp_path, entries)
    assert read_index(tmp_path / "index.json") == entries
    (tmp_path / "index.json").write_text('{"schema": "ident.blind/1"}', encoding="utf-8")
    with pytest.raises(InputError, match=r"ident\.blind/1"):
        read_index(tmp_path / "index.json")


def test_every_beginning_holds_all_kinds() -> None:
    """The first 20 of 120 sessions hold each kind, in about its share; controls come early."""
    counts = {
        "control": 10,
        "single": 60,
        "pair": 10,
        "outside": 10,
        "untouched": 10,
        "healthy": 20,
    }
    entries = [entry(f"real/{kind}_{k}", kind=kind) for kind, count in counts.items() for k in range(count)]
    order = interleaved(entries)
    beginning = [one.kind for one in order[:20]]
    assert sorted(one.case for one in order) == sorted(one.case for one in entries)
    assert set(beginning) == set(counts)
    assert 7 <= beginning.count("single") <= 12
    assert beginning.count("control") == 3


def test_arms_that_are_kept_back_stay_closed() -> None:
    """No session of such an arm is among the others, and none of a measured cause."""
    closed = set(kept_back_arms())
    table = known_recordings()
    opened = {row["arm"] for row in table.values() if not row.get("kept_back", False)}
    assert len(closed) == 6
    assert not closed & opened
    assert not closed & {row["arm"] for row in recorded_causes().values()}


def write_source(folder: Path, name: str) -> None:
    """A folder of one run that names its robot."""
    place = folder / name
    place.mkdir(parents=True)
    fill_session(Session(name, (swing(),), robot="robot.urdf"), place)
    (place / "robot.urdf").write_text(PENDULUM, encoding="utf-8")


def test_a_search_for_recordings_leaves_closed_arms_out(tmp_path: Path) -> None:
    """Even where their folder names a robot; it opens them alone where that is asked for."""
    write_source(tmp_path, "rokae_ar5")
    write_source(tmp_path, "my_arm")
    assert [source.arm for source in load_sources(tmp_path)] == ["my_arm"]
    assert [source.arm for source in load_sources(tmp_path, kept_back=True)] == ["rokae_ar5"]
    with pytest.raises(InputError):
        load_sources(tmp_path, arms=("another",))


def test_an_arm_of_one_joint_can_carry_a_plant() -> None:
    """Gravity, friction and offset are fitted; the noise of 0.02 N m is left, cut at 8 Hz."""
    arm = MovedArm.of(Source("bar", "bar", PENDULUM, (swing(),)))
    assert arm.noise.shape == (1,)
    assert arm.noise[0] < 0.06
    assert abs(arm.coulomb[0] - 0.2) < 0.05


def test_worlds_are_made_shorter_not_other() -> None:
    """Rows are limited by the number and length of runs; nothing else of a world changes."""
    for number in range(40):
        world = PRESETS["any"].draw(np.random.default_rng(number))
        short = shortened(world)
        changed = {key for key, value in vars(world).items() if value != vars(short)[key]}
        assert changed <= {"runs", "duration_s"}
        rows = short.rate_hz * short.duration_s
        assert rows <= max(MOST_ROWS, 20.0 * short.rate_hz) + 1e-6
        assert 1 <= short.runs <= world.runs


def test_a_corpus_of_worlds_is_the_same_again() -> None:
    first, second = (plan_world_cases(Path("out"), 30, 5) for _ in range(2))
    assert first == second
    assert len({task.slot.name for task in first}) == 30
    assert plan_world_cases(Path("out"), 30, 6) != first


def test_answers_of_another_simulator_are_read_in_our_words(tmp_path: Path) -> None:
    """Where it may stand, and figures with our signs; a healthy session has no truth."""
    offset = {
        "effect": "encoder_offset",
        "joint": "joint_2",
        "size": 0.02,
        "visible": 3.0,
        "shows_at": "joint_2",
    }
    load = {"effect": "payload", "joint": None, "size": 1.5, "visible": 1.0, "shows_at": "joint_3"}
    answers = {
        "session_0": {"kind": "null", "effects": []},
        "session_1": {"kind": "pair", "effects": [offset, load]},
    }
    (tmp_path / "answers.json").write_text(json.dumps(answers), encoding="utf-8")
    healthy, pair = index_of_others(tmp_path, "other")
    assert healthy.kind == "healthy"
    assert not healthy.truth
    zero, payload = pair.truth
    assert zero.parameters == {"offset_rad": -0.02}
    assert zero.may_stand_at == ("joint_2",)
    assert payload.parameters == {"mass_kg": 1.5}
    assert payload.may_stand_at == ()
    assert len(make_index(tmp_path, [tmp_path])) == 2


def diagnose_by_name(session: Entry) -> dict[str, Any]:
    """Does what a case is called."""
    if session.case.endswith("fails"):
        raise ValueError("no joints")
    while session.case.endswith("endless"):
        pass
    return {"verdict": "no_gap", "value": np.float64(np.nan)}


def test_a_case_that_fails_or_does_not_end_is_told_and_ends_no_other(tmp_path: Path) -> None:
    said = {
        name: run_entry(entry(f"other/{name}"), tmp_path, diagnose_by_name, 1.0)
        for name in ("works", "fails", "endless")
    }
    assert said["works"]["verdict"] == "no_gap"
    assert said["fails"]["error"] == "ValueError: no joints"
    assert "not done" in said["endless"]["error"]
    stored = json.loads(result_path(tmp_path, "other/works").read_text(encoding="utf-8"))
    assert stored["value"] is None
    assert stored["peak_mb"] > 1.0
