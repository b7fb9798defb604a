"""Motions that are proposed: within limits, distinguished from chance, and how far apart they bring two effects."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pacsv
import pytest
from typer.testing import CliRunner

from ident.arrays import Array, Float
from ident.effects.catalogue import find_effect
from ident.errors import InputError, RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.files import read_commands
from ident.trajectories.kinds import plan_motions
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion, sampled
from plan.cli.app import app
from plan.command_options import ExciteOptions
from plan.experiment.design import LEAST_RUNS, Designer
from plan.experiment.distance import Predictor
from plan.experiment.feasible import Feasibility, surroundings_of
from plan.experiment.hypotheses import AllGains, AllMasses, ask
from plan.experiment.result import minutes_to_odds, odds_of
from plan.experiment.run_set import FAMILIES, RunSet
from tests.schemas import check_file

PAIRS = (
    ("stribeck_friction,presliding_hysteresis", 9),
    pytest.param("joint_elasticity,torque_delay", 16, marks=pytest.mark.slow),
    pytest.param("stribeck_friction,nonlinear_viscous_friction", 32, marks=pytest.mark.slow),
    pytest.param("load_dependent_friction,position_dependent_friction", 16, marks=pytest.mark.slow),
    pytest.param("spring_torque,gravity_misalignment", 16, marks=pytest.mark.slow),
)
SCENE = """[[obstacle]]
name = "post"
size_m = [0.1, 0.1, 1.0]
xyz_m = [0.5, 0, 0.5]
[limits]
lower_deg = [-90, -60, -120, -90, -90, -90]
upper_deg = [90, 60, 120, 90, 90, 90]
speed_deg_s = [20, 20, 20, 20, 20, 20]
"""


@pytest.mark.parametrize("family", FAMILIES)
def test_runs_keep_limits_and_distance(feasible: Feasibility, family: str) -> None:
    """Limits of position, speed and torque hold, no link comes near another, runs start and end at home and at rest.

    Whichever run the diagnosis leaves out, the rest speak of every joint.
    """
    shares = np.random.default_rng(3).uniform(0.0, 1.0, RunSet.freedom(family, 3))
    run_set = RunSet.decode(family, shares, 1, feasible.limits, 0)
    runs = run_set.runs(LEAST_RUNS, feasible)
    assert len(runs) == LEAST_RUNS
    for run in runs:
        assert MotionLimits(feasible.limits.arm).stays_within(run)
        assert feasible.clearance(run) > 0.0
        assert run.q[[0, -1]] == pytest.approx(np.stack([run_set.home] * 2), abs=1e-6)
        assert np.all(run.dq[[0, -1]] == 0.0)
        # Speeds and accelerations are those of the positions.
        assert np.diff(run.q, axis=0) / TICK_S == pytest.approx(0.5 * (run.dq[1:] + run.dq[:-1]), abs=0.02)
    middle = RunSet.decode(family, np.full(len(shares), 0.5), 1, feasible.limits, 0).runs(LEAST_RUNS, feasible)
    moved = np.array([np.ptp(run.q, axis=0) > 0.2 for run in middle])
    assert np.all(moved.sum(axis=0) >= 2)


def slow_move(start: Float[Array, " n"], goal: Float[Array, " n"]) -> ReferenceMotion:
    """From rest to rest on a straight line in 20 s."""
    s = np.linspace(0.0, 1.0, 20001)[:, None]
    return sampled("move", start + (goal - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def test_a_folded_arm_is_refused(whole: ArmModel) -> None:
    """Slow motion within all limits is refused where it folds the arm into itself; where it does not, it is allowed."""
    feasible = Feasibility(whole)
    limits = feasible.limits
    poses = np.random.default_rng(0).uniform(limits.lower, limits.upper, (200, 6))
    distances = [feasible.scene.proximity.distances(pose).min() for pose in poses]
    folded, free = (slow_move(limits.centre, poses[pick(distances)]) for pick in (np.argmin, np.argmax))
    assert min(distances) < 0.0
    assert limits.first_pace(folded) == 1.0
    assert not feasible.allows(folded)
    assert feasible.clearance(folded) == 0.0
    short = slow_move(limits.centre, limits.centre + 0.02)
    assert feasible.allows(short)
    assert feasible.clearance(short) > 0.0
    # What is proven is no more than what a close look finds.
    assert feasible.clearance(free) <= max(0.0, min(feasible.scene.distances(q).min() for q in free.q[::200]))


def test_nothing_goes_below_the_base_plane_unless_told(whole: ArmModel) -> None:
    """A motion that dips under the base plane is allowed without a floor, and refused by default."""
    above, below = np.radians([0.0, 20.0, 30.0, 0.0, 0.0, 0.0]), np.radians([0.0, 100.0, 10.0, 0.0, 0.0, 0.0])
    dip = slow_move(above, below)
    free, floored = (
        Feasibility(whole, around=surroundings_of(whole, options))
        for options in (ExciteOptions(floor="none"), ExciteOptions())
    )
    assert free.allows(dip)
    assert free.clearance(dip) > 0.0
    assert not floored.allows(dip)
    assert floored.clearance(dip) == 0.0
    assert floored.clearance(slow_move(above, above + 0.01)) > 0.0
    assert "floor" in {box.name for box in floored.scene.obstacles}


def test_two_shapes_that_are_never_apart_are_named_before_the_search(whole: ArmModel) -> None:
    """Law: where no position keeps two shapes apart no motion does, and which two they are is said at once."""
    Feasibility(whole, around=surroundings_of(whole, ExciteOptions())).require_room()
    flooded = Feasibility(whole, around=surroundings_of(whole, ExciteOptions(floor="2.0")))
    with pytest.raises(RobotError, match=r"and floor overlap by \d+ mm at best.*lower the floor"):
        flooded.require_room()


def test_a_scene_narrows_what_is_allowed(whole: ArmModel, tmp_path: Path) -> None:
    """Obstacles, joint limits and top speed of a scene file are kept; the option's top speed as well."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    found, open_ = (
        Feasibility(whole, around=surroundings_of(whole, options))
        for options in (ExciteOptions(scene=path, top_speed=10.0), ExciteOptions())
    )
    assert np.degrees(found.limits.upper) == pytest.approx([90, 60, 120, 90, 90, 90])
    assert np.degrees(found.limits.speed) == pytest.approx(10.0)
    side, front = (np.radians([angle, 30.0, 60.0, 0.0, 0.0, 0.0]) for angle in (-80.0, 80.0))
    assert found.scene.distances(side).min() > 0.01
    assert found.clearance(slow_move(side, front)) == 0.0
    assert open_.clearance(slow_move(side, front)) > 0.0


def test_a_top_speed_of_angles_says_nothing_of_slides() -> None:
    """Law: --top-speed is in degrees, so a joint that slides keeps the speed that its URDF gives."""
    arm = ArmModel.load("scara")
    speed = surroundings_of(arm, ExciteOptions(top_speed=90.0)).speed
    assert arm.sliding_joints.any()
    assert np.array_equal(speed, np.where(arm.sliding_joints, np.inf, np.pi / 2))


@pytest.mark.parametrize(
    ("text", "floor", "words"),
    [
        ('robot = "ur10"\n', "0", "give its --robot"),
        ("[limits]\nlower_deg = [9, 0, 0, 0, 0, 0]\nupper_deg = [1, 1, 1, 1, 1, 1]", "0", "is not below"),
        ("[limits]\nlower_deg = [1, 2]\n", "0", "has 2 numbers, not 6"),
        ("[floor]\nheight_m = 99\nhigh = 1\n", "0", "unknown key 'high'"),
        ("", "low", "is no height"),
        ("", "nan", "is no height"),
    ],
)
def test_bad_surroundings(whole: ArmModel, tmp_path: Path, text: str, floor: str, words: str) -> None:
    """Another robot's scene, limits that contradict each other, and floors that are none."""
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(InputError, match=words):
        surroundings_of(whole, ExciteOptions(scene=tmp_path / "scene.toml", floor=floor))


@pytest.mark.parametrize(("pair", "evaluations"), PAIRS)
def test_proposed_motion_beats_chance(arm: ArmModel, pair: str, evaluations: int) -> None:
    """Even a short search finds motion that tells a tied pair apart better than random motion of equal length."""
    asked = ask(arm, pair, "joint_2", None)
    found = Designer(arm, asked, ExciteOptions(minutes=0.5, evaluations=evaluations)).best()
    assert found.status == "ready"
    proposed, by_chance = found.smallest
    assert proposed > by_chance
    assert found.clearance > 0.0


STRIBECK, VISCOUS = (find_effect("stribeck_friction"), 1), (find_effect("nonlinear_viscous_friction"), 1)
Runs = list[ReferenceMotion]


@pytest.fixture(scope="module")
def random_runs(predictor: Predictor) -> Runs:
    return list(plan_motions(predictor.arm, ("spline",), 4, 8.0, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def runs_of(feasible: Feasibility) -> Callable[[str], Runs]:
    """Two runs of a family, its figures in the middle of their ranges."""

    def make(family: str) -> Runs:
        shares = np.full(RunSet.freedom(family, feasible.limits.arm.n), 0.5)
        return RunSet.decode(family, shares, 1, feasible.limits, 0).runs(2, feasible)

    return make


def test_a_rival_takes_something_away_and_a_model_all_of_itself(predictor: Predictor, random_runs: Runs) -> None:
    """Nothing is farther from a rival than from the baseline, which is a part of it; nor is it told from itself."""
    view = predictor.look(random_runs, [STRIBECK, VISCOUS, STRIBECK])
    assert view.distance(0, None) > 1.0
    assert 0.0 < view.distance(0, 1) < view.distance(0, None)
    assert view.distance(0, 2) < 1e-5 * view.distance(0, None)


def test_distance_grows_with_duration_and_falls_with_noise(predictor: Predictor, random_runs: Runs) -> None:
    """Four times the motion, or half the noise, tells four times as much; the URDF's word is given once."""
    loud = Predictor(predictor.arm, predictor.baseline, 2.0 * predictor.noise)
    cases = (predictor, random_runs), (predictor, random_runs * 4), (loud, random_runs)
    once, longer, louder = (one.look(runs, [STRIBECK, VISCOUS]).distance(0, 1) for one, runs in cases)
    assert longer == pytest.approx(4.0 * once, rel=0.05)
    assert louder == pytest.approx(once / 4.0, rel=0.05)


def test_sizes_follow_the_diagnosis(predictor: Predictor, random_runs: Runs) -> None:
    """An effect found twice as large is four times as far from its rival; a stiffer joint is nearer."""

    def distance(effect: str, figure: str, value: float) -> float:
        view = predictor.look(random_runs, [(find_effect(effect), 1), VISCOUS], {effect: {figure: value}})
        return view.distance(0, 1)

    small, large = (distance("stribeck_friction", "amplitude_Nm", value) for value in (2.0, 4.0))
    assert large == pytest.approx(4.0 * small, rel=1e-6)
    soft, stiff = (distance("joint_elasticity", "stiffness_Nm_rad", value) for value in (6e3, 12e3))
    assert stiff == pytest.approx(soft / 4.0, rel=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_exact_twins_stay_together(predictor: Predictor, runs_of: Callable[[str], Runs], family: str) -> None:
    """Gains and masses that are all too large by one share are the same log, whatever the arm does."""
    view = predictor.look(runs_of(family), [(AllGains(), 0), (AllMasses(), 0)])
    assert view.distance(0, None) > 0.1
    assert view.distance(0, 1) < 1e-5 * view.distance(0, None)
    assert view.distance(1, 0) < 1e-5 * view.distance(1, None)


def test_odds_and_minutes_agree() -> None:
    """At the minutes that 20 : 1 take, the odds are 20 : 1; without a distance they never are."""
    minutes = minutes_to_odds(5.0, 60.0)
    assert odds_of(5.0 * minutes) == pytest.approx(20.0)
    assert minutes_to_odds(0.0, 60.0) is None


JOINTS = [f"joint_{k}" for k in range(1, 7)]


def diagnosis(path: Path, **changes: Any) -> Path:
    """A diagnosis in which Stribeck friction of joint 3 is tied to hysteresis."""
    tied = {
        "effect": "stribeck_friction",
        "joints": ["joint_3"],
        "class": ["stribeck_friction", "presliding_hysteresis"],
        "parameters": {
            "amplitude_Nm": {"value": 4.0, "low": 3.0, "high": 5.0},
            "stribeck_velocity_rad_s": {"value": 0.03, "low": 0.02, "high": 0.04},
        },
    }
    record = {
        "schema": "ident.diagnosis/1",
        "joints": JOINTS,
        "gap": {name: {"noise_floor_Nm": 0.4} for name in JOINTS},
        "findings": [tied],
        "not_testable": [],
    }
    path.write_text(json.dumps({**record, **changes}))
    return path


@pytest.mark.slow
def test_writes_a_motion_that_the_simulated_arm_reads(tmp_path: Path, whole: ArmModel) -> None:
    """One command: a folder of command files and a record that agree with each other."""
    out, record_file = tmp_path / "motion", tmp_path / "excite.json"
    pair = "stribeck_friction,presliding_hysteresis"
    arguments = ["excite", "--separate", pair, "--joint", "2", "--minutes", "0.3"]
    outcome = CliRunner().invoke(app, [*arguments, "--evaluations", "8", "--out", str(out), "--json", str(record_file)])
    assert outcome.exit_code == 0, outcome.output
    assert "tells stribeck_friction and presliding_hysteresis apart" in outcome.output
    record = json.loads(record_file.read_text())
    assert record["schema"] == "plan.excite/1"
    assert record == json.loads((out / "excite.json").read_text())
    assert record["separates"] == ["stribeck_friction", "presliding_hysteresis"]
    assert record["joint"] == "joint_2"
    assert set(record["distance"]["proposed"]) == {
        "stribeck_friction against presliding_hysteresis",
        "presliding_hysteresis against stribeck_friction",
    }
    assert record["minutes_to_20_to_1"] > 0.0
    assert record["motion"]["clearance_m"] > 0.0
    motions = read_commands(out, whole)
    assert len(motions) == record["motion"]["runs"] == len(record["motion"]["files"])
    assert sum(motion.duration for motion in motions) == pytest.approx(60.0 * record["motion"]["minutes"], abs=0.1)
    table = pacsv.read_csv(out / record["motion"]["files"][0])
    assert table.column_names[:3] == ["time", "joint_1/position_command", "joint_1/velocity_command"]


def test_exact_twins_need_another_set_up(tmp_path: Path) -> None:
    """No search for what no motion can do: the advice, and motion to be recorded before and after."""
    arguments = ["excite", "--separate", "torque_gain_error,all_masses", "--minutes", "0.3"]
    outcome = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "excite.json")])
    assert outcome.exit_code == 0, outcome.output
    assert "no motion tells" in outcome.output
    assert "[payload] in session.toml" in outcome.output  # no brackets lost to the console's markup
    record = check_file(tmp_path / "excite.json")
    assert record["status"] == "needs_set_up"
    assert "known mass" in record["set_up"]
    assert record["motion"]["runs"] > 0


def test_the_diagnosis_asks_its_own_question(tmp_path: Path, whole: ArmModel) -> None:
    """Its first tied class, at its joint, with its sizes and its noise."""
    asked = ask(whole, None, None, diagnosis(tmp_path / "d.json"))
    assert (asked.aim, asked.ids, asked.joint) == ("separate", ("stribeck_friction", "presliding_hysteresis"), 2)
    assert asked.reported["stribeck_friction"]["amplitude_Nm"] == 4.0
    assert asked.noise.tolist() == [0.4] * 6


def test_what_could_not_be_tested_is_shown(tmp_path: Path, whole: ArmModel) -> None:
    """Without a tied class: the effects that one kind of motion shows, at the joint that lacks it."""
    unseen = [
        {"effect": name, "joints": ["joint_5"], "reason": "still"} for name in ("torque_delay", "joint_elasticity")
    ]
    asked = ask(whole, None, None, diagnosis(tmp_path / "d.json", findings=[], not_testable=unseen))
    assert (asked.aim, asked.ids, asked.joint) == ("show", ("torque_delay", "joint_elasticity"), 4)
    assert asked.family == "chirp"


def test_without_a_question_the_inertias_are_asked_for(whole: ArmModel) -> None:
    """The general motion: no effects, a Fourier series, the joint that carries most."""
    asked = ask(whole, None, None, None)
    assert (asked.aim, asked.ids, asked.family, asked.joint) == ("identify", (), "fourier", 1)


def test_what_is_proposed_tells_no_less_than_the_textbooks_series(arm: ArmModel) -> None:
    """Law: an unoptimised Fourier series is among what must be beaten, and is told beside the proposal."""
    options = ExciteOptions(minutes=0.6, evaluations=len(FAMILIES))
    found = Designer(arm, ask(arm, None, None, None), options).best()
    assert found.against_textbook is not None
    told, ratio = found.against_textbook
    assert found.information[0] >= 0.98 * told
    assert 0.0 < ratio < np.inf
    assert found.to_dict()["information_nats"]["textbook"] == told


@pytest.mark.parametrize(
    ("separate", "joint", "words"),
    [
        ("stribek_friction,torque_delay", None, "there is no effect 'stribek_friction'"),
        ("torque_delay,torque_offset", "joint_9", "no joint 'joint_9'"),
        ("torque_delay,torque_offset", "0", "no joint '0'"),
    ],
)
def test_wrong_options_are_refused(whole: ArmModel, separate: str, joint: str | None, words: str) -> None:
    """One line that names what is wrong and what there is."""
    with pytest.raises(InputError, match=words):
        ask(whole, separate, joint, None)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": "ident.fit/1"}, "is no ident.diagnosis/1"),
        ({"joints": ["elbow"]}, "elbow"),
        ({"robot": "other"}, "it is of 'other', the robot is"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, whole: ArmModel, changes: dict[str, Any], words: str) -> None:
    """A file of something else, or of another arm though its joints have the same names, is the user's mistake."""
    with pytest.raises(InputError, match=words):
        ask(whole, None, None, diagnosis(tmp_path / "d.json", **changes))


def test_a_foreign_folder_is_not_replaced(tmp_path: Path) -> None:
    """A folder that holds anything else stays."""
    (tmp_path / "thesis.tex").write_text("years")
    outcome = CliRunner().invoke(app, ["excite", "--out", str(tmp_path)])
    assert isinstance(outcome.exception, InputError)
    assert (tmp_path / "thesis.tex").read_text() == "years"
