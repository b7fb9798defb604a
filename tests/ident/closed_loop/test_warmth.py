"""Warmth along runs: as the catalogue's law has it, going on from run to run, and followed by the loop."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from ident.arrays import Array
from ident.closed_loop import loop
from ident.closed_loop.loop import PlannedRun, follow_warmth, heat_along
from ident.closed_loop.result import put_on_a_clock
from ident.effects.catalogue import find_effect
from ident.export.controllers import describe_arm
from ident.export.loaded import LawModel
from ident.laws.motion import Losses
from ident.motion.filter import FOR_DIAGNOSIS
from ident.motion.motion import prepare
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.trajectories.reference import ReferenceMotion
from tests.ident.closed_loop.test_closing import LEFT, NOISE, Anything
from tests.ident.effects.smooth_motion import COULOMB, VISCOUS, make_session
from tests.ident.export import diagnoses
from tests.ident.export.diagnoses import FIGURES, baseline, finding
from tests.ident.made_up import made_session, two_joint_arm

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
        viscous, coulomb, rotor = (values[:2] for values in (diagnoses.VISCOUS, diagnoses.COULOMB, diagnoses.ROTOR))
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
    found = loop.close_gap(arm, WarmingArm(arm, span=first.warmest), Anything())
    assert found.closed
    assert len(found.rounds) == 2
    monkeypatch.setattr(loop, "follow_warmth", lambda model, learned, runs: [model] * len(runs))
    blind = loop.close_gap(arm, WarmingArm(arm, span=first.warmest), Anything())
    assert not blind.closed
