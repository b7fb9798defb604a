"""Laws of the calibration: what it says is as often right, on units that it has not seen."""

import json
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_corpus import BASE, SLOPE, candidate, entry, make_corpus, truth, write_result

from ident.benchmark.calibrate import SIGNS, calibration_record, read_signs, write_names
from ident.benchmark.calibration_file import read_calibration, write_calibration
from ident.benchmark.corpus_check import calibrate_corpus, check_corpus
from ident.benchmark.corpus_table import Table, load_table, store
from ident.benchmark.gap_odds import FEATURES as GAP_FEATURES
from ident.benchmark.labels import RIGHT, UNKNOWN
from ident.benchmark.law_shares import Miss, fit_widths
from ident.benchmark.leave_out import Problem, left_out, select_features
from ident.benchmark.logistic import fit_logistic, log_score
from ident.benchmark.name_odds import GROUPS, ROWS, SESSIONS, fit_calibration, judged, row_weights
from ident.benchmark.run import BlindOptions
from ident.benchmark.tempering import Choice, fit_growing_temper
from ident.benchmark.unlike_odds import FEATURE as UNLIKE
from ident.benchmark.unlike_odds import fit_unlike
from ident.errors import InputError
from ident.inference.calibration import FILE as SHIPPED
from ident.inference.calibration import Odds, Term, read_odds
from ident.inference.joints_left import COMPARED
from ident.safe_read import read_toml

FEATURES = ("evidence", "nothing")


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Table:
    out = tmp_path_factory.mktemp("corpus")
    entries = make_corpus(out / "results", 900, seed=3)
    store(entries, out / "results", out / "table")
    return load_table(out / "table")


def problem_of(table: Table, signs: dict[str, int] | None = None) -> Problem:
    labels = table.labels(table.named)
    counted = labels != UNKNOWN
    weights = row_weights(table, counted, ROWS)[counted]
    features = table.matrix(FEATURES)[counted]
    right = labels[counted] == RIGHT
    return Problem(features, FEATURES, right, weights, table.units[counted], signs or {})


def test_log_odds_are_those_that_made_the_labels(table: Table) -> None:
    """900 sessions tell a slope of 2 to within 0.5, and that a feature says nothing."""
    fitted = fit_calibration(table, FEATURES, {})
    slope = fitted.model.weights / fitted.model.scaling.scale
    base = fitted.model.log_odds(np.array([[0.0, 0.0]]))[0]
    assert abs(slope[0] - SLOPE) < 0.5
    assert abs(base - BASE) < 0.5
    assert abs(slope[1]) < 0.25


def test_the_share_that_an_impossible_figure_leaves_is_what_made_the_labels(table: Table) -> None:
    """Law: true odds leave all of the probability, odds that are too high by e the share by which they are; no
    candidate says one half.
    """
    right = Odds(BASE, {"evidence": Term(SLOPE, 0.0, 1.0)})
    for said, kept in ((right, 1.0), (replace(right, intercept=BASE + 2.0), None)):
        unlike = replace(table, features={**table.features, UNLIKE: np.ones(len(table.rows))})
        fit = fit_unlike([unlike], said)
        assert fit.right + fit.wrong == len(table.rows)
        probabilities = [said.probability({"evidence": float(x)}) for x in table.features["evidence"]]
        expected = fit.right / float(np.sum(probabilities)) if kept is None else kept
        assert fit.share == pytest.approx(expected, abs=0.15)
        assert (fit.held_out_nats > 1.0) is (kept is None)
    possible = replace(table, features={**table.features, UNLIKE: np.zeros(len(table.rows))})
    assert fit_unlike([possible], right).share == pytest.approx(0.5, abs=1e-3)


def test_what_is_said_of_units_left_out_is_as_often_right(table: Table) -> None:
    fitted = fit_calibration(table, FEATURES, {})
    scores = judged(table, fitted.held_out, fitted.labels, np.ones(len(table.rows), dtype=bool))
    for row in scores["bins"]:
        spread = np.sqrt(row["said"] * (1.0 - row["said"]) / row["count"])
        assert abs(row["said"] - row["right"]) < 4.0 * spread + 0.02
    assert scores["auc"] > 0.8


def test_a_unit_has_no_say_in_its_own_probabilities(table: Table) -> None:
    """Turning a unit's labels round changes what is said of the others, not of itself."""
    problem = problem_of(table)
    unit = problem.units == problem.units[0]
    turned = Problem(
        problem.features,
        problem.names,
        np.where(unit, ~problem.right, problem.right),
        problem.weights,
        problem.units,
        {},
    )
    before = left_out(problem, 1e-3, {})
    after = left_out(turned, 1e-3, {})
    assert np.allclose(before[unit], after[unit], atol=1e-6)
    assert np.abs(before[~unit] - after[~unit]).max() > 1e-3


def test_a_feature_that_says_nothing_is_left_out(table: Table) -> None:
    """And one that says something is not; what is said of units left out is of fits without."""
    assert select_features(problem_of(table)).names == ("evidence",)
    fitted = fit_calibration(table, FEATURES, {}, select=True, nested=True)
    assert fitted.model.names == ("evidence",)
    assert np.abs(fitted.held_out - fitted.model.probability(table.matrix(["evidence"]))).max() > 1e-4


def test_a_weight_has_the_sign_of_its_meaning(table: Table) -> None:
    """A feature that should speak against, and does not, is not heard."""
    problem = problem_of(table, {"evidence": -1})
    model = problem.fit(1e-4)
    assert model.weights[0] == 0.0
    free = problem_of(table).fit(1e-4)
    assert free.weights[0] > 0.5


def test_units_of_a_feature_do_not_matter(table: Table) -> None:
    problem = problem_of(table)
    in_milli = problem.features * np.array([1e3, 1.0]) + np.array([7.0, 0.0])
    first = fit_logistic(problem.features, problem.right, problem.weights, FEATURES, 1e-3)
    second = fit_logistic(in_milli, problem.right, problem.weights, FEATURES, 1e-3)
    said = first.probability(problem.features), second.probability(in_milli)
    assert np.allclose(*said, atol=1e-4)


def test_a_ridge_draws_to_the_base_rate(table: Table) -> None:
    problem = problem_of(table)
    stiff = problem.fit(1e4).probability(problem.features)
    rate = float(problem.weights @ problem.right / problem.weights.sum())
    assert np.allclose(stiff, rate, atol=0.01)
    loose = problem.fit(1e-5).probability(problem.features)
    assert log_score(loose, problem.right, problem.weights) > log_score(stiff, problem.right, problem.weights)


def test_what_is_not_known_says_nothing(table: Table) -> None:
    model = problem_of(table).fit(1e-3)
    centre = model.scaling.centre[None, :]
    missing = np.full((1, len(FEATURES)), np.nan)
    assert model.log_odds(missing)[0] == pytest.approx(model.log_odds(centre)[0])


def test_groups_and_sessions_count_alike(tmp_path: Path) -> None:
    """Three sessions weigh as one of another group; many candidates of a session as one."""
    entries = [entry(f"real/case_{k}", truth("spring_torque", "joint_1")) for k in range(3)]
    entries.append(entry("other/case_9", truth("spring_torque", "joint_1")))
    for number, session in enumerate(entries):
        rows = [candidate("torque_ripple", f"joint_{k}", features={"x": 0.0}) for k in range(number + 1)]
        write_result(tmp_path / "results", session.case, *rows)
    store(entries, tmp_path / "results", tmp_path / "table")
    table = load_table(tmp_path / "table")
    everything = np.ones(len(table.rows), dtype=bool)
    weights = row_weights(table, everything, GROUPS)
    by_case = {case: weights[table.cases == case].sum() for case in table.sessions}
    assert by_case["real/case_0"] == pytest.approx(by_case["real/case_2"])
    assert by_case["other/case_9"] == pytest.approx(3.0 * by_case["real/case_0"])
    assert weights.mean() == pytest.approx(1.0)
    assert np.array_equal(row_weights(table, everything, ROWS), np.ones(len(table.rows)))
    of_sessions = row_weights(table, everything, SESSIONS)
    by_case = {case: of_sessions[table.cases == case].sum() for case in table.sessions}
    assert np.ptp(list(by_case.values())) < 1e-9


def test_the_file_says_what_was_fitted(table: Table, tmp_path: Path) -> None:
    fitted = fit_calibration(table, FEATURES, {})
    record = calibration_record(table, fitted, {"seed": 3})
    write_calibration(tmp_path / "calibration.toml", record)
    model = read_calibration(tmp_path / "calibration.toml")
    matrix = table.matrix(model.names)
    assert np.allclose(model.probability(matrix), fitted.model.probability(table.matrix(FEATURES)))
    text = (tmp_path / "calibration.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["origin"]["seed"] == 3


def test_names_are_fitted_anew_and_all_else_stays(table: Table, tmp_path: Path) -> None:
    out = tmp_path / "calibration.toml"
    shutil.copy(SHIPPED, out)
    before = read_toml(out, "")
    with_nats = replace(table, features={**table.features, "log_nats": table.features["evidence"]})
    fitted = fit_calibration(with_nats, FEATURES, {})
    write_names(with_nats, fitted, out, {"seed": 4})
    after = read_toml(out, "")
    assert after["origin"]["seed"] == 4
    assert set(after["feature"]) == set(FEATURES)
    changed = {name for name in before if before[name] != after[name]}
    assert changed <= {"intercept", "ridge", "feature", "origin", "held_out", "ridges", "even_nats"}
    assert read_odds(after).probability({"evidence": 3.0, "nothing": 0.0}) > 0.5


def misses_of(count: int, left: float, seed: int) -> list[Miss]:
    """Estimates of size 1 that are off by twice what their intervals say, and by a fifth of what is left."""
    rng = np.random.default_rng(seed)
    deviation = rng.uniform(0.01, 0.05, count)
    errors = np.hypot(2.0 * deviation, 0.2 * left) * np.abs(rng.standard_normal(count))
    return [
        Miss("stiffness_Nm_rad", float(error), 1.96 * float(one), 1.0, f"arm_{k % 8}", left)
        for k, (error, one) in enumerate(zip(errors, deviation, strict=True))
    ]


def test_intervals_are_as_wide_as_errors_ask_for() -> None:
    """Law: those that say half are doubled, and what a smooth function still finds beside a law widens them."""
    clean, open_ones = misses_of(400, 0.0, 1), misses_of(400, 1.0, 2)
    widths = fit_widths([*clean, *open_ones])
    assert widths is not None
    assert 0.92 < widths.coverage < 0.98
    for some, least in ((clean, 0.90), (open_ones, 0.90)):
        held = np.mean([miss.error <= widths.half_width(miss) for miss in some])
        assert held > least
    narrow = np.median([widths.half_width(miss) for miss in clean])
    wide = np.median([widths.half_width(miss) for miss in open_ones])
    assert wide > 2.5 * narrow


def test_evidence_of_few_samples_is_believed_less() -> None:
    """Law: the exponent grows with the samples where long recordings decide between rivals rightly."""
    rng = np.random.default_rng(4)
    every = []
    for log_rows in np.repeat([np.log(100.0), np.log(10_000.0)], 200):
        believed = 0.05 if log_rows > 6.0 else 0.01
        deficits = np.array([0.0, 20.0, 40.0])
        share = np.exp(-believed * deficits)
        true = deficits[rng.choice(3, p=share / share.sum())]
        every.append(Choice(float(true), deficits, float(log_rows)))
    temper = fit_growing_temper(every)
    assert temper.growth > 0.1
    assert temper.at(np.log(10_000.0)) > 2.0 * temper.at(np.log(100.0))


def test_too_little_is_refused(tmp_path: Path) -> None:
    entries = make_corpus(tmp_path / "results", 6, seed=1)
    store(entries, tmp_path / "results", tmp_path / "table")
    with pytest.raises(InputError, match="diagnose more"):
        fit_calibration(load_table(tmp_path / "table"), FEATURES, {})


def write_other(folder: Path, sessions: int, arms: tuple[str, ...]) -> None:
    """A corpus of another simulator's sessions, all of them diagnosed."""
    rng = np.random.default_rng(0)
    for arm in arms:
        answers: dict[str, object] = {}
        for number in range(sessions // len(arms)):
            evidence = float(rng.normal(1.0, 1.0))
            right = rng.random() < 1.0 / (1.0 + np.exp(-(SLOPE * evidence + BASE)))
            hidden = "joint_1" if right else "joint_2"
            effect = {"effect": "spring_torque", "joint": hidden, "size": 1.0, "visible": 3.0}
            name = f"session_{number:03d}"
            answers[name] = {"kind": "single", "effects": [effect]}
            features = {**dict.fromkeys(read_signs(SIGNS), 0.0), "log_nats": evidence}
            row = candidate("spring_torque", "joint_1", features=features)
            # What is left at the joint of a cause that has no name is larger.
            left = {joint: 2.0 * (joint == hidden and not right) for joint in ("joint_1", "joint_2")}
            words = sorted({*GAP_FEATURES, *COMPARED})
            joints = [
                {"joint": joint, "features": {word: float(rng.normal(size)) for word in words}}
                for joint, size in left.items()
            ]
            write_result(folder / "results", f"other/{arm}_{name}", row, joints=joints)
        home = folder / "other" / arm
        home.mkdir(parents=True)
        (home / "answers.json").write_text(json.dumps(answers), encoding="utf-8")


def test_a_corpus_is_scored_as_reported_and_then_by_its_calibration(tmp_path: Path) -> None:
    """Nothing was reported, so nothing is named; a calibration names what is likely."""
    write_other(tmp_path, 80, ("first", "second"))
    options = BlindOptions(cases=1, out=tmp_path)
    nothing = (lambda line: None), (lambda words, done, total: None)
    before = check_corpus(tmp_path, None, options, *nothing)
    assert before.record["other"]["single 3x class"]["value"] == 0.0
    calibration = calibrate_corpus(tmp_path, seed=0)
    assert calibration.record["feature"]["log_nats"]["weight"] > 0.0
    after = check_corpus(tmp_path, None, options, *nothing)
    assert after.record["other"]["single 3x class"]["value"] > 0.2
    assert json.loads((tmp_path / "score.json").read_text(encoding="utf-8")) == after.record
    assert "80 sessions" in after.summary()


def test_a_corpus_without_sessions_is_told(tmp_path: Path) -> None:
    options = BlindOptions(cases=1, out=tmp_path)
    nothing = (lambda line: None), (lambda words, done, total: None)
    with pytest.raises(InputError, match="no session"):
        check_corpus(tmp_path, None, options, *nothing)


def test_one_arm_alone_can_not_be_left_out(tmp_path: Path) -> None:
    write_other(tmp_path, 80, ("first",))
    options = BlindOptions(cases=1, out=tmp_path)
    check_corpus(tmp_path, None, options, lambda line: None, lambda words, done, total: None)
    with pytest.raises(InputError, match="one arm"):
        calibrate_corpus(tmp_path, seed=0)
