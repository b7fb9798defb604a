"""How far a motion would set models apart, seen with the diagnosis's own eyes before anything is
recorded.

    D(k|l) = ½ ‖(I − P_[Z, Φ_l]) Φ_k β_k‖² / σ²

Z is what the diagnosis tunes anyway: base parameters held near the URDF, and rotor inertia, viscous
and Coulomb friction of each joint. D is the expected log odds in nats between the two models if k
is true, before the temper by which the diagnosis makes its probabilities honest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from ident.arrays import Array, Float, Int, freeze
from ident.effects import optional
from ident.effects.base import Effect, SessionContext, Variant
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion
from ident.motion.settings import FOR_DIAGNOSIS
from ident.regression.baseline import Baseline, fit_baseline
from ident.regression.design import layout_of
from ident.regression.partition import build_partition
from ident.regression.rows import compute_rows
from ident.regression.runs import build_session
from ident.robot.arm import ArmModel
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion
from plan.experiment.run_set import random_runs

# Ridge of the tuned unknowns, and of a rival's coefficients, as a share of a column's power: keeps
# solves well-posed.
RIDGE = 1e-9
# Of the ticks of a reference, one in this many is looked at: 125 Hz; standstill between runs [s].
THINNING = 8
PAUSE_S = 5.0
# What a smoother leaves of the doubt about q, dq and ddq at a modern encoder [rad, rad/s, rad/s²].
STATE_DOUBT = (1e-5, 1e-3, 0.1)
# Noise where none is known, as a share of the rated torque: that of a good drive and of what models
# leave.
NOISE_SHARE = 0.005
# A typical gear's friction: Coulomb as a share of the rated torque, viscous as much again at this
# speed [rad/s], rotor inertia as a share of rated torque at 100 rad/s².
COULOMB_SHARE = 0.06
VISCOUS_SPEED = 1.2
ROTOR_RATE = 150.0
# What a diagnosis reported is believed within this factor of a typical size.
LARGEST_CHANGE = 20.0

Reported = Mapping[str, float]
"""Figures of an effect by name."""


@dataclass(frozen=True, eq=False)
class TrueModel:
    """One effect at one joint: how large it is taken to be, and where its columns stand."""

    effect: Effect
    source: str  # where its size is from: `diagnosis`, `typical`, or `not seen`, with the reason
    # Its coefficients at the expected point of its inner grid; None where the motion can't show it.
    beta: Float[Array, " k"] | None = None
    # For each point of the grid, its columns in `PredictedDesign.rest`.
    columns: tuple[Int[Array, " k"], ...] = ()
    expected: int = 0  # which point is the expected one

    @property
    def expected_columns(self) -> Int[Array, " k"]:
        """The columns at the expected point."""
        return self.columns[self.expected]


@dataclass(frozen=True, eq=False)
class PredictedDesign:
    """Whitened sums of a motion's columns, the tuned ones taken out."""

    rest: Float[Array, "K K"]  # schur complement over the effects' columns [1]
    # Information on the base parameters, loss parameters taken out, in units of the URDF's doubt.
    base: Float[Array, "r r"]
    candidates: tuple[TrueModel, ...]  # the effects

    @classmethod
    def of(
        cls,
        gram: Float[Array, "P P"],
        rank: int,
        tuned: int,
        prior: Float[Array, "r r"],
        effects: Sequence[TrueModel],
    ) -> PredictedDesign:
        """From the sums of all columns, of which the first `rank` are the base's and the first
        `tuned` are tuned.
        """
        inner = gram[:tuned, :tuned].copy()
        inner[np.diag_indices(tuned)] += RIDGE * np.diag(inner) + 1e-12
        loss = inner[rank:, rank:]
        cross = inner[:rank, rank:]
        free = inner[:rank, :rank] - cross @ cho_solve(cho_factor(loss), cross.T)
        root = np.linalg.cholesky(prior)
        base = solve_triangular(root, solve_triangular(root, free, lower=True).T, lower=True)
        inner[:rank, :rank] += prior
        across = gram[:tuned, tuned:]
        return cls(
            gram[tuned:, tuned:] - across.T @ cho_solve(cho_factor(inner), across),
            base,
            tuple(effects),
        )

    def distance(self, k: int, rival: int | None) -> float:
        """D(k|l): what tells effect k from its rival l if k is the truth [nats].

        Args:
            k: Number of the true effect among the candidates.
            rival: Number of the other one, which is at its best inner parameters; None for the
                tuned baseline alone.

        Returns:
            Never negative; 0 where nothing is expected of effect k.
        """
        candidate = self.candidates[k]
        if candidate.beta is None:
            return 0.0
        columns = candidate.expected_columns
        beta = candidate.beta
        power = float(beta @ self.rest[np.ix_(columns, columns)] @ beta)
        rivals = () if rival is None else self.candidates[rival].columns
        absorbed = [self._absorbed(columns, beta, other) for other in rivals]
        return 0.5 * max(power - max(absorbed, default=0.0), 0.0)

    def _absorbed(self, columns: Array, beta: Array, other: Array) -> float:
        """What of an effect's whitened power a rival takes over.

            cᵀ (R + ridge)⁻¹ c,  c = S Φ_lᵀ Φ_k β

        with the rival's sums R and columns scaled to unit length by S.
        """
        inner = self.rest[np.ix_(other, other)]
        power = np.maximum(np.diag(inner), 0.0)
        if not power.any():
            return 0.0
        # Columns of unit length: they differ by orders.
        root = 1.0 / np.sqrt(np.maximum(power, 1e-12 * power.max()))
        cross = root * (self.rest[np.ix_(other, columns)] @ beta)
        scaled = inner * np.outer(root, root) + RIDGE * np.eye(len(power))
        return float(cross @ np.linalg.solve(scaled, cross))

    def between(self) -> dict[tuple[str, str], float]:
        """Distance of every effect from every other [nats].

        Returns:
            By the id of the true effect and that of its rival.
        """
        ids = [candidate.effect.id for candidate in self.candidates]
        pairs = permutations(range(len(ids)), 2)
        return {(ids[k], ids[rival]): self.distance(k, rival) for k, rival in pairs}

    def visible(self) -> dict[tuple[str, str], float]:
        """Distance of every effect from the tuned baseline alone [nats].

        Returns:
            By the effect's id and "baseline".
        """
        distances = {}
        for k, candidate in enumerate(self.candidates):
            distances[candidate.effect.id, "baseline"] = self.distance(k, None)
        return distances

    def information(self) -> float:
        """½ log det (I + F), nats gained.

        F the Fisher information of the one effect's coefficients in units of their
        expected size, or, without effects, of the base parameters in units of the URDF's doubt."""
        fisher = self.base
        if self.candidates:
            candidate = self.candidates[0]
            if candidate.beta is None:
                return 0.0
            columns = candidate.expected_columns
            sizes = np.outer(candidate.beta, candidate.beta)
            fisher = self.rest[np.ix_(columns, columns)] * sizes
        values = np.linalg.eigvalsh(0.5 * (fisher + fisher.T))
        return 0.5 * float(np.sum(np.log1p(np.maximum(values, 0.0))))

    def base_deviations(self) -> Float[Array, " r"]:
        """Standard deviations of the base parameters by these runs alone, in units of the URDF's
        doubt.
        """
        fisher = self.base + RIDGE * np.diag(np.diag(self.base))
        return np.sqrt(np.diag(np.linalg.pinv(fisher, hermitian=True)))


@dataclass(frozen=True, eq=False)
class Predictor:
    """What the diagnosis will know when it looks at a motion that is yet to be recorded."""

    arm: ArmModel
    baseline: Baseline  # tuned on an imagined healthy recording
    noise: Float[Array, " n"]  # standard deviation of each joint's torque noise [N m]

    @classmethod
    def of(cls, arm: ArmModel, noise: Float[Array, " n"] | None = None) -> Predictor:
        """For an arm; noise of half a per cent of the rated torque if none is known.

        The healthy recording has the torque of an arm as its URDF says, with typical friction and
        noise.
        """
        rated = MotionLimits(arm).torque
        rng = np.random.default_rng(0)
        healthy = []
        for motion in random_runs(arm, 3, 6.0, rng):
            run = as_recorded(motion, arm, 0.0)
            tau = arm.inverse_dynamics(run.q, run.dq, run.ddq) + rated / ROTOR_RATE * run.ddq
            tau += COULOMB_SHARE * rated * (np.tanh(run.dq / 2e-3) + run.dq / VISCOUS_SPEED)
            tau += NOISE_SHARE * rated * rng.standard_normal(tau.shape)
            healthy.append(replace(run, tau=freeze(tau)))
        if noise is None:
            noise = NOISE_SHARE * rated
        return cls(arm, fit_baseline(healthy, arm), freeze(np.array(noise)))

    def look(
        self,
        runs: Sequence[ReferenceMotion],
        effects: Sequence[tuple[Effect, int]] = (),
        reported: Mapping[str, Reported] | None = None,
    ) -> PredictedDesign:
        """What the diagnosis would see of effects in some runs.

        Args:
            runs: The motion.
            effects: Effects and their joints (0 for one of the whole arm).
            reported: Parameters that a diagnosis found, by effect.
        """
        session = self._session(runs)
        reasons = [effect.untestable(session, joint) for effect, joint in effects]
        grids = []
        for (effect, joint), reason in zip(effects, reasons, strict=True):
            if reason is None:
                grids.append((effect, joint, tuple(effect.variants(session, joint))))
        layout = layout_of(session, self.baseline.base.rank, grids)
        joints: Sequence[int] = range(self.arm.n)
        if effects and all(effect.rows == "own" for effect, _ in effects):
            joints = sorted({joint for _, joint in effects})
        gram = np.zeros((layout.size, layout.size))
        for rows in compute_rows(session, self.baseline, layout, build_partition(session)):
            for j in joints:
                table = rows.tables[j][rows.counts[:, j], :-1]
                local = layout.local[j][:-1]
                gram[np.ix_(local, local)] += table.T @ table / self.noise[j] ** 2
        places = iter(group.columns - layout.tuned for group in layout.groups)
        models = []
        points = iter(grids)
        for (effect, joint), reason in zip(effects, reasons, strict=True):
            if reason is not None:
                models.append(TrueModel(effect, f"not seen: {reason}"))
                continue
            _, _, variants = next(points)
            columns = tuple(next(places) for _ in variants)
            stated = (reported or {}).get(effect.id, {})
            # Of the inner grid the point nearest to what is reported, or to what is typical; else
            # the first.
            apart = [effect.typical.distance(variant.inner, stated) for variant in variants]
            nearest = apart.index(min(apart))
            width = len(columns[nearest])
            beta, source = size_effect(effect, session, joint, variants[nearest], width, stated)
            models.append(TrueModel(effect, source, beta, columns, nearest))
        return PredictedDesign.of(gram, layout.rank, layout.tuned, self.baseline.prior, models)

    def _session(self, runs: Sequence[ReferenceMotion]) -> SessionContext:
        """Runs as the effects will see them, on one clock."""
        motions = []
        clock = 0.0
        for run in runs:
            motions.append(as_recorded(run, self.arm, clock))
            clock = float(motions[-1].time[-1]) + PAUSE_S
        return build_session(self.baseline, motions, common_clock=True)


def as_recorded(run: ReferenceMotion, arm: ArmModel, start: float) -> Motion:
    """A reference as if the arm had followed it exactly, without torque, from a time on [s]."""
    q, dq, ddq = (freeze(values[::THINNING]) for values in (run.q, run.dq, run.ddq))
    rate = 1.0 / (THINNING * TICK_S)
    return Motion(
        name=run.name,
        joints=arm.joint_names,
        time=freeze(start + np.arange(len(q)) / rate),
        q=q,
        dq=dq,
        ddq=ddq,
        tau=freeze(np.zeros_like(q)),
        lowpass=Lowpass.design(rate, settings=FOR_DIAGNOSIS),
        std=freeze(np.outer(STATE_DOUBT, np.ones(arm.n))),
    )


def size_effect(
    effect: Effect,
    session: SessionContext,
    joint: int,
    variant: Variant,
    width: int,
    reported: Reported,
) -> tuple[Float[Array, " k"], str]:
    """Coefficients of an effect as large as it is expected to be, and whether that is `typical` or
    of a `diagnosis`.

    Args:
        effect: The effect.
        session: Of the motions in question.
        joint: Its joint.
        variant: Point of its inner grid.
        width: Number of its columns there.
        reported: Parameters of the diagnosis by name, if it found this effect.
    """
    typical = effect.typical
    beta = optional.typical_coefficients(effect, session, joint, variant, width)
    if typical.figure not in reported:
        return beta, "typical"
    usual = max(optional.size_of(effect, session, joint, variant, beta), 1e-12)
    ratio = max(abs(reported[typical.figure]) / usual, 1e-12)
    if typical.inverse:
        ratio = ratio**-1
    factor = float(np.clip(ratio, 1.0 / LARGEST_CHANGE, LARGEST_CHANGE))
    return beta * factor, "diagnosis"
