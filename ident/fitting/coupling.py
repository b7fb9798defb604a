"""Two joints whose motors turn each other, as in wrists: inertia and friction of both.

    τ_a += I q̈_b + V (q̇_b + m q̇_a) + C tanh((q̇_a + m q̇_b) / w),   and with a and b exchanged

m is 1 where a motor turns by the sum of both angles, −1 where by their difference. I, V and C of
each joint are fitted by least squares beside base parameters, losses and offsets of both; of the
two m the one that leaves less.

Where no pair is given, neighbours are tried. Two joints are coupled where parts of the recordings
that were left out are foretold surely better at both of them, with friction that brakes.

Source: Gautier, Janot and Jubien 2013 (the coupled wrist of the TX series); Stone 1974.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float, Int
from ident.errors import InputError
from ident.fitting.held_out_sums import split_parts
from ident.fitting.over_parts import SURE
from ident.model.carried import CarriedEffect, as_acting, carried_torque, moving_arm
from ident.model.inertia import BaseParameters, base_parameters, base_prior
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.motion.stretches import hold
from ident.robot.arm import ArmModel
from ident.robot.tolerance import PRIOR_SHARE, parameter_scale

# Speed over which the sum of both speeds turns friction round [rad/s].
WIDTH = 0.02
# The effect that a coupling is carried as.
EFFECT = "joint_coupling"
# What asks for no coupling, and for none to be looked for.
NO_COUPLING = "none"
# By what a joint's motor turns beside its own angle: the sum of both, or their difference.
MIXES = (1.0, -1.0)
# A joint's own columns: acceleration, speed, direction, one; those of each other joint:
# acceleration, speed, and the direction of both mixes.
OWN = 4
BESIDE = 2 + len(MIXES)
# Samples that couplings are looked for in; of a longer session stretches from all over it.
SEARCHED_SAMPLES = 50_000
# Squares of a part below this are none [N² m²].
LEAST = 1e-12


def read_coupling(text: str, arm: ArmModel) -> tuple[int, int]:
    """Numbers of two joints, from zero.

    Args:
        text: As `5,6`, counted from one.
        arm: The arm.

    Raises:
        InputError: It is no such pair.
    """
    words = text.split(",")
    remedy = f"give two numbers from 1 to {arm.n} as 5,6, or {NO_COUPLING}"
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise InputError("--coupling", f"{text!r} is no pair of joints", remedy)
    first, second = (int(word) - 1 for word in words)
    if first == second or not all(0 <= joint < arm.n for joint in (first, second)):
        raise InputError("--coupling", f"{text!r} is no pair of this arm's joints", remedy)
    return first, second


def fit_coupling(
    motions: Sequence[Motion], arm: ArmModel, first: int, second: int
) -> tuple[CarriedEffect, ...]:
    """What each of two joints does to the other.

    Args:
        motions: Training runs.
        arm: The arm as its URDF describes it.
        first, second: The joints.
    """
    sums = _gather(motions, arm, [(first, second)])
    trials = [_solve(sums, (first, second), mix) for mix in MIXES]
    return min(trials, key=lambda coupled: coupled.left.sum()).effects


def find_coupling(motions: Sequence[Motion], arm: ArmModel) -> tuple[CarriedEffect, ...]:
    """What neighbouring joints do to each other, as far as parts left out ask for it.

    Args:
        motions: Training runs.
        arm: The arm as its URDF describes it.

    Returns:
        Two effects a pair; none where no pair is surely coupled. No joint is in two pairs.
    """
    pairs = [(joint, joint + 1) for joint in range(arm.n - 1)]
    sums = _gather(hold(motions, SEARCHED_SAMPLES).motions, arm, pairs)
    ranked: list[tuple[float, Coupled]] = []
    for pair in pairs:
        sure = _sure_coupling(sums, pair)
        if sure is not None:
            ranked.append(sure)
    effects: list[CarriedEffect] = []
    taken: set[int] = set()
    for _, coupled in sorted(ranked, key=lambda row: row[0]):
        if taken.isdisjoint(coupled.pair):
            effects += fit_coupling(motions, arm, *coupled.pair)
            taken.update(coupled.pair)
    return tuple(effects)


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums over parts of each joint's columns: base, its own, its neighbours', torque."""

    base: BaseParameters
    prior: Float[Array, "r r"]  # what is known of the base parameters before
    neighbours: tuple[tuple[int, ...], ...]  # of each joint, in the order of their columns
    squares: tuple[Float[Array, "f p p"], ...]  # of each joint

    @property
    def parts(self) -> Int[Array, " f"]:
        """Numbers of the parts."""
        return np.arange(max(map(len, self.squares)))

    def columns(self, joint: int, other: int, mix: float | None) -> Int[Array, " c"]:
        """Places of a joint's columns: base parameters, its own, and those of a coupling.

        Args:
            joint: Number of the joint.
            other: Number of its neighbour.
            mix: One of `MIXES`; None for no coupling.
        """
        rank = self.base.rank
        plain = np.arange(rank + OWN)
        if mix is None:
            return plain
        start = rank + OWN + BESIDE * self.neighbours[joint].index(other)
        turning = start + 2 + MIXES.index(mix)
        return np.append(plain, [start, start + 1, turning])


@dataclass(frozen=True, eq=False)
class Coupled:
    """Least squares of two joints, with a coupling or without."""

    pair: tuple[int, int]
    mix: float | None
    numbers: Float[Array, "2 c"]  # of each joint, its own and the coupling's
    left: Float[Array, "f 2"]  # squares that are left of each part at each joint

    @property
    def effects(self) -> tuple[CarriedEffect, ...]:
        """The coupling as a model carries it: one effect for each of the pair."""
        effects = []
        for place, (joint, other) in enumerate((self.pair, self.pair[::-1])):
            inertia, viscous, coulomb = self.numbers[place, OWN:].tolist()
            parameters = {
                "other_joint": float(other + 1),
                "mix": float(self.mix or 0.0),
                "width_rad_s": WIDTH,
                "inertia_kgm2": inertia,
                # Of both speeds; the joint's friction, fitted after it, has what is its own.
                "viscous_Nms_rad": viscous,
                "coulomb_Nm": coulomb,
            }
            effects.append(CarriedEffect(EFFECT, joint, parameters))
        return tuple(effects)


def _sure_coupling(sums: PairSums, pair: tuple[int, int]) -> tuple[float, Coupled] | None:
    """The coupling that helps both joints on parts left out, and the share that it leaves."""
    plain = _left_out(sums, pair, None)
    sure: list[tuple[float, Coupled]] = []
    for mix in MIXES:
        whole = _solve(sums, pair, mix)
        left = _left_out(sums, pair, mix)
        if np.all(whole.numbers[:, -1] > 0.0) and _falls(plain, left):
            share = left.sum(axis=0) / plain.sum(axis=0)
            sure.append((float(share.mean()), whole))
    return min(sure, key=lambda row: row[0], default=None)


def _falls(before: Float[Array, "f 2"], after: Float[Array, "f 2"]) -> bool:
    """Whether squares of parts fall at both joints, by Student's test of their logarithms."""
    log_after = np.log(np.maximum(after, LEAST))
    fall = np.log(np.maximum(before, LEAST)) - log_after
    if len(fall) < 2:
        return False
    doubt = fall.std(axis=0, ddof=1) / np.sqrt(len(fall))
    quantile = stdtrit(len(fall) - 1, SURE)
    return bool(np.all(fall.mean(axis=0) > quantile * doubt))


def _left_out(sums: PairSums, pair: tuple[int, int], mix: float | None) -> Float[Array, "f 2"]:
    """Squares left of each part at both joints by the solution of all other parts."""
    left = np.zeros((len(sums.parts), 2))
    for number in sums.parts:
        others = sums.parts[sums.parts != number]
        left[number] = _solve(sums, pair, mix, others).left[number]
    return left


def _solve(
    sums: PairSums,
    pair: tuple[int, int],
    mix: float | None,
    parts: Int[Array, " k"] | None = None,
) -> Coupled:
    """Least squares over both joints: base parameters of both, own columns of each.

    Args:
        sums: The sums.
        pair: The joints.
        mix: By what the motors turn beside their own angle; no coupling if None.
        parts: Parts whose rows count; all if None.
    """
    rank = sums.base.rank
    backwards = pair[::-1]
    columns = [sums.columns(*pair, mix), sums.columns(*backwards, mix)]
    size = len(columns[0]) - rank
    information = np.zeros((rank + 2 * size, rank + 2 * size))
    score = np.zeros(len(information))
    information[:rank, :rank] += sums.prior
    used = sums.parts if parts is None else parts
    places = [
        np.concatenate([np.arange(rank), rank + first + np.arange(size)]) for first in (0, size)
    ]
    for joint, column, place in zip(pair, columns, places, strict=True):
        gram = sums.squares[joint][used].sum(axis=0)
        information[np.ix_(place, place)] += gram[np.ix_(column, column)]
        score[place] += gram[column, -1]
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    numbers = np.linalg.lstsq(scaled, score / scale, rcond=1e-10)[0] / scale
    left = np.zeros((len(sums.parts), 2))
    for k, joint in enumerate(pair):
        weights = np.zeros(sums.squares[joint].shape[1])
        weights[columns[k]] = -numbers[places[k]]
        weights[-1] = 1.0
        left[:, k] = np.einsum("p,fpq,q->f", weights, sums.squares[joint], weights)
    return Coupled(pair, mix, numbers[rank:].reshape(2, size), np.maximum(left, 0.0))


def _gather(motions: Sequence[Motion], arm: ArmModel, pairs: Sequence[tuple[int, int]]) -> PairSums:
    """One pass over the runs, with the columns of every pair at both of its joints."""
    base = base_parameters(arm)
    neighbours: list[tuple[int, ...]] = []
    for joint in range(arm.n):
        beside = [pair[1 - pair.index(joint)] for pair in pairs if joint in pair]
        neighbours.append(tuple(beside))
    parts = split_parts(motions)
    count = 1 + max(int(part_of_row.max()) for part_of_row in parts)
    sizes = [base.rank + OWN + BESIDE * len(others) + 1 for others in neighbours]
    squares = tuple(np.zeros((count, size, size)) for size in sizes)
    for motion, part_of_row in zip(motions, parts, strict=True):
        regressor = arm.regressor(motion.q, motion.dq, motion.ddq, list(base.columns))
        rigid = arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
        for joint, others in enumerate(neighbours):
            if not others:
                continue
            columns = [
                regressor[:, joint],
                _joint_columns(motion, joint, others),
                rigid[:, joint, None],
            ]
            table = motion.filtered(np.concatenate(columns, axis=1))
            measured = motion.tau_filtered[:, joint]
            table[:, -1] = measured - table[:, -1]
            for number in np.unique(part_of_row):
                rows = table[motion.moving[:, joint] & (part_of_row == number)]
                squares[joint][number] += rows.T @ rows
    prior = base_prior(base, PRIOR_SHARE["base"] * parameter_scale(arm))
    return PairSums(base, prior, tuple(neighbours), squares)


def _joint_columns(motion: Motion, joint: int, others: Sequence[int]) -> Float[Array, "T c"]:
    """A joint's own columns, then acceleration, speed and directions with each other joint."""
    speed = motion.dq[:, joint]
    direction = np.tanh(speed / WIDTH)
    columns = [motion.ddq[:, joint], speed, direction, np.ones(len(speed))]
    for other in others:
        beside = motion.dq[:, other]
        turning = [np.tanh((speed + mix * beside) / WIDTH) for mix in MIXES]
        columns += [motion.ddq[:, other], beside, *turning]
    return np.column_stack(columns)


def without_carried(motion: Motion, arm: ArmModel, effects: Sequence[CarriedEffect]) -> Motion:
    """A run whose torque is what would be measured without the effects.

    Args:
        motion: The run.
        arm: The arm as its URDF describes it.
        effects: What is carried.
    """
    none = LossParameters.zero(arm.n)
    moving = moving_arm(arm.with_payload(motion.payload), none, motion.q, motion.dq, motion.ddq)
    acting = as_acting(effects, np.asarray(motion.tau), motion.interval)
    return replace(motion, tau=acting - carried_torque(effects, moving))
