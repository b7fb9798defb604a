"""Discrepancies beside names and without them; holds, turns and gaps as rows."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.result import Diagnosis
from ident.effects.catalogue import CATALOGUE, find_effect
from ident.effects.pushes import Leftover, screen_windows
from ident.motion.motion import Motion
from ident.regression.baseline import fit_baseline
from ident.regression.dwells import DwellRows, dwell_rows, find_holds, find_turns, join_runs, resting
from ident.regression.noise import shorter_filters, whiten_after_gaps
from ident.regression.runs import build_session, leftover_torque
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import (
    COULOMB,
    SLIP,
    VISCOUS,
    analyse,
    at_joint,
    healthy_torque,
    nothing,
    record,
    spring_on_3,
)
from tests.ident.diagnosis.planted import NOISE as NOISE_STD
from tests.ident.made_up import exact_motion, made_motions


@pytest.mark.xfail(
    strict=False,
    reason="a freed discrepancy imitates friction's memory; it is a feature of the calibration, not a gate",
)
def test_a_law_is_no_rival_of_its_own(short_arm: ArmModel) -> None:
    """Law: friction that builds up over some travel after each reversal is named, though a discrepancy may have such a
    function of the travel, too; and beside the freed discrepancy it keeps a good part of what it adds.
    """

    def building_up(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        turned = np.append(0, np.flatnonzero(np.diff(np.sign(dq[:, 1]))) + 1)
        last = turned[np.searchsorted(turned, np.arange(len(q)), side="right") - 1]
        travel = np.abs(q[:, 1] - q[last, 1])
        return at_joint(1, -2.0 * np.sign(dq[:, 1]) * np.exp(-travel / 0.02))

    conclusion = analyse(short_arm, building_up, [find_effect("presliding_hysteresis")]).conclusion
    (name,) = conclusion.names
    assert (name.group.effect.id, name.group.joint) == ("presliding_hysteresis", 1)
    alone, beside = (np.expm1(name.described.features[key]) for key in ("log_nats", "log_nats_beside"))
    assert alone > 50.0
    assert beside > 0.15 * alone


def test_what_is_less_likely_than_not_is_a_reservation(short_arm: ArmModel) -> None:
    """Law: an effect that was weighed and is no name is told with its probability and with what speaks against it."""
    analysis = analyse(short_arm, spring_on_3, [e for e in CATALOGUE if e.id != "spring_torque"])
    told = {(one.effect, one.joints): one for one in analysis.diagnosis.reservations if one.probability is not None}
    joints = short_arm.joint_names
    weighed = [
        (name.group.effect.id, tuple(joints[j] for j in name.named_joints)) for name in analysis.conclusion.unlikely
    ]
    assert set(told) == set(weighed)
    for one in told.values():
        assert one.probability is not None
        assert one.probability < 0.5
        assert one.reason
        assert one.reasons


@pytest.mark.xfail(strict=False, reason="a gap of 1.4 times the noise is told at 40 %: the odds ask for more")
def test_a_joint_without_a_name_keeps_the_gap_open(short_arm: ArmModel) -> None:
    """Law: a spring that closes nearly the whole gap is not all that is wrong where another joint has teeth, for which
    no name is at hand.
    """

    def both(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        return 3.0 * spring_on_3(arm, q, dq, ddq) + at_joint(1, 0.6 * np.sin(60.0 * q[:, 1]))

    found = analyse(short_arm, both, [find_effect("spring_torque")]).diagnosis
    assert [(one.joints, one.estimate.group.effect.id) for one in found.findings] == [(("joint_3",), "spring_torque")]
    assert found.heldout.shrink > 0.8
    assert found.details.leftover[1] > 0.5 > found.details.leftover[2]
    assert found.verdict == "partial"


def diagnose_teeth(arm: ArmModel) -> Diagnosis:
    """What is said of teeth at joint 2 where no name for them is at hand."""

    def teeth(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        return at_joint(1, 1.2 * np.sin(60.0 * q[:, 1]))

    return analyse(arm, teeth, []).diagnosis


def test_a_gap_that_is_seen_by_neighbours_alone_is_placed(short_arm: ArmModel) -> None:
    """Law: teeth at one joint: something without a name is likelier there than elsewhere."""
    left = np.array(diagnose_teeth(short_arm).details.leftover)
    odds = left / (1.0 - left)
    assert odds[1] > 5.0 * max(odds[0], odds[2])


def test_a_gap_that_is_seen_by_neighbours_alone_is_reported(short_arm: ArmModel) -> None:
    """Law: it is said that there is a gap."""
    assert diagnose_teeth(short_arm).verdict == "none_of_catalogue"


@pytest.mark.parametrize(("amplitude", "verdict"), [(0.0, "no_gap"), (0.8, "none_of_catalogue")])
def test_a_law_that_no_name_has_shows_below_what_friction_varies_by(
    short_arm: ArmModel, amplitude: float, verdict: str
) -> None:
    """Law: friction of one joint that is another in every run hides no function of its angle: the error lies within
    the noise floor, which counts friction's variation, and is a gap nevertheless; the variation alone is none.
    """
    rng, motions = np.random.default_rng(5), []
    for seed in range(20):
        more = 0.06 * rng.standard_normal()

        def law(q: Array, dq: Array, ddq: Array, more: float = more) -> Array:
            wavy = (amplitude * np.sin(q[:, 1]) + more * COULOMB[1]) * np.tanh(dq[:, 1] / SLIP)
            return healthy_torque(short_arm, q, dq, ddq) + at_joint(1, wavy + more * VISCOUS[1] * dq[:, 1])

        motions += made_motions(short_arm, law, [seed], 4.0, 50.0, noise=NOISE_STD)
    diagnosis = diagnose(motions, short_arm, [], common_clock=False).diagnosis
    assert diagnosis.verdict == verdict
    assert diagnosis.gap["joint_2"].unexplained == ("state" if amplitude else None)
    assert {one.joint for one in diagnosis.where} == ({"joint_2"} if amplitude else set())


SMALL_GAP = pytest.mark.xfail(strict=False, reason="the odds of a gap ask for more than 1.2 times the noise")


@pytest.mark.parametrize(
    ("amplitude", "verdict"), [(0.0, "no_gap"), pytest.param(0.5, "none_of_catalogue", marks=SMALL_GAP)]
)
def test_friction_that_waves_with_the_teeth_shows(short_arm: ArmModel, amplitude: float, verdict: str) -> None:
    """Law: what repeats by the angle is found though it is of the other sign on the way back."""

    def teeth(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
        return at_joint(1, amplitude * np.cos(60.0 * q[:, 1]) * np.tanh(dq[:, 1] / SLIP))

    diagnosis = diagnose(record(short_arm, teeth), short_arm, [], common_clock=False).diagnosis
    assert diagnosis.verdict == verdict
    assert {one.joint for one in diagnosis.where} == ({"joint_2"} if amplitude else set())


RATE = 50.0
FRICTION, NOISE = np.array([3.0, 2.0]), np.array([0.1, 0.1])
ANGLES = (0.0, 0.7, 0.2)


def stepped(hold_s: float = 2.0, push: float = 0.0, move_s: float = 1.0) -> Motion:
    """Two joints: the first rests at some angles and moves between, the second moves all the time."""
    pieces = [np.full(int(hold_s * RATE), ANGLES[0])]
    for old, new in pairwise(ANGLES):
        s = np.arange(int(move_s * RATE)) / (move_s * RATE)
        pieces += [old + (10 * s**3 - 15 * s**4 + 6 * s**5) * (new - old), np.full(int(hold_s * RATE), new)]
    first = np.concatenate(pieces)
    time = np.arange(len(first)) / RATE
    q = np.stack([first, np.sin(2.0 * time)], axis=1)
    dq, ddq = (np.stack([part, wave], axis=1) for part, wave in zip(_rates(first), _waves(time), strict=True))
    tau = np.zeros_like(q)
    start = hold_s + move_s
    rest = slice(int((start + 0.4 * hold_s) * RATE), int((start + 0.7 * hold_s) * RATE))
    tau[rest, 0] += push
    return exact_motion(time, (q, dq, ddq), tau, ("a", "b"), "run")


def _rates(q: Array) -> tuple[Array, Array]:
    dq = np.gradient(q, 1.0 / RATE)
    return dq, np.gradient(dq, 1.0 / RATE)


def _waves(time: Array) -> tuple[Array, Array]:
    return 2.0 * np.cos(2.0 * time), -4.0 * np.sin(2.0 * time)


def rows_of(motion: Motion, blocks: Array | None = None) -> DwellRows:
    tables = [np.stack([np.ones(len(motion.tau_filtered)), tau], axis=1) for tau in motion.tau_filtered.T]
    return dwell_rows(motion, tables, FRICTION, NOISE, blocks)[0]


def test_holds_are_where_a_joint_rests_with_the_sign_of_the_motion_that_ended_there() -> None:
    motion = stepped()
    first, second = find_holds(motion)
    assert [one.sign for one in first] == [0.0, 1.0, -1.0]
    assert not second
    assert not motion.moving[:, 0][resting(motion)[motion.coarse, 0]].any()


@pytest.mark.parametrize(("move_s", "seen"), [(0.12, True), (0.5, False)])
def test_a_move_that_is_too_short_to_settle_is_an_observation(move_s: float, seen: bool) -> None:
    """Law: what moves between holds is seen, by friction's level where nothing of it settles; never twice."""
    motion = stepped(hold_s=0.8, move_s=move_s)
    turns = find_turns(motion)[0]
    moves = np.flatnonzero(np.diff(motion.moving[:, 0].astype(int))) + 1
    assert [(one.start, one.stop) for one in turns] == ([tuple(one) for one in moves.reshape(-1, 2)] if seen else [])
    assert motion.settled[:, 0].any() != seen


def test_a_hold_is_worth_one_observation_however_long_it_lasts_and_however_it_is_cut() -> None:
    short, long = rows_of(stepped(2.0)), rows_of(stepped(8.0))
    assert len(short.rows) == len(long.rows) == len(ANGLES)
    np.testing.assert_allclose(long.std, FRICTION[0] / np.sqrt(3.0), rtol=1e-3)
    motion = stepped(8.0)
    cut = rows_of(motion, np.arange(motion.filtered_length) // 50)
    assert len(cut.rows) > 3 * len(ANGLES)
    for hold in range(len(ANGLES)):
        assert np.sum(cut.std[cut.hold == hold] ** -2.0) == pytest.approx(long.std[hold] ** -2.0, rel=1e-2)


@pytest.mark.parametrize(("push", "holds"), [(0.0, 3), (1.0, 3), (20.0, 5)])
def test_a_push_beyond_what_friction_takes_up_parts_a_hold(push: float, holds: int) -> None:
    found = rows_of(stepped(4.0, push))
    assert len(np.unique(found.hold)) == holds
    assert np.ptp(found.rows[:, -1]) == pytest.approx(push if holds > 3 else 0.0, abs=0.05 + 0.4 * push * (holds == 3))


def test_a_joint_that_creeps_on_is_observed_anew_after_each_travel() -> None:
    still = stepped(4.0)
    creep = np.array(still.q)
    creep[:, 0] = np.linspace(0.0, 0.4, len(creep))
    slow = replace(still, q=creep, dq=np.zeros_like(creep))
    assert len(np.unique(rows_of(slow).hold)) == pytest.approx(0.4 / slow.settings.forgetting_travel, abs=1.0)


def test_a_joint_that_nobody_moved_between_two_runs_is_in_one_hold() -> None:
    motion = stepped()
    at_rest = replace(motion, q=0.0 * motion.q, dq=0.0 * motion.q, ddq=0.0 * motion.q)
    one = rows_of(at_rest)
    assert len(np.unique(join_runs([one, one, one]).hold)) == 1
    assert len(np.unique(join_runs([one, one, one], alike=2).hold)) == 2
    moved = replace(one, angle=one.angle + 0.5)
    assert len(np.unique(join_runs([one, moved]).hold)) == 2


def test_rows_after_a_gap_are_whitened_by_what_of_their_past_counts() -> None:
    """However short the stretches: innovations of variance one, none of them alike, and no row is lost."""
    rng, coefficients, innovation = np.random.default_rng(0), np.array([1.0, -0.9, 0.3, 0.1, -0.05]), 0.7
    noise = np.zeros(40_000)
    shocks = innovation * rng.standard_normal(len(noise))
    for t in range(4, len(noise)):
        noise[t] = shocks[t] - coefficients[1:] @ noise[t - 4 : t][::-1]
    counts = rng.random(len(noise)) > 0.2
    counts[:10] = False
    white = whiten_after_gaps(noise[:, None], counts, shorter_filters(coefficients, innovation))[:, 0]
    first = np.flatnonzero(counts[1:] & ~counts[:-1]) + 1
    for later in range(4):
        rows = (first + later)[[counts[a : a + later + 1].all() for a in first]]
        assert white[rows].std() == pytest.approx(1.0, abs=0.05)
    both = counts[1:] & counts[:-1]
    assert np.corrcoef(white[1:][both], white[:-1][both])[0, 1] == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize(("before", "behind"), [(0.1, 0.4), (0.45, 0.1)])
def test_a_push_while_a_joint_turns_is_found_as_a_whole(short_arm: ArmModel, before: float, behind: float) -> None:
    """Law: what friction may hide near a turn is unknown, and not the end of a push."""
    motions = list(record(short_arm, nothing))
    time, dq = motions[2].time, motions[2].dq[:, 2]
    turn = time[np.flatnonzero(np.diff(np.sign(dq[300:500])))[0] + 300]
    start, end = turn - before, turn + behind
    torque = np.where(((time > start) & (time < end))[:, None], [1.0, 1.0, 9.0], 0.0)
    motions[2] = replace(motions[2], tau=motions[2].tau + torque)
    session = build_session(fit_baseline(motions, short_arm), motions, common_clock=False)
    found = screen_windows(Leftover(session, leftover_torque(session)))[0]
    assert found.run == motions[2].name
    np.testing.assert_allclose((found.start, found.end), (start, end), atol=0.1)
