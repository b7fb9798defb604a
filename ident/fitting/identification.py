"""From the joint estimate to an arm: identified inertias, loss parameters with intervals, and what is confounded.

`nominal` keeps the URDF's inertias and fits the losses beside them; how far the URDF may be off is estimated from the
same recordings and widens the intervals. `base` takes the base parameters as they come and changes the URDF's numbers
as little as that needs. `consistent` takes the nearest ones that a real arm could have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from ident.arrays import Array, Float, Int, freeze
from ident.command_options import Inertia
from ident.fitting.choice import Choice
from ident.fitting.joint_estimate import (
    FitSums,
    JointEstimate,
    estimate,
    find_frictionless,
    lossless_parameters,
    quantile,
)
from ident.laws.carried import NamedLaw
from ident.model.inertia import (
    PRIOR_SHARE,
    BaseParameters,
    InertiaResults,
    base_prior,
    compute_condition,
    parameter_scale,
    solve_bounded,
)
from ident.model.loss import NAMES, InertiaFigure, LossParameters, LossResults
from ident.regression.design import LOSS_PARAMETERS
from ident.robot.arm import ArmModel

# Parameters whose estimates are correlated beyond this are reported as a pair that the recordings can't tell apart.
TIED = 0.95
# Pairs that are reported in words; all stand in the model.
MOST_TIED = 4
# An estimate this near to zero, in standard deviations, lies on its bound.
ON_BOUND = 1e-3


@dataclass(frozen=True, eq=False)
class Identified:
    """What was identified."""

    inertia: InertiaResults  # the arm and its base parameters
    loss: LossResults  # loss parameters
    inertias: tuple[InertiaFigure, ...]  # base parameters with intervals
    # Pairs of parameters that these recordings can't tell apart, with their correlation.
    tied: tuple[tuple[str, str, float], ...]
    urdf_share: float  # how far the URDF's inertias are off, as a share of each link's scale; as the recordings have it
    through_reversals: tuple[str, ...]  # joints whose samples near reversals had to be used
    estimate: JointEstimate  # the unbounded joint estimate
    named: tuple[NamedLaw, ...] = ()  # laws that were given, with their parameters
    lossless: tuple[str, ...] = ()  # joints whose effort holds neither friction nor a rotor: torque at the link

    def record(self) -> dict[str, Any]:
        """What a model keeps of it beside its parameters."""
        return {
            "residual_rms_Nm": self.loss.residual_rms.tolist(),
            "condition_number": self.inertia.condition_number,
            "friction_spread": {kind: self.estimate.spread.tolist() for kind in ("viscous", "coulomb")},
            "urdf_share": self.urdf_share,
            "tied": [{"figures": [one, other], "correlation": value} for one, other, value in self.tied],
            "through_reversals": list(self.through_reversals),
            "lossless": list(self.lossless),
        }


def identify(sums: FitSums, choice: Choice | None = None) -> Identified:
    """Identifies an arm from one pass over its runs.

    Args:
        sums: The pass.
        choice: What runs left out chose, with the same offsets and laws; the kind of inertias is that of the options
            if None, `consistent` where they leave it open.
    """
    nominal, base = sums.baseline.nominal, sums.baseline.base
    asked = sums.options.inertia
    mode: Inertia = choice.kind if choice is not None else "consistent" if asked == "auto" else asked
    scale = parameter_scale(nominal)
    frictionless, found = find_frictionless(estimate(sums), nominal.n, lambda joints: estimate(sums.through(joints)))
    share = urdf_share(found, base, scale)
    prior = base_prior(base, max(share, 1e-6) * scale) if mode == "nominal" else None
    if choice is not None and not choice.whitened:
        found = with_plain_rows(found, choice, prior)
    elif prior is not None:
        found = found.without_inertias(prior)
    zero = lossless_parameters(found, frictionless)
    # All losses but offsets can't be negative, nor laws' coefficients as their kind says.
    positions, first = [found.index(j)[:3] for j in range(nominal.n)], found.first_law
    for law in sums.laws:
        positions.append(first + np.array(law.kind.nonnegative, dtype=int))
        first += law.size
    prior_share = PRIOR_SHARE.get(mode, 0.0) if choice is None else choice.share
    change, solved = _within_bounds(found, nominal, base, mode, (np.concatenate(positions), zero), prior_share)
    losses = np.array([solved[found.index(j) - base.rank] for j in range(nominal.n)])
    coefficients = solved[found.first_law - base.rank :]
    half = (quantile(found.dof) * found.std)[found.first_law :]
    triples = iter(np.stack([coefficients, coefficients - half, coefficients + half], axis=1).tolist())
    laws = tuple(replace(law, figures=tuple(map(tuple, islice(triples, law.size)))) for law in sums.laws)
    arm = nominal if mode == "nominal" else nominal.with_inertial_parameters(nominal.inertial_parameters + change)
    informed = 1.0 - np.diag(found.covariance)[: base.rank] / np.diag(np.linalg.inv(sums.baseline.prior))
    inertia = InertiaResults(
        arm=arm,
        base=base,
        change=freeze(base.mapping @ change),
        std=freeze(found.std[: base.rank]),
        informed=freeze(np.clip(informed, 0.0, 1.0)),
        condition_number=compute_condition(found.information[: base.rank, : base.rank]),
    )
    loss = _loss_results(found, losses, nominal.joint_names, sums.baseline.loss.transition_speed)
    inertias = () if mode == "nominal" else inertia.figures(quantile(found.dof[: base.rank]) * inertia.std)
    tied = tied_figures(found, base, nominal.joint_names, sums.laws)
    lossless = tuple(name for j, name in enumerate(nominal.joint_names) if found.index(j)[0] in zero)
    return Identified(inertia, loss, inertias, tied, share, sums.through_reversals, found, laws, lossless)


def with_plain_rows(found: JointEstimate, choice: Choice, held: Float[Array, "r r"] | None = None) -> JointEstimate:
    """The estimate by plain rows, with intervals that hold what whitened ones say beside.

    Where both are right, their difference has the variance by which plain rows are worse; where the noise is not what
    whitening takes it for, it is what the interval has to hold beside. Source: Hausman 1978.

    Args:
        found: The estimate by whitened rows.
        choice: What was chosen, with the sums of plain rows.
        held: Information on the base parameters that lies in the URDF, where the inertias are held at its own.
    """
    problem = choice.problem()
    values = choice.solved("base" if held is None else "nominal", signed=False)
    usual = found if held is None else found.without_inertias(held)
    covariance = usual.covariance + np.diag((values - usual.values) ** 2)
    return replace(found, values=values, covariance=covariance, information=problem.information, score=problem.score)


def urdf_share(found: JointEstimate, base: BaseParameters, scale: Float[Array, " 10n"]) -> float:
    """How far the URDF's inertial numbers are off, as a share of `scale`: where the change has its expected size.

    Solves Δβᵀ (C + s² B S² Bᵀ)⁻¹ Δβ = r for s, C the covariance of the data's Δβ. Source: Paule and Mandel 1982.
    """
    rank, cross = base.rank, found.information[: base.rank, base.rank :]
    own = np.linalg.pinv(found.information[rank:, rank:], hermitian=True)
    # What the data tell of the base parameters once the losses are free.
    information = found.information[:rank, :rank] - cross @ own @ cross.T
    score = found.score[:rank] - cross @ own @ found.score[rank:]
    root = np.linalg.cholesky((base.mapping * scale**2) @ base.mapping.T)
    whitened = root.T @ information @ root
    values, vectors = np.linalg.eigh(whitened)
    values = np.maximum(values, 0.0)
    projected = (vectors.T @ (root.T @ score)) ** 2
    known = values > 1e-9 * values.max()

    def excess(share: float) -> float:
        # In the eigenbasis the data's change is projected / values, its variance 1 / values + share².
        return float(np.sum(projected[known] / (values[known] * (1.0 + share**2 * values[known]))) - known.sum())

    low, high = 0.0, PRIOR_SHARE["base"]
    if excess(low) <= 0.0:
        return 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return high


def _within_bounds(
    found: JointEstimate,
    arm: ArmModel,
    base: BaseParameters,
    mode: Inertia,
    bounds: tuple[Int[Array, " b"], Int[Array, " z"]],
    share: float,
) -> tuple[Float[Array, " 10n"], Float[Array, " m-r"]]:
    """Change of the inertial numbers, and losses with all that stands behind them.

    `bounds` are positions among the estimate's parameters: of those that can't be negative, and that are zero; `share`
    is how far the URDF's numbers may be off, as a share of each link's scale.
    """
    nonnegative, zero = bounds
    rank, size = base.rank, len(found.values)
    numbers = 0 if mode == "nominal" else 10 * arm.n
    # Unknowns: changes of all inertial numbers in units of how far a URDF may be off, then the losses as they are.
    unit = share * parameter_scale(arm)[:numbers]
    lift = np.zeros((size, numbers + size - rank))
    lift[:rank, :numbers] = base.mapping[:, :numbers] * unit
    lift[rank:, numbers:] = np.eye(size - rank)
    information = lift.T @ found.information @ lift
    information[:numbers, :numbers] += np.eye(numbers)
    kept = np.setdiff1d(np.arange(len(information)), zero - rank + numbers)
    bounded = np.flatnonzero(np.isin(kept, nonnegative - rank + numbers))
    links = arm.inertial_parameters if mode == "consistent" else None
    solved = np.zeros(len(information))
    solved[kept] = solve_bounded(information[np.ix_(kept, kept)], (lift.T @ found.score)[kept], bounded, links, unit)
    change = np.zeros(10 * arm.n)
    change[:numbers] = unit * solved[:numbers]
    return change, solved[numbers:]


def _loss_results(
    found: JointEstimate, losses: Float[Array, "n p"], joints: tuple[str, ...], widths: Float[Array, " n"]
) -> LossResults:
    n, per = losses.shape
    values, covariance, dof = np.zeros((n, 4)), np.zeros((n, 4, 4)), np.full((n, 4), np.inf)
    values[:, :per] = losses
    for j in range(n):
        index = found.index(j)
        covariance[j, :per, :per] = found.covariance[np.ix_(index, index)]
        dof[j, :per] = found.dof[index]
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    bound = tuple(tuple(NAMES[k] for k in range(3) if values[j, k] <= ON_BOUND * std[j, k] + 1e-12) for j in range(n))
    return LossResults(
        params=LossParameters(values[:, 0], values[:, 1], values[:, 2], values[:, 3], widths),
        joints=joints,
        covariance=covariance,
        residual_rms=freeze(found.noise),
        at_bound=bound,
        dof=freeze(dof),
    )


def describe(found: Identified) -> list[str]:
    """What a person should know of an identification beside its parameters, a line each."""
    condition = f"condition number of the motions: {found.inertia.condition_number:.0f}"
    lines = [condition, f"the URDF's inertias are off by about {100 * found.urdf_share:.1f} % of each link's scale"]
    joints = zip(found.loss.joints, 100 * found.estimate.spread, strict=True)
    reported = ", ".join(f"{name} {spread:.1f}" for name, spread in joints)
    lines.append(f"friction changes from run to run by (%): {reported}")
    if found.tied:
        pairs = ", ".join(f"{one} with {other}" for one, other, _ in found.tied[:MOST_TIED])
        more = len(found.tied) - MOST_TIED
        lines.append(f"not distinguished by these motions: {pairs}" + (f", and {more} more pairs" if more > 0 else ""))
    lines += [law.describe(found.loss.joints) for law in found.named]
    if found.through_reversals:
        lines.append(f"too little clear of reversals, fitted through them: {', '.join(found.through_reversals)}")
    if found.lossless:
        lines.append(f"effort without friction or rotor, as of torque at the link: {', '.join(found.lossless)}")
    return lines


def tied_figures(
    found: JointEstimate, base: BaseParameters, joints: tuple[str, ...], named: Sequence[NamedLaw] = ()
) -> tuple[tuple[str, str, float], ...]:
    """Pairs of parameters whose estimates are so correlated that only a combination of them is known."""
    names = [*base.names, *(f"{joint}.{name}" for joint in joints for name in NAMES[:LOSS_PARAMETERS])]
    names += [f"{joint}.{NAMES[-1]}" for joint in joints] if found.offset else []
    names += [f"{joints[law.joint]}.{law.effect}.{k + 1}" for law in named for k in range(law.size)]
    std = np.maximum(found.std, 1e-300)
    correlation = found.covariance / np.outer(std, std)
    pairs = np.argwhere(np.triu(np.abs(correlation) > TIED, 1))
    ranked = sorted(pairs.tolist(), key=lambda pair: -abs(correlation[pair[0], pair[1]]))
    return tuple((names[a], names[b], float(correlation[a, b])) for a, b in ranked)
