"""The loop that closes a gap: on an arm that is simulated here, on one behind a command, on a joint that warms."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ident.arrays import Array
from ident.closed_loop import loop
from ident.closed_loop.loop import KIND_OF, MARGIN, PlannedRun, follow_warmth, heat_along, open_kinds, pool_runs
from ident.closed_loop.recorder import CommandRecorder, draw_effects
from ident.closed_loop.result import TRACKED, Closing, put_on_a_clock
from ident.effects.catalogue import find_effect
from ident.effects.effect_info import SHOWINGS
from ident.errors import InputError
from ident.export.loaded import LawModel
from ident.laws.motion import Losses
from ident.model.carried import describe_arm
from ident.motion.motion import prepare
from ident.motion.settings import FOR_DIAGNOSIS
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.simulation.causes import ALIKE, EVENTS
from ident.trajectories.files import read_commands, write_commands
from ident.trajectories.kinds import KINDS
from ident.trajectories.reference import ReferenceMotion, via_spline
from tests.ident.effects.smooth_motion import make_session
from tests.ident.export.diagnoses import COULOMB, FIGURES, ROTOR, VISCOUS, baseline, finding
from tests.ident.made_up import made_session, two_joint_arm
from tests.schemas import check_file

NOISE = 0.3
# What the filter of torques lets through of white noise: cutoff over half of the rate.
LEFT = NOISE * np.sqrt(FOR_DIAGNOSIS.cutoff_hz / (125.0 / 2.0))


class MadeUpArm:
    """Two joints with known losses: rigid, viscous, Coulomb, rotor."""

    def __init__(self, arm: ArmModel) -> None:
        self.arm, self.clock, self.rounds = arm, 0.0, 0

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        self.rounds += 1
        rng = np.random.default_rng(self.rounds)

        def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
            losses = ROTOR[:2] * ddq + VISCOUS[:2] * dq + COULOMB[:2] * np.tanh(dq / 0.01)
            return self.arm.inverse_dynamics(q, dq, ddq) + losses + NOISE * rng.standard_normal(q.shape)

        session = made_session(self.arm, law, range(10 * self.rounds, 10 * self.rounds + 6))
        runs = tuple(run.replace(time=run.time + self.clock) for run in session.runs)
        self.clock = float(runs[-1].time[-1]) + 60.0
        return session.replace(runs=runs)


def written_record(arm: ArmModel, share: float) -> dict[str, Any]:
    """A diagnosis without findings that knows so much of the losses."""
    losses = baseline(arm)
    for one in losses.values():
        for key in ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm"):
            one[key] *= share
    return {
        "joints": list(arm.joint_names),
        "verdict": "no_gap",
        "findings": [],
        "gap": {name: {"noise_floor_Nm": LEFT} for name in arm.joint_names},
        "baseline": losses,
        "baseline_alone": losses,
        "baseline_urdf": losses,
    }


def taught(monkeypatch: pytest.MonkeyPatch, arm: ArmModel, shares: Sequence[float]) -> list[int]:
    """Replaces the diagnosis by one that knows more from time to time; the numbers of sessions it was shown."""
    shown: list[int] = []

    def diagnose(sessions: Sequence[Session], *_: object) -> tuple[dict[str, Any], tuple[Any, ...]]:
        shown.append(len(sessions))
        return written_record(arm, shares[len(shown) - 1]), tuple(prepare(sessions[0], FOR_DIAGNOSIS.cutoff_hz))

    monkeypatch.setattr(loop, "_diagnose", diagnose)
    monkeypatch.setattr(loop, "choose_motions", lambda *_: ())
    return shown


@pytest.mark.parametrize("shares", [[1.0], [0.5, 0.8, 1.0]])
def test_a_model_that_is_right_is_closed_once_it_was_checked(
    monkeypatch: pytest.MonkeyPatch, two_joints: ArmModel, shares: list[float]
) -> None:
    """One round teaches, the next one checks; a model that is wrong is taught again with all recordings."""
    shown = taught(monkeypatch, two_joints, shares)
    found = loop.close_gap(two_joints, MadeUpArm(two_joints), 0)
    assert found.closed
    assert shown == [k + 1 for k in range(len(shares))]
    assert len(found.rounds) == len(shares) + 1
    gaps = [one.gap_upper for one in found.rounds if one.gap_upper is not None]
    assert gaps == sorted(gaps, reverse=True)
    assert found.after.upper <= MARGIN < found.before.together
    assert found.minutes == pytest.approx(len(found.rounds) * 6 * (8.0 - 1 / 125) / 60)


def test_what_never_gets_right_is_never_told_to_be_closed(
    monkeypatch: pytest.MonkeyPatch, two_joints: ArmModel
) -> None:
    for most, rounds, reason in ((3, 3, "rounds spent"), (8, 2 + loop.STALLED_MODELS, "no nearer with more")):
        taught(monkeypatch, two_joints, [0.7] * 8)
        found = loop.close_gap(two_joints, MadeUpArm(two_joints), 0, most=most)
        assert not found.closed
        assert len(found.rounds) == rounds
        assert reason in found.reason
    with pytest.raises(InputError, match="give 2 or more"):
        loop.close_gap(two_joints, MadeUpArm(two_joints), 0, most=1)


JOINTS = ("joint_1", "joint_2")


def test_few_runs_that_differ_make_nothing_sure() -> None:
    """The mean may be small; what counts is how far it may be off."""
    counts = np.full((4, 2), 100.0)
    even = pool_runs(counts * 0.9, counts, JOINTS)
    uneven = pool_runs(counts * np.array([[0.1], [0.1], [1.7], [1.7]]), counts, JOINTS)
    assert even.together == pytest.approx(uneven.together) == pytest.approx(np.sqrt(0.9))
    assert even.upper == pytest.approx(even.together)
    assert uneven.upper > MARGIN
    assert pool_runs(counts[:1], counts[:1], JOINTS).upper == np.inf


def test_every_family_of_motion_has_a_kind_and_open_questions_come_first() -> None:
    assert set(KIND_OF) == set(SHOWINGS)
    assert set(KIND_OF.values()) <= set(KINDS)
    tied = {"findings": [{"effect": "stribeck_friction", "class": ["stribeck_friction", "presliding_hysteresis"]}]}
    unseen = {"findings": [], "not_testable": [{"effect": "torque_delay"}]}
    assert open_kinds(tied)[0] in ("ladder", "sweep")
    assert open_kinds(unseen)[0] == "chirp"
    assert len(open_kinds({})) == 3


def test_drawn_effects_can_be_told_from_each_other() -> None:
    for seed in range(200):
        drawn = {one.effect for one in draw_effects(("a", "b"), 3, np.random.default_rng(seed))}
        assert len(drawn) == 3
        assert not drawn & EVENTS
        assert all(len(drawn & twins) < 2 for twins in ALIKE)


def test_clocks_that_go_on_are_one_session_and_clocks_that_restart_are_not(two_joints: ArmModel) -> None:
    one, other = MadeUpArm(two_joints), MadeUpArm(two_joints)
    going_on = [one.record(()), one.record(())]
    assert [len(joined.runs) for joined in loop.join_sessions(going_on)] == [12]
    assert len(loop.join_sessions([going_on[0], other.record(())])) == 2


def test_an_arm_behind_a_command_gets_files_and_gives_a_session(tmp_path: Path, two_joints: ArmModel) -> None:
    """Each round in folders of its own; a command that fails, or leaves nothing, is told as what it is."""
    script = tmp_path / "robot.py"
    script.write_text(
        "import sys, pathlib\n"
        "for path in sorted(pathlib.Path(sys.argv[1]).glob('*.csv')):\n"
        "    text = path.read_text().replace('position_command', 'position').replace('velocity_command', 'effort')\n"
        "    (pathlib.Path(sys.argv[2]) / path.name).write_text(text)\n"
    )
    motion = via_spline("spline", np.array([[0.0, 0.1], [0.4, -0.3]]), 1.0)
    (back,) = read_commands(write_commands([motion], two_joints.joint_names, tmp_path / "commands")[0], two_joints)
    assert back.name == "spline"
    np.testing.assert_allclose(back.q, motion.q[: len(back.q)], atol=2e-6)
    recorder = CommandRecorder(f"{sys.executable} {script} {{commands}} {{session}}", tmp_path / "rounds", two_joints)
    for number in (1, 2):
        session = recorder.record([motion, motion])
        assert len(session.runs) == 2
        assert session.path == tmp_path / "rounds" / f"round_{number}" / "session"
        np.testing.assert_allclose(session.runs[0].position[0], motion.q[0], atol=1e-7)
    with pytest.raises(InputError, match=r"has no \{session\}"):
        CommandRecorder("robot {commands}", tmp_path, two_joints)
    with pytest.raises(InputError, match="exit status 1 in round 1"):
        CommandRecorder("false {commands} {session}", tmp_path / "fails", two_joints).record([motion])
    with pytest.raises(InputError, match="no recording"):
        CommandRecorder("true {commands} {session}", tmp_path / "empty", two_joints).record([motion])


@pytest.mark.slow
def test_an_arm_with_a_payload_is_closed_from_the_command_line(tmp_path: Path) -> None:
    """The whole loop on the simulated arm; its record holds to its schema, its patch to the payload."""
    from typer.testing import CliRunner

    from ident.cli.app import app

    arguments = ["close", "--out", str(tmp_path / "out"), "--effect", "payload:arm:0.6", "--seed", "5", "--no-compare"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    (found,) = check_file(tmp_path / "out/close.json")["arms"]
    assert found["closed"]
    assert found["named"][0].startswith("payload")
    assert found["gap_floors_after"] <= MARGIN < found["gap_floors_before"]
    assert (tmp_path / "out/arm_00/patch/robot.urdf").is_file()


# Of the diagnosis written by hand: shares between coldest and warmest, and how long the joint keeps its heat.
LAW = FIGURES["thermal_friction"]
CONSTANT = LAW["time_constant_s"]


def warm_model(arm: ArmModel, joints: Sequence[int]) -> LawModel:
    zero = np.zeros(arm.n)
    losses = Losses(zero, VISCOUS[: arm.n], COULOMB[: arm.n], np.full(arm.n, 0.01), zero)
    return LawModel(describe_arm(arm), losses, tuple(("thermal_friction", j, LAW) for j in joints))


def test_warmth_is_that_of_the_catalogues_columns() -> None:
    arm = ArmModel.load("tm5-900")
    session = make_session(arm, seconds=8.0, runs=3)
    thermal, runs = find_effect("thermal_friction"), [run.motion for run in session.runs]
    variant = next(one for one in thermal.variants(session, 1) if one.inner["time_constant_s"] <= 60.0)
    model = warm_model(arm, [1])
    name, j, figures = model.effects[0]
    model = replace(model, effects=((name, j, {**figures, **variant.inner}),))
    followed = follow_warmth(model, runs, runs, cold=True)
    for one, run, columns in zip(followed, session.runs, thermal.columns(session, 1, variant), strict=True):
        assert isinstance(one, LawModel)
        sliding = np.abs(run.direction[:, 1]) > 0.99
        wanted = columns[sliding, 1] / run.direction[sliding, 1]
        np.testing.assert_allclose(one.warmth[sliding, 1], wanted, atol=0.02)
        assert np.all(one.warmth[:, 0] == 0.5)


def test_a_joint_goes_on_from_where_runs_left_it() -> None:
    arm = two_joint_arm()
    model, rng = warm_model(arm, [0, 1]), np.random.default_rng(1)
    dq = rng.uniform(-1.0, 1.0, (3000, 2))
    time = 0.01 * np.arange(3000)
    whole = [PlannedRun(time, dq, 0.01)]
    pieces = [PlannedRun(time[:1001], dq[:1001], 0.01), PlannedRun(time[1000:], dq[1000:], 0.01)]
    for joint in (0, 1):
        at_once, by_pieces = (heat_along(model, joint, CONSTANT, runs)[-1][-1] for runs in (whole, pieces))
        assert at_once == pytest.approx(by_pieces, rel=1e-9)
        assert at_once > 0.0
    later = [PlannedRun(1000.0 * CONSTANT + time, dq, 0.01)]
    cold = follow_warmth(model, whole, later)[0]
    assert isinstance(cold, LawModel)
    assert cold.warmth[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    motion = ReferenceMotion("there", *np.zeros((3, 501, 2)))
    first, second = put_on_a_clock([motion, motion], 60.0)
    assert (first.time[0], second.time[0] - first.time[-1]) == pytest.approx((60.0, 60.0))


def test_joints_that_warm_differently_have_each_their_own_torque() -> None:
    arm, rng = two_joint_arm(), np.random.default_rng(2)
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, 500, 2))
    runs = [PlannedRun(0.01 * np.arange(500), dq, 0.01)]

    def torque(joints: Sequence[int], *, followed: bool) -> Array:
        model = warm_model(arm, joints)
        known = follow_warmth(model, runs, runs, cold=True)[0] if followed else model
        return known.joint_torque(q, dq, ddq, 0.01)

    plain, both = torque([], followed=True), torque([0, 1], followed=True)
    apart = torque([0], followed=True) + torque([1], followed=True) - plain
    np.testing.assert_allclose(both, apart, atol=1e-9)
    assert np.abs(both - torque([0, 1], followed=False)).max() > 0.5


@dataclass
class WarmingArm:
    """Two joints, the second of which turns the more easily the warmer it is; rounds on one clock."""

    arm: ArmModel
    span: float = 1.0
    heat: float = 0.0
    warmest: float = 0.0
    clock: float = 0.0
    rounds: int = 0

    def record(self, motions: Sequence[ReferenceMotion]) -> Session:
        self.rounds += 1
        rng = np.random.default_rng(self.rounds)
        session = made_session(self.arm, lambda *states: self._torque(rng, *states), range(10, 16), duration=20.0)
        runs = tuple(run.replace(time=run.time + self.clock) for run in session.runs)
        self.clock = float(runs[-1].time[-1]) + 60.0
        self.heat *= np.exp(-59.0 / CONSTANT)
        return session.replace(runs=runs)

    def _torque(self, rng: np.random.Generator, q: Array, dq: Array, ddq: Array) -> Array:
        viscous, coulomb, rotor = (values[:2] for values in (VISCOUS, COULOMB, ROTOR))
        power = np.abs(dq[:, 1]) * (coulomb[1] + viscous[1] * np.abs(dq[:, 1]))
        heat, keep = np.zeros(len(dq)), np.exp(-1.0 / 125.0 / CONSTANT)
        heat[0] = self.heat
        for k in range(1, len(heat)):
            heat[k] = keep * heat[k - 1] + CONSTANT * (1.0 - keep) * power[k - 1]
        self.heat, self.warmest = heat[-1] * np.exp(-1.0 / CONSTANT), max(self.warmest, float(heat.max()))
        warm = heat[:, None] / self.span * np.array([0.0, 1.0])
        losses = viscous * (1.0 + LAW["viscous_change"] * warm) * dq
        losses += coulomb * (1.0 + LAW["coulomb_change"] * warm) * np.tanh(dq / 0.01)
        return self.arm.inverse_dynamics(q, dq, ddq) + losses + rotor * ddq + NOISE * rng.standard_normal(q.shape)


def test_a_joint_that_warms_is_closed_by_a_law_that_follows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = two_joint_arm()
    first = WarmingArm(arm)
    first.record(())
    record: dict[str, Any] = {
        "joints": list(arm.joint_names),
        "verdict": "named",
        "findings": [finding(arm, "thermal_friction", 1)],
        "gap": {name: {"noise_floor_Nm": LEFT} for name in arm.joint_names},
        **{key: baseline(arm) for key in ("baseline", "baseline_alone", "baseline_urdf")},
    }
    learnt: list[Any] = []

    def diagnose(sessions: Sequence[Session], *_: object) -> tuple[dict[str, Any], tuple[Any, ...]]:
        learnt[:] = prepare(sessions[0], FOR_DIAGNOSIS.cutoff_hz)
        return record, tuple(learnt)

    monkeypatch.setattr(loop, "_diagnose", diagnose)
    monkeypatch.setattr(loop, "choose_motions", lambda *_: ())
    found = loop.close_gap(arm, WarmingArm(arm, span=first.warmest), 0)
    assert found.closed
    assert len(found.rounds) == 2
    monkeypatch.setattr(loop, "follow_warmth", lambda model, learned, runs: [model] * len(runs))
    blind = loop.close_gap(arm, WarmingArm(arm, span=first.warmest), 0)
    assert not blind.closed


def test_of_several_arms_the_rivals_medians_are_told() -> None:
    one: dict[str, Any] = {"seed": 1, "closed": True, "minutes": 2.0, "rounds": 2, "gap_floors_before": 50.0}
    one |= {"gap_floors_after": 1.0, **dict.fromkeys(TRACKED, 0.004)}
    arms = tuple({**one, "heldout_floors": dict.fromkeys(TRACKED.values(), gap)} for gap in (3.0, 5.0))
    told = [line.strip() for line in Closing(arms).summary().splitlines()][-len(TRACKED) :]
    assert [line.partition(":")[0] for line in told] == list(TRACKED.values())
    assert "net: gap 4.00 (5.00) x the noise, the controller misses by 4.00 (4.00) mrad" in told
