"""How far a motion would set models apart, seen with the diagnosis's own eyes.

    D(k|l) = ½ ‖(I − P_[Z, Φ_l]) Φ_k β_k‖² / σ²

Z is what the diagnosis tunes anyway: base parameters held near the URDF, and rotor inertia, viscous and Coulomb
friction of each joint. D is the expected log odds in nats between the two models if k is true, before the temper by
which the diagnosis makes its probabilities honest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from ident.arrays import Array, Float, Int
from ident.diagnosis.regression.design import Layout, build_layout
from ident.diagnosis.regression.gram import build_partition
from ident.diagnosis.regression.rows import Rows, compute_rows
from ident.effects.base import Effect, SessionContext
from ident.trajectories.reference import ReferenceMotion
from plan.experiment.foresight import Eye
from plan.experiment.sizes import Sized, Told, choose_variant, size_effect

# Ridge of the tuned unknowns, and of a rival's coefficients, as a share of a column's power: keeps solves well-posed.
RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class TrueModel:
    """One effect at one joint: how large it is taken to be, and where its columns stand.

    Attributes:
        effect: The effect.
        joint: Its joint.
        sized: Expected size; None where the motion can't show it.
        columns: For each point of its inner grid, its columns in the Gram matrix.
        at: Which point is the expected one.
        silent: Why the motion can't show it, or empty.
    """

    effect: Effect
    joint: int
    sized: Sized | None
    columns: tuple[Int[Array, " k"], ...]
    at: int = 0
    silent: str = ""


@dataclass(frozen=True, eq=False)
class PredictedDesign:
    """Whitened sums of a motion's columns, the tuned ones taken out.

    Attributes:
        rest: Schur complement over the effects' columns [1].
        base: Information on the base parameters, loss figures taken out, in units of the URDF's doubt.
        candidates: The effects.
        first: Place of the first column in `rest`.
    """

    rest: Float[Array, "K K"]
    base: Float[Array, "r r"]
    candidates: tuple[TrueModel, ...]
    first: int

    def distance(self, k: int, rival: int | None) -> float:
        """D(k|l) in nats, the rival at its best inner figures; against the baseline alone if there is no rival."""
        own = self.candidates[k]
        if own.sized is None:
            return 0.0
        at, beta = own.columns[own.at] - self.first, own.sized.coefficients
        plain = float(beta @ self.rest[np.ix_(at, at)] @ beta)
        if rival is None or self.candidates[rival].sized is None:
            return 0.5 * max(plain, 0.0)
        rivals = [places - self.first for places in self.candidates[rival].columns]
        left = [plain - self._absorbed(at, beta, other) for other in rivals]
        return 0.5 * max(min(left), 0.0)

    def _absorbed(self, at: Array, beta: Array, other: Array) -> float:
        """What of an effect's whitened power a rival takes over."""
        inner = self.rest[np.ix_(other, other)]
        power = np.maximum(np.diag(inner), 0.0)
        if not power.any():
            return 0.0
        cross = self.rest[np.ix_(other, at)] @ beta
        root = 1.0 / np.sqrt(np.maximum(power, 1e-12 * power.max()))  # columns of unit length: they differ by orders
        matrix = inner * np.outer(root, root) + RIDGE * np.eye(len(power))
        return float((root * cross) @ np.linalg.solve(matrix, root * cross))

    def between(self) -> dict[tuple[str, str], float]:
        """Distance of every effect from every other [nats]."""
        ids = [candidate.effect.id for candidate in self.candidates]
        pairs = [(k, rival) for k in range(len(ids)) for rival in range(len(ids)) if k != rival]
        return {(ids[k], ids[rival]): self.distance(k, rival) for k, rival in pairs}

    def visible(self) -> dict[tuple[str, str], float]:
        """Distance of every effect from the tuned baseline alone [nats]."""
        return {(one.effect.id, "baseline"): self.distance(k, None) for k, one in enumerate(self.candidates)}

    def information(self) -> float:
        """½ log det (I + F), nats gained: F the Fisher information of the one effect's coefficients in units of their
        expected size, or, without effects, of the base parameters in units of the URDF's doubt."""
        if not self.candidates:
            return _gain(self.base)
        own = self.candidates[0]
        if own.sized is None:
            return 0.0
        at, beta = own.columns[own.at] - self.first, own.sized.coefficients
        return _gain(self.rest[np.ix_(at, at)] * np.outer(beta, beta))


def _gain(information: Float[Array, "k k"]) -> float:
    values = np.linalg.eigvalsh(0.5 * (information + information.T))
    return 0.5 * float(np.sum(np.log1p(np.maximum(values, 0.0))))


@dataclass(frozen=True, eq=False)
class _Columns:
    """Filtered columns of one effect at one point of its grid.

    Attributes:
        runs: Of each run, (t, k), or (t, n, k) where they act on all joints.
        joint: The joint that they act on, or None for all.
        places: Where they stand in the Gram matrix.
    """

    runs: list[Array]
    joint: int | None
    places: Int[Array, " k"]

    def fill(self, table: Float[Array, "t P"], run: int, joint: int) -> None:
        """Writes what acts on a joint into its table."""
        if self.joint is None:
            table[:, self.places] = self.runs[run][:, joint]
        elif self.joint == joint:
            table[:, self.places] = self.runs[run]


def look(
    eye: Eye,
    runs: Sequence[ReferenceMotion],
    effects: Sequence[tuple[Effect, int]] = (),
    told: Mapping[str, Told] | None = None,
) -> PredictedDesign:
    """What the diagnosis would see of effects in some runs.

    Args:
        eye: For the arm.
        runs: The motion.
        effects: Effects and their joints (0 for one of the whole arm).
        told: Figures that a diagnosis found, by effect.
    """
    session = eye.session(runs)
    layout = build_layout(session, eye.baseline.base.rank, ())
    candidates: list[TrueModel] = []
    columns: list[_Columns] = []
    size = layout.tuned
    for effect, joint in effects:
        candidate, own = _prepare(session, effect, joint, size, (told or {}).get(effect.id))
        candidates.append(candidate)
        columns += own
        size += sum(len(one.places) for one in own)
    joints = range(eye.arm.n)
    if effects and all(effect.rows == "own" for effect, _ in effects):
        joints = sorted({joint for _, joint in effects})  # type: ignore[assignment]
    gram = np.zeros((size, size))
    for rows in compute_rows(session, eye.baseline, layout, build_partition(session)):
        for j in joints:
            gram += _gram(rows, layout, columns, j, size) / eye.noise[j] ** 2
    rest, base = _take_out(gram, layout, eye.baseline.prior)
    return PredictedDesign(rest, base, tuple(candidates), layout.tuned)


def _prepare(
    session: SessionContext, effect: Effect, joint: int, start: int, told: Told | None
) -> tuple[TrueModel, list[_Columns]]:
    """Columns of an effect at every point of its inner grid, and its expected size."""
    silent = effect.untestable(session, joint)
    if silent is not None:
        return TrueModel(effect, joint, None, (), silent=silent), []
    variants = list(effect.variants(session, joint))
    found = []
    for variant in variants:
        raw = effect.columns(session, joint, variant)
        filtered = [run.motion.filtered(values) for run, values in zip(session.runs, raw, strict=True)]
        places = np.arange(start, start + filtered[0].shape[-1])
        start += len(places)
        found.append(_Columns(filtered, joint if effect.rows == "own" else None, places))
    at = choose_variant(effect, variants, told)
    sized = size_effect(effect, session, joint, variants[at], len(found[at].places), told)
    return TrueModel(effect, joint, sized, tuple(one.places for one in found), at), found


def _gram(rows: Rows, layout: Layout, columns: Sequence[_Columns], joint: int, size: int) -> Float[Array, "P P"]:
    """Sums of one run's rows of a joint, where they count."""
    table = np.zeros((len(rows.tables[joint]), size))
    table[:, layout.local[joint][:-1]] = rows.tables[joint][:, :-1]
    for one in columns:
        one.fill(table, rows.run, joint)
    seen = table[rows.counts[:, joint]]
    return seen.T @ seen


def _take_out(
    gram: Float[Array, "P P"], layout: Layout, prior: Float[Array, "r r"]
) -> tuple[Float[Array, "K K"], Float[Array, "r r"]]:
    """What the tuned unknowns leave of the effects; what the loss figures leave of the base parameters, in units of
    their prior."""
    rank, tuned = layout.rank, layout.tuned
    inner = gram[:tuned, :tuned].copy()
    inner[np.diag_indices(tuned)] += RIDGE * np.diag(inner) + 1e-12
    loss, cross = inner[rank:, rank:], inner[:rank, rank:]
    free = inner[:rank, :rank] - cross @ cho_solve(cho_factor(loss), cross.T)
    root = np.linalg.cholesky(prior)
    base = solve_triangular(root, solve_triangular(root, free, lower=True).T, lower=True)
    inner[:rank, :rank] += prior
    across = gram[:tuned, tuned:]
    return gram[tuned:, tuned:] - across.T @ cho_solve(cho_factor(inner), across), base
