"""The loop that closes a gap: what it ends on, what it asks for, and how an arm behind a command is read."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ident.closed_loop import loop
from ident.closed_loop.loop import KIND_OF, MARGIN, open_kinds, pool_runs
from ident.closed_loop.recorder import CommandRecorder, draw_effects
from ident.effects.effect_info import SHOWINGS
from ident.errors import InputError
from ident.motion.filter import FOR_DIAGNOSIS
from ident.motion.motion import prepare
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.simulation.causes import ALIKE, EVENTS
from ident.trajectories.files import read_commands, write_commands
from ident.trajectories.kinds import KINDS
from ident.trajectories.reference import ReferenceMotion, via_spline
from tests.ident.export.diagnoses import COULOMB, ROTOR, VISCOUS, baseline
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


class Anything:
    """Motions that nobody looks at."""

    def choose(self, record: Mapping[str, Any] | None, number: int) -> Sequence[ReferenceMotion]:
        return ()


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


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def taught(monkeypatch: pytest.MonkeyPatch, arm: ArmModel, shares: Sequence[float]) -> list[int]:
    """Replaces the diagnosis by one that knows more from time to time; the numbers of sessions it was shown."""
    shown: list[int] = []

    def diagnose(sessions: Sequence[Session], *_: object) -> tuple[dict[str, Any], tuple[Any, ...]]:
        shown.append(len(sessions))
        return written_record(arm, shares[len(shown) - 1]), tuple(prepare(sessions[0], FOR_DIAGNOSIS.cutoff_hz))

    monkeypatch.setattr(loop, "_diagnose", diagnose)
    return shown


@pytest.mark.parametrize("shares", [[1.0], [0.5, 0.8, 1.0]])
def test_a_model_that_is_right_is_closed_once_it_was_checked(
    monkeypatch: pytest.MonkeyPatch, arm: ArmModel, shares: list[float]
) -> None:
    """One round teaches, the next one checks; a model that is wrong is taught again with all recordings."""
    shown = taught(monkeypatch, arm, shares)
    found = loop.close_gap(arm, MadeUpArm(arm), Anything())
    assert found.closed
    assert shown == [k + 1 for k in range(len(shares))]
    assert len(found.rounds) == len(shares) + 1
    gaps = [one.gap_upper for one in found.rounds if one.gap_upper is not None]
    assert gaps == sorted(gaps, reverse=True)
    assert found.after.upper <= MARGIN < found.before.together
    assert found.minutes == pytest.approx(len(found.rounds) * 6 * (8.0 - 1 / 125) / 60)


def test_what_never_gets_right_is_never_told_to_be_closed(monkeypatch: pytest.MonkeyPatch, arm: ArmModel) -> None:
    for most, rounds, reason in ((3, 3, "rounds spent"), (8, 2 + loop.STALLED_MODELS, "no nearer with more")):
        taught(monkeypatch, arm, [0.7] * 8)
        found = loop.close_gap(arm, MadeUpArm(arm), Anything(), most=most)
        assert not found.closed
        assert len(found.rounds) == rounds
        assert reason in found.reason
    with pytest.raises(InputError, match="give 2 or more"):
        loop.close_gap(arm, MadeUpArm(arm), Anything(), most=1)


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


def test_clocks_that_go_on_are_one_session_and_clocks_that_restart_are_not(arm: ArmModel) -> None:
    one, other = MadeUpArm(arm), MadeUpArm(arm)
    going_on = [one.record(()), one.record(())]
    assert [len(joined.runs) for joined in loop.join_sessions(going_on)] == [12]
    assert len(loop.join_sessions([going_on[0], other.record(())])) == 2


def test_an_arm_behind_a_command_gets_files_and_gives_a_session(tmp_path: Path, arm: ArmModel) -> None:
    """Each round in folders of its own; a command that fails, or leaves nothing, is told as what it is."""
    script = tmp_path / "robot.py"
    script.write_text(
        "import sys, pathlib\n"
        "for path in sorted(pathlib.Path(sys.argv[1]).glob('*.csv')):\n"
        "    text = path.read_text().replace('position_command', 'position').replace('velocity_command', 'effort')\n"
        "    (pathlib.Path(sys.argv[2]) / path.name).write_text(text)\n"
    )
    motion = via_spline("spline", np.array([[0.0, 0.1], [0.4, -0.3]]), 1.0)
    (back,) = read_commands(write_commands([motion], arm.joint_names, tmp_path / "commands")[0], arm)
    assert back.name == "spline"
    np.testing.assert_allclose(back.q, motion.q[: len(back.q)], atol=2e-6)
    recorder = CommandRecorder(f"{sys.executable} {script} {{commands}} {{session}}", tmp_path / "rounds", arm)
    for number in (1, 2):
        session = recorder.record([motion, motion])
        assert len(session.runs) == 2
        assert session.path == tmp_path / "rounds" / f"round_{number}" / "session"
        np.testing.assert_allclose(session.runs[0].position[0], motion.q[0], atol=1e-7)
    with pytest.raises(InputError, match=r"has no \{session\}"):
        CommandRecorder("robot {commands}", tmp_path, arm)
    with pytest.raises(InputError, match="exit status 1 in round 1"):
        CommandRecorder("false {commands} {session}", tmp_path / "fails", arm).record([motion])
    with pytest.raises(InputError, match="no recording"):
        CommandRecorder("true {commands} {session}", tmp_path / "empty", arm).record([motion])


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
