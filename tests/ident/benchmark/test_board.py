"""The public board: seals hold, nothing tells a truth, and scores are what they say."""

import json
import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest
from typer.testing import CliRunner

from ident.arrays import Array, Float
from ident.benchmark.board.case import DRAWN, MEASURED, NONE, OTHER, PLANTED
from ident.benchmark.board.drawn import _options, make_drawn, plan_drawn
from ident.benchmark.board.entry import SCHEMA, Answer, Named, read_answer, undecided
from ident.benchmark.board.files import Board, Kept, packed, read_columns, write_columns, write_run
from ident.benchmark.board.jobs import JOBS
from ident.benchmark.board.leaks import (
    classifier_p_value,
    different_urdfs,
    exchange_p_value,
    find_leaks,
    find_words,
    place_p_value,
)
from ident.benchmark.board.make import how_often, make_board
from ident.benchmark.board.methods import OURS, our_answer, undecided_record
from ident.benchmark.board.ours import mean_shares
from ident.benchmark.board.published import published_effects
from ident.benchmark.board.recorded import (
    load_board_sources,
    make_planted,
    plan_planted,
    split_of,
    unrounded,
)
from ident.benchmark.board.report import render_board, score_board
from ident.benchmark.board.score import AMPLITUDES, SHAPELESS, amplitude_of, score_answer
from ident.benchmark.board.sealing import digest_of, salt_of, seal_of
from ident.benchmark.board.unnamed import DIAGNOSIS, LISTED, NOTHING, PLACES, STATES, load_shares
from ident.cli.app import app
from ident.errors import InputError
from ident.files import write_record
from ident.recordings.recording import Recording
from ident.simulation.real.sources import Source
from ident.simulation.simulate import simulate
from tests.schemas import check_file

EFFECTS = list(published_effects())
BENCH = Path(__file__).parents[2] / "bench" / "peers"
PEERS = ("board_least_squares", "board_trees", "board_sapc", "board_jobs", "run_figaroh", "run_sysid")
REAL = Path(os.environ.get("IDENT_REAL_DATA", "../shared/real"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("board")
    make_board(folder / "board", folder / "kept", 3, 5, None, "scara")
    return folder / "board", folder / "kept"


def entry_of(board: Board, folder: Path, sure: float = 1.0) -> Path:
    """An entrant who holds nothing wrong so probable, and anything else the rest."""
    for name in board.sessions:
        rest = (1.0 - sure) / (len(board.effects) + 1)
        record = undecided_record(name, board)
        rows = [{**row, "probability": rest} for row in record["effects"]]
        record |= {"effects": rows, NONE: sure, OTHER: rest}
        write_record(folder / f"{name}.json", record)
    return folder


def truth(*effects: str, **facts: Any) -> dict[str, Any]:
    rows = [
        {"effect": effect, "in_catalogue": effect in EFFECTS, "may_stand_at": ["a"], "parameters": {}}
        for effect in effects
    ]
    return {"kind": "single", "effects": rows, "known": {}, **facts}


def named(effect: str, probability: float, joint: str = "a", **facts: Any) -> Named:
    given = {"members": (effect,), "parameters": {}, **facts}
    return Named(effect, joint, probability, **given)


@pytest.fixture(scope="module")
def remade(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the command made the same board once more, and said so in result.json."""
    folder = tmp_path_factory.mktemp("remade")
    places = [str(folder / "board"), "--kept", str(folder / "kept"), "--json", str(folder / "result.json")]
    done = CliRunner().invoke(app, ["board", "make", *places, "--cases", "3", "--seed", "5", "--worlds", "scara"])
    assert done.exit_code == 0, (done.output, done.exception)
    return folder


def test_twice_from_one_seed_gives_the_same_bytes(made: tuple[Path, Path], remade: Path) -> None:
    """Law: whether a program makes a board or the command does."""
    for place, name in zip(made, ("board", "kept"), strict=True):
        assert digest_of(remade / name) == digest_of(place)


def test_an_answer_that_was_changed_after_sealing_is_found(made: tuple[Path, Path], tmp_path: Path) -> None:
    board = Board.load(made[0])
    record = json.loads((made[1] / "answers.json").read_text())
    name = next(iter(board.sessions))
    record["answers"][name]["kind"] += " "
    write_record(tmp_path / "answers.json", record)
    with pytest.raises(InputError, match=f"the answer of {name} is not the one that was sealed"):
        Kept.load(tmp_path, board)
    del record["answers"][name]
    write_record(tmp_path / "answers.json", record)
    with pytest.raises(InputError, match=f"lacks the answer of {name}"):
        Kept.load(tmp_path, board)


def test_a_torque_that_was_changed_after_sealing_is_found(made: tuple[Path, Path], tmp_path: Path) -> None:
    board = Board.load(made[0])
    name = next(iter(board.sessions))
    columns = read_columns(made[1] / "unseen" / f"{name}.parquet", "")
    first = next(key for key in columns if key.endswith("/effort"))
    columns[first][0] += 1e-9
    (tmp_path / "kept" / "unseen").mkdir(parents=True)
    (tmp_path / "kept" / "answers.json").write_bytes((made[1] / "answers.json").read_bytes())
    write_columns(columns, tmp_path / "kept" / "unseen" / f"{name}.parquet")
    entry = tmp_path / "entry"
    entry.mkdir()
    write_columns(columns, entry / f"{name}.parquet")
    with pytest.raises(InputError, match="not the torque that was sealed"):
        score_board(made[0], entry, tmp_path / "kept")


@pytest.mark.parametrize("job", JOBS)
def test_every_job_names_arms_joints_and_sessions(
    job: str,
    made: tuple[Path, Path],
    remade: Path,
    tmp_path: Path,
) -> None:
    """Law: what came of a job holds to its schema, and names every session of the board under its arm."""
    folder, kept = made
    entries = tmp_path / "entries"
    if job in ("seal", "score"):
        entry_of(Board.load(folder), entries)
    asked = {
        "answer": [str(entries), "--limit", "1"],
        "seal": [str(entries)],
        "score": [str(entries)],
    }
    if job == "make":
        file = remade / "result.json"
    else:
        file = tmp_path / "result.json"
        given = [job, str(folder), *asked[job], "--kept", str(kept), "--json", str(file)]
        done = CliRunner().invoke(app, ["board", *given])
        assert done.exit_code == 0, (done.output, done.exception)
    arms = check_file(file)["arms"]
    sessions = Board.load(folder).sessions
    assert sorted(name for arm in arms for name in arm["sessions"]) == sorted(sessions)
    for arm in arms:
        for name in arm["sessions"]:
            assert sessions[name]["arm"] == arm["robot"]
            assert sessions[name]["joints"] == arm["joints"]


def test_a_seal_hangs_on_salt_and_answer() -> None:
    """Law: the same answers of two sessions have different seals, and no order of keys matters."""
    salts = [salt_of(1, "s001"), salt_of(1, "s002"), salt_of(2, "s001")]
    assert len({seal_of(salt, {"a": 1}) for salt in salts}) == 3
    assert seal_of(salts[0], {"a": 1, "b": 2}) == seal_of(salts[0], {"b": 2, "a": 1})


def test_no_file_tells_a_truth(made: tuple[Path, Path]) -> None:
    board = Board.load(made[0])
    kept = Kept.load(made[1], board)
    assert list(find_words(made[0], kept.answers)) == []
    assert different_urdfs(board) == []
    text = "".join(path.read_text() for path in made[0].glob("*.json"))
    assert not any(salt_of(kept.seed, name) in text for name in board.sessions)
    times = {path.stat().st_mtime for path in made[0].rglob("*") if not path.name.startswith(".")}
    assert len(times) == 1


def test_the_files_of_a_board_hold_to_their_schemas(made: tuple[Path, Path], tmp_path: Path) -> None:
    board = Board.load(made[0])
    for name in ("board.json", "effects.json", "truths.json"):
        check_file(made[0] / name)
    check_file(made[1] / "answers.json")
    entry_of(board, tmp_path)
    for name in board.sessions:
        check_file(tmp_path / f"{name}.json")


def test_every_parameter_of_a_truth_is_published(made: tuple[Path, Path]) -> None:
    """Law: who reads effects.json alone knows all numbers that are asked, and what each means."""
    board = Board.load(made[0])
    for facts in board.effects.values():
        assert facts["parameters"] == sorted(facts["means"])
        assert all(facts["means"].values())
    for answer in Kept.load(made[1], board).answers.values():
        assert unpublished(answer["effects"]) == set()


def unpublished(effects: Sequence[Mapping[str, Any]]) -> set[str]:
    """Numbers of truths that no published parameter is."""
    listed = published_effects()
    missing: set[str] = set()
    for effect in effects:
        if effect["in_catalogue"]:
            numbers = set(effect["parameters"]) - set(SHAPELESS)
            missing |= numbers - set(listed[effect["effect"]]["parameters"])
    return missing


def test_the_readme_says_how_often_what_comes(made: tuple[Path, Path]) -> None:
    """Law: no placeholder is left, and each tier that is there has shares that add up."""
    text = (made[0] / "README.md").read_text()
    assert "@" not in text
    assert "| drawn | 58 % | 8 % | 8 % | 27 % |" in text
    rows = list(how_often({DRAWN: 3, PLANTED: 3, MEASURED: 1}))
    for row in rows:
        shares = [int(cell.split()[0]) for cell in row.split("|")[2:-1]]
        assert sum(shares) == pytest.approx(100, abs=2)
    assert len(rows) == 2


def test_readme_and_docs_say_the_same_of_what_is_meant(made: tuple[Path, Path]) -> None:
    """Law: each example that a reader needs stands in both, word for word, and names what the list has."""
    docs = (Path(__file__).parents[3] / "docs" / "board.md").read_text(encoding="utf-8")
    readme = (made[0] / "README.md").read_text(encoding="utf-8")
    said = readme.split("### What is meant, by example")[1].split("Scores: the **log score**")[0]
    assert said.count("\n- **") >= 7
    assert said.strip() in docs
    board = Board.load(made[0])
    known = {"", "class", "means", "before", "none", "other", "scope", *board.effects}
    for facts in board.effects.values():
        known |= set(facts["parameters"])
    named = re.findall(r"`([a-z_A-Z]+)`", said)
    assert set(named) <= known | {"joint"}


def test_both_models_of_the_readme_are_the_arm(made: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: the README's lines give Pinocchio and MuJoCo one arm: the same torque at the same motion."""
    text = (made[0] / "README.md").read_text(encoding="utf-8")
    lines = text.split("The arm that a session lists")[1].split("Switch limits off")[0].splitlines()
    code = textwrap.dedent("\n".join(line for line in lines if line.startswith("    ")))
    monkeypatch.chdir(made[0])
    for name, facts in Board.load(made[0]).sessions.items():
        known = {"name": name, "facts": facts, "pinocchio": pinocchio, "mujoco": mujoco}
        exec(code, known)
        arm, spec = known["arm"], known["spec"]
        assert list(arm.names)[1:] == facts["joints"]
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        model = spec.compile()
        data = mujoco.MjData(model)
        places = [model.joint(joint).dofadr[0] for joint in facts["joints"]]
        motion = np.random.default_rng(1).uniform(-0.5, 0.5, (3, arm.nv))
        data.qpos[places], data.qvel[places], data.qacc[places] = motion
        mujoco.mj_inverse(model, data)
        torque = pinocchio.rnea(arm, arm.createData(), *motion)
        assert data.qfrc_inverse[places] == pytest.approx(torque, abs=1e-6)


def test_a_word_that_tells_is_found(tmp_path: Path) -> None:
    place = tmp_path / "sessions" / "s001"
    place.mkdir(parents=True)
    (place / "session.toml").write_text('note = "payload"\n')
    answers = {"s001": {"effects": [{"effect": "payload"}]}}
    assert [word for _, word in find_words(tmp_path, answers)] == ["payload"]


def test_what_is_wrong_changes_no_time_and_no_column() -> None:
    """Law: with and without its cause a session has the same runs, channels and instants."""
    tasks = [task for task in plan_drawn(6, 3, "scara,short") if task.slot.kind == "single"]
    options = _options(tasks[0], 0)
    ill = simulate(options).session.runs
    well = simulate(replace(options, effects=())).session.runs
    assert [run.name for run in ill] == [run.name for run in well]
    for first, second in zip(ill, well, strict=True):
        assert list(first.channels()) == list(second.channels())
        np.testing.assert_array_equal(first.time, second.time)


def test_figures_that_go_with_the_truth_are_told_from_chance() -> None:
    rng = np.random.default_rng(0)
    truths = rng.integers(4, size=120)
    tiers = rng.integers(2, size=120)
    leaking = truths + rng.standard_normal(120)
    assert exchange_p_value(leaking, truths, tiers, np.random.default_rng(1)) < 1e-3
    innocent = 5.0 * tiers + rng.standard_normal(120)
    assert exchange_p_value(innocent, truths, tiers, np.random.default_rng(1)) > 0.01
    assert exchange_p_value(np.ones(120), truths, tiers, np.random.default_rng(1)) == 1.0


def test_figures_that_tell_together_are_told_from_chance() -> None:
    """Law: what no figure tells alone but two tell together is found; what is drawn is not."""
    rng = np.random.default_rng(0)
    truths = rng.integers(4, size=120)
    tiers = rng.integers(2, size=120)
    noise = rng.standard_normal((120, 3))
    hidden = 2.0 * rng.standard_normal(120)
    leaking = np.column_stack([truths + hidden, hidden, noise])
    assert classifier_p_value(leaking, truths, tiers, np.random.default_rng(1)) < 1e-3
    innocent = np.column_stack([5.0 * tiers, noise])
    assert classifier_p_value(innocent, truths, tiers, np.random.default_rng(1)) > 0.01


def test_a_figure_that_tells_the_joint_is_told_from_chance() -> None:
    rng = np.random.default_rng(0)
    names = [str(k) for k in range(20)]
    true = {name: np.arange(6) == rng.integers(6) for name in names}
    leaking = {name: true[name] + rng.standard_normal(6) for name in names}
    assert place_p_value(leaking, true, np.random.default_rng(1)) < 0.01
    innocent = {name: rng.standard_normal(6) for name in names}
    assert place_p_value(innocent, true, np.random.default_rng(1)) > 0.01
    assert place_p_value({}, true, np.random.default_rng(1)) == 1.0
    # A few sessions that tell their joint plainly, among many that don't.
    plain = {name: values + 8.0 * true[name] * (int(name) < 7) for name, values in innocent.items()}
    assert place_p_value(plain, true, np.random.default_rng(1)) < 1e-3


def test_every_figure_of_a_board_is_asked(made: tuple[Path, Path]) -> None:
    """Law: each figure, and all together, have a p-value for whether, which or where."""
    board = Board.load(made[0])
    leaks = find_leaks(board, Kept.load(made[1], board))
    questions = {(leak.figure, leak.question) for leak in leaks}
    assert len(questions) == len(leaks)
    asked = {question for _, question in questions}
    assert asked == {"whether", "which", "where", "where, by size"}
    assert ("all together", "which") in questions
    assert all(0.0 < leak.p_value <= 1.0 for leak in leaks)


def distinct(values: Float[Array, " T"]) -> float:
    """Share of values that differ as a board has them."""
    return len(np.unique(packed(values, 11))) / len(values)


def test_no_joint_is_told_by_the_rounding_of_its_torque() -> None:
    """Law: a torque to which something came leaves its rounding no more than one without."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 10.0, 0.01)
    torque = 0.04 * np.round(rng.standard_normal((len(time), 2)) / 0.04)
    recorded = Recording("run", ("a", "b"), time, torque, torque)
    source = Source("s", "arm", "", (recorded,))
    run = unrounded(source, np.random.default_rng(0)).runs[0]
    assert np.max(np.abs(run.effort - torque)) <= 0.5 * 0.04 * (1.0 + 1e-9)
    np.testing.assert_array_equal(run.position, recorded.position)
    np.testing.assert_array_equal(run.time, recorded.time)
    ill = run.effort[:, 0] + np.sin(time)
    assert distinct(ill) == pytest.approx(distinct(run.effort[:, 1]), abs=0.05)
    assert distinct(torque[:, 0] + np.sin(time)) > 2.0 * distinct(torque[:, 1])


def test_times_are_kept_to_microseconds(tmp_path: Path) -> None:
    """Law: no row of a minute comes more than four microseconds early or late, none at the time of another."""
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.001, 0.003, 32_000))
    time -= time[0]
    zeros = np.zeros((len(time), 1))
    write_run(Recording("run", ("a",), time, zeros, zeros), tmp_path / "run.parquet")
    kept = read_columns(tmp_path / "run.parquet", "")["time"]
    assert kept[0] == 0.0
    assert np.max(np.abs(kept - time)) <= 4e-6
    assert np.min(np.diff(kept)) > 0.0


def test_packed_numbers_keep_what_is_asked_for() -> None:
    values = np.random.default_rng(0).standard_normal(1000)
    assert np.max(np.abs(packed(values, 16) / values - 1.0)) < 2.0**-16
    np.testing.assert_array_equal(packed(values), values.astype(np.float32))


# Scores


def test_who_is_sure_and_right_loses_nothing() -> None:
    answer = Answer((named("payload", 1.0),), 0.0, 0.0)
    score = score_answer(answer, truth("payload"), "drawn")
    assert score.log_score == 0.0
    assert score.strict
    assert score.joint
    nothing = score_answer(Answer((), 1.0, 0.0), truth(), "drawn")
    assert (nothing.log_score, nothing.strict, nothing.class_size) == (0.0, True, None)
    outside = score_answer(Answer((), 0.0, 1.0), truth("a_cat_on_the_arm"), "drawn")
    assert (outside.log_score, outside.strict) == (0.0, True)


def test_who_knows_nothing_gets_the_logarithm_of_all_answers() -> None:
    score = score_answer(undecided(EFFECTS), truth("payload"), "drawn")
    assert score.log_score == pytest.approx(np.log(len(EFFECTS) + 2))


def test_of_two_causes_half_each_is_best() -> None:
    """Law: no other shares of two true causes have a better log score than even ones."""
    pair = truth("payload", "backlash")
    scores: dict[float, float] = {}
    for share in (0.2, 0.5, 0.9):
        names = (named("payload", share), named("backlash", 1.0 - share))
        scores[share] = score_answer(Answer(names, 0.0, 0.0), pair, "drawn").log_score
    assert min(scores, key=lambda share: scores[share]) == 0.5
    assert scores[0.5] == pytest.approx(np.log(2.0))


def test_no_name_is_excused() -> None:
    """Law: probability on a name that is not true is lost, whatever arm it is said of."""
    names = (named("spring_torque", 0.5, "b"), named("payload", 0.25))
    score = score_answer(Answer(names, 0.25, 0.0), truth("payload"), "semi-real")
    assert score.log_score == pytest.approx(np.log(4.0))


@pytest.mark.parametrize(
    ("visible", "amplitude"),
    [([0.2], AMPLITUDES[0]), ([1.0], AMPLITUDES[1]), ([3.0], AMPLITUDES[2]), ([3.0, 1.0], AMPLITUDES[1])],
)
def test_a_session_shows_as_much_as_what_shows_least(visible: list[float], amplitude: str) -> None:
    effects = [{"effect": "payload", "visible": {"a": size, "b": 0.1 * size}} for size in visible]
    assert amplitude_of(effects) == amplitude
    assert amplitude_of([]) is None
    assert amplitude_of([*effects, {"effect": "payload", "visible": {}}]) is None


@pytest.mark.parametrize(("probability", "counted"), [(0.49, 0), (0.5, 1)])
def test_an_interval_counts_from_half_of_the_true_share(probability: float, counted: int) -> None:
    held = truth("payload")
    held["effects"][0]["parameters"] = {"mass_kg": 1.0}
    given = {"mass_kg": {"value": 1.0, "low": 0.5, "high": 1.5}}
    name = named("payload", probability, "a", parameters=given)
    score = score_answer(Answer((name,), 1.0 - probability, 0.0), held, "semi-real")
    assert len(score.intervals) == counted


def test_a_class_and_an_interval_count_where_they_hold_the_truth() -> None:
    inside = {"mass_kg": {"value": 1.0, "low": 0.5, "high": 1.5}}
    members = ("link_inertial_error", "payload")
    name = named("link_inertial_error", 1.0, "a", members=members)
    score = score_answer(Answer((name,), 0.0, 0.0), truth("payload"), "drawn")
    assert (score.strict, score.classed, score.class_size) == (False, True, 2)
    right = named("payload", 1.0, "a", parameters=inside)
    held = truth("payload")
    held["effects"][0]["parameters"] = {"mass_kg": 1.25}
    assert score_answer(Answer((right,), 0.0, 0.0), held, "drawn").intervals == ((True, 0.4),)
    held["effects"][0]["parameters"] = {"mass_kg": 2.0}
    assert score_answer(Answer((right,), 0.0, 0.0), held, "drawn").intervals == ((False, 0.25),)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": "x"}, "write"),
        ({"session": "s999"}, "write"),
        ({"none": 0.5}, "add up to"),
        ({"none": -1.0}, "give 0 to 1"),
        ({"none": "much"}, "give 0 to 1"),
        ({"effects": 3}, "is no list"),
        ({"effects": [{"effect": "gremlins", "probability": 0.0}]}, "there is no effect"),
        ({"effects": [{"effect": "backlash", "joint": "tail", "probability": 0.0}]}, "stands at"),
        ({"effects": [{"effect": "payload", "probability": True}]}, "give 0 to 1"),
        ({"effects": [{"effect": "payload", "probability": 0.0, "class": "x"}]}, "is no list"),
        (
            {"effects": [{"effect": "payload", "probability": 0.0, "parameters": {"mass_kg": 1.0}}]},
            "has no value",
        ),
        (
            {
                "effects": [
                    {
                        "effect": "payload",
                        "probability": 0.0,
                        "parameters": {"mass_kg": {"value": 1.0, "low": -1e16, "high": 1e16}},
                    }
                ]
            },
            "low of mass_kg of payload is -1e\\+16",
        ),
    ],
)
def test_an_entry_that_is_none_is_refused_in_a_line(
    made: tuple[Path, Path], tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    board = Board.load(made[0])
    name = next(iter(board.sessions))
    path = tmp_path / f"{name}.json"
    good = {"schema": "ident.board_answer/1", "session": name, "effects": [], "none": 1.0}
    write_record(path, good)
    assert read_answer(path, board, name).none == 1.0
    write_record(path, good | change)
    with pytest.raises(InputError, match=words):
        read_answer(path, board, name)


def test_what_is_dealt_evenly_goes_to_all_answers(made: tuple[Path, Path], tmp_path: Path) -> None:
    """Law: all effects, none and other get the same, and it is said of no joint."""
    board = Board.load(made[0])
    name = next(iter(board.sessions))
    path = tmp_path / f"{name}.json"
    row = {"effect": "payload", "joint": "", "probability": 0.5}
    write_record(path, {"schema": SCHEMA, "session": name, "effects": [row], "none": 0.25, "evenly": 0.25})
    check_file(path)
    shares = read_answer(path, board, name).shares()
    each = 0.25 / (len(board.effects) + 2)
    assert shares.pop("payload") == pytest.approx(0.5 + each)
    assert shares.pop(NONE) == pytest.approx(0.25 + each)
    assert list(shares.values()) == pytest.approx([each] * (len(board.effects) - 1 + 1))
    write_record(path, {"schema": SCHEMA, "session": name, "effects": [], "evenly": 1.0})
    assert not score_answer(read_answer(path, board, name), truth(EFFECTS[0]), "drawn").joint


def test_entrants_are_scored_beside_each_other(made: tuple[Path, Path], tmp_path: Path) -> None:
    """Law: who foretells the torque itself is off by nothing, and the page tells all entrants."""
    board = Board.load(made[0])
    entry_of(board, tmp_path / "sure")
    vague = entry_of(board, tmp_path / "vague", 0.5)
    for name in board.sessions:
        content = (made[1] / "unseen" / f"{name}.parquet").read_bytes()
        (vague / f"{name}.parquet").write_bytes(content)
    report = score_board(made[0], tmp_path, made[1])
    entries = {entry["name"]: entry for entry in report.record["entries"]}
    assert entries["vague"]["prediction"]["median_Nm"] == 0.0
    assert "prediction" not in entries["sure"]
    page = render_board(report.to_dict())
    assert "vague" in page
    assert "best log score of all entrants" in page
    assert "vague" in report.summary()
    alone = render_board(score_board(made[0], tmp_path / "sure", made[1]).to_dict())
    assert "best" not in re.sub(r"<style>.*?</style>", "", alone, flags=re.DOTALL).replace('class="best"', "")


def test_who_is_behind_is_told_by_the_same_sessions(made: tuple[Path, Path], tmp_path: Path) -> None:
    """Law: how far an entrant is behind the first is the difference of their scores; a copy of the first is not."""
    board = Board.load(made[0])
    for name, sure in (("copy", 0.9), ("first", 0.9), ("second", 0.5)):
        entry_of(board, tmp_path / name, sure)
    report = score_board(made[0], tmp_path, made[1])
    first, *others = report.record["entries"]
    assert "behind the first" not in first
    for entry in others:
        told = entry["behind the first"]
        apart = entry["attribution"]["log_score"]["value"] - first["attribution"]["log_score"]["value"]
        assert told["value"] == pytest.approx(apart, abs=2e-3)
        assert told["low"] <= told["value"] <= told["high"]
        assert told["count"] == len(board.sessions)
    same = report.record["entries"][1]
    is_same = same["attribution"] == first["attribution"]
    assert is_same == (same["behind the first"]["value"] == 0.0)
    assert ("tell the two apart" in render_board(report.to_dict())) == (same["behind the first"]["low"] <= 0.0)


def test_a_foretold_motion_of_other_length_is_refused(made: tuple[Path, Path], tmp_path: Path) -> None:
    board = Board.load(made[0])
    name = next(iter(board.sessions))
    columns = read_columns(made[1] / "unseen" / f"{name}.parquet", "")
    shorter = {key: np.ascontiguousarray(values[1:]) for key, values in columns.items()}
    write_columns(shorter, tmp_path / f"{name}.parquet")
    with pytest.raises(InputError, match="one row for each"):
        score_board(made[0], tmp_path, made[1])


def test_a_diagnosis_as_an_answer_adds_up_to_one(made: tuple[Path, Path], tmp_path: Path) -> None:
    board = Board.load(made[0])
    name = next(iter(board.sessions))
    joint = board.sessions[name]["joints"][0]
    found = {"effect": "backlash", "joints": [joint], "class": ["backlash", "presliding_hysteresis"]}
    found |= {"probability": 0.6, "class_probability": 0.9, "parameters": {}}
    verdicts = ("named", "no_gap", "refused")
    for verdict, findings in zip(verdicts, ([found], [], []), strict=True):
        record = {"verdict": verdict, "findings": findings, "reservations": [], "outside_score": 0.3}
        path = tmp_path / OURS / f"{name}.json"
        write_record(path, our_answer(name, record, board, load_shares(DIAGNOSIS)))
        shares = read_answer(path, board, name).shares()
        assert sum(shares.values()) == pytest.approx(1.0)
        assert min(shares.values()) > 0.0
        if verdict == "named":
            assert max(shares, key=lambda label: shares[label]) == "backlash"
            assert shares["presliding_hysteresis"] > 10.0 * shares["payload"]
        if verdict == "no_gap":
            assert max(shares, key=lambda label: shares[label]) == NONE


def test_what_no_name_has_goes_where_causes_without_a_name_are(
    made: tuple[Path, Path],
    tmp_path: Path,
) -> None:
    """Law: without a name, none, other and all effects together have the shares of that state."""
    board = Board.load(made[0])
    name = next(iter(board.sessions))
    record = {"verdict": "no_gap", "findings": [], "reservations": [], "outside_score": 0.0}
    path = tmp_path / f"{name}.json"
    even = 1.0 / ((len(board.effects) + 3) * (len(board.effects) + 2))
    for shares in ((1.0, 0.0, 0.0), (0.5, 0.25, 0.25), (0.0, 0.0, 1.0)):
        places = dict(zip(PLACES, shares, strict=True))
        other_states = dict.fromkeys(STATES, dict.fromkeys(PLACES, 0.5))
        fitted = other_states | {NOTHING: places}
        write_record(path, our_answer(name, record, board, fitted))
        answer = read_answer(path, board, name).shares()
        given = {label: share - even for label, share in answer.items()}
        unnamed = sum(given.values())
        assert given.pop(NONE) == pytest.approx(places[NONE] * unnamed, abs=1e-9)
        assert given.pop(OTHER) == pytest.approx(places[OTHER] * unnamed, abs=1e-9)
        assert sum(given.values()) == pytest.approx(places[LISTED] * unnamed, abs=1e-9)
        assert max(given.values()) == pytest.approx(min(given.values()), abs=1e-9)


def test_mean_shares_are_those_of_drawn_causes() -> None:
    """Law: they add up to the chance of any cause, and are what draws of the causes show."""
    probabilities = (0.9, 0.4, 0.4, 0.0, 1.0)
    shares = mean_shares(probabilities)
    assert shares.sum() == pytest.approx(1.0)
    assert mean_shares((0.9, 0.3)).sum() == pytest.approx(1.0 - 0.1 * 0.7)
    drawn = np.random.default_rng(0).random((40_000, len(probabilities))) < probabilities
    np.testing.assert_allclose(shares, (drawn / drawn.sum(axis=1, keepdims=True)).mean(axis=0), atol=0.01)


def test_a_drawn_session_comes_with_a_motion_without_its_cause() -> None:
    task = next(task for task in plan_drawn(6, 3, "scara,short") if task.slot.kind == "single")
    case = make_drawn(task, oracle=False)
    assert case.unseen is not None
    assert case.unseen.joints == case.runs[0].joints
    assert len(case.effects) == 1


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_is_short_enough_for_its_authors_to_read(name: str) -> None:
    """Law: the script by which a peer is entered has no more than eighty lines with something in them."""
    lines = (BENCH / f"{name}.py").read_text(encoding="utf-8").splitlines()
    assert 0 < sum(bool(line.strip()) for line in lines) <= 80


@pytest.mark.parametrize("name", ["board_least_squares", "board_sapc"])
def test_a_peer_enters_by_the_files_alone(made: tuple[Path, Path], tmp_path: Path, name: str) -> None:
    """Law: a script that knows nothing of armgap foretells every motion, better than torque zero."""
    subprocess.run([sys.executable, BENCH / f"{name}.py", made[0], tmp_path / "peer"], check=True)
    entry = score_board(made[0], tmp_path, made[1]).record["entries"][0]
    motions = sum(facts["unseen"] for facts in Board.load(made[0]).sessions.values())
    assert entry["foretold"] == motions == 3
    assert entry["prediction"]["share_of_spread"] < 1.0
    assert entry["answered"] == (3 if name == "board_sapc" else 0)


@pytest.mark.real
@pytest.mark.skipif(not (REAL / "kr300").is_dir(), reason="no recordings of real arms")
def test_sessions_on_recordings_hold_no_row_of_the_unseen_motion() -> None:
    """Law: no session is made twice of a stretch, none holds the end, and all of an arm have the same URDF."""
    sources = load_board_sources(REAL, 4)
    ends = {source.arm: split_of(source) for source in sources.values()}
    places = plan_planted(sources, 4, 4)
    assert len({(whole.arm, stretch.rows.start) for _, stretch, whole in places}) == len(places) == 4
    urdfs: dict[str, set[str]] = {}
    for slot, stretch, whole in places:
        assert stretch.rows.stop <= ends[whole.arm]
        case = make_planted(slot, stretch, whole, 4)
        if case is None:
            continue
        assert len(case.runs[0]) == stretch.rows.stop - stretch.rows.start
        assert case.runs[0].time[0] == 0.0
        assert unpublished(case.effects) == set()
        urdfs.setdefault(case.arm, set()).add(case.urdf)
    assert all(len(texts) == 1 for texts in urdfs.values())
