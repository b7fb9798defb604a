"""From the joint estimate to an arm: inertias, loss parameters with intervals, what is confounded.

`nominal` keeps the URDF's inertias and fits the losses beside them; how far the URDF may be off is
estimated from the same recordings and widens the intervals. `base` takes the base parameters as
they come and changes the URDF's numbers as little as that needs. `consistent` takes the nearest
ones that a real arm could have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from ident.command_options import Inertia
from ident.fitting.chosen import ModelChoice
from ident.fitting.fit_sums import FitSums
from ident.fitting.frictionless import find_frictionless, lossless_parameters
from ident.fitting.held_out_sums import part_of_blocks
from ident.fitting.joint_estimate import ON_BOUND, JointEstimate, estimate, estimates_left_out
from ident.fitting.within_bounds import BoundedEstimate, nonnegative, within_bounds
from ident.laws.carried import NamedLaw
from ident.model.inertia import BaseParameters, InertiaResults, base_prior, compute_condition
from ident.model.loss import NAMES, InertiaFigure, LossParameters, LossResults
from ident.regression.design import LOSS_PARAMETERS
from ident.regression.partition import partition_motions
from ident.robot.tolerance import PRIOR_SHARE, parameter_scale

# Parameters whose estimates are correlated beyond this are reported as a pair that the recordings
# can't tell apart.
TIED = 0.95
# Halvings of the interval in which that share is looked for.
HALVINGS = 60


@dataclass(frozen=True, eq=False)
class Identified:
    """What was identified."""

    inertia: InertiaResults  # the arm and its base parameters
    loss: LossResults  # loss parameters
    inertias: tuple[InertiaFigure, ...]  # base parameters with intervals
    # Pairs of parameters that these recordings can't tell apart, with their correlation.
    tied: tuple[tuple[str, str, float], ...]
    # How far the URDF's inertias are off, as a share of each link's scale; as the recordings have
    # it.
    urdf_share: float
    through_reversals: tuple[str, ...]  # joints whose samples near reversals had to be used
    estimate: JointEstimate  # the unbounded joint estimate
    named: tuple[NamedLaw, ...] = ()  # laws that were given, with their parameters
    # Joints whose effort holds neither friction nor a rotor: torque at the link.
    lossless: tuple[str, ...] = ()
    # Whether the parameters come from plain rows of all motion; from whitened ones clear of
    # reversals otherwise.
    plain_rows: bool = False

    def record(self) -> dict[str, object]:
        """What a model keeps of it beside its parameters."""
        tied = [{"figures": list(pair), "correlation": value} for *pair, value in self.tied]
        spread = self.estimate.spread.tolist()
        return {
            "residual_rms_Nm": self.loss.residual_rms.tolist(),
            "condition_number": self.inertia.condition_number,
            "friction_spread": {"viscous": spread, "coulomb": spread},
            "urdf_share": self.urdf_share,
            "tied": tied,
            "through_reversals": list(self.through_reversals),
            "lossless": list(self.lossless),
        }


def identify(sums: FitSums, choice: ModelChoice | None = None) -> Identified:
    """Identifies an arm from one pass over its runs.

    Args:
        sums: The pass.
        choice: What runs left out chose, with the same offsets and laws; the kind of inertias is
            that of the options if None, `consistent` where they leave it open.
    """
    nominal = sums.baseline.nominal
    base = sums.baseline.base
    mode = _kind_of_inertia(sums, choice)
    scale = parameter_scale(nominal)
    frictionless, whitened = find_frictionless(
        estimate(sums), nominal.n, lambda joints: estimate(sums.through(joints))
    )
    share = urdf_share(whitened, base, scale)
    urdf = base_prior(base, max(share, sums.baseline.settings.known_share) * scale)
    held = urdf if mode == "nominal" else None
    usual = whitened.believing(urdf) if held is None else whitened.without_inertias(held)
    plain = choice is not None and not whitened_as_good(sums, frictionless, choice)
    if choice is not None and plain:
        usual = with_plain_rows(usual, choice, held)
    zero = lossless_parameters(whitened, frictionless)
    bounds = (nonnegative(usual, nominal.n, sums.laws), zero)
    prior_share = PRIOR_SHARE.get(mode, 0.0) if choice is None else choice.share
    solution = within_bounds(usual, nominal, base, mode, bounds, prior_share)
    unbounded = solution.estimate
    values = solution.values(base)
    inertia = _inertia_results(sums, solution, values, mode, urdf)
    inertias: tuple[InertiaFigure, ...] = ()
    if mode != "nominal":
        inertias = inertia.figures(unbounded.limits(values)[: base.rank])
    lossless = []
    for joint, name in enumerate(nominal.joint_names):
        if unbounded.index(joint)[0] in solution.zero:
            lossless.append(name)
    return Identified(
        inertia=inertia,
        loss=_loss_results(solution, values, sums),
        inertias=inertias,
        tied=tied_figures(unbounded, base, nominal.joint_names, sums.laws),
        urdf_share=share,
        through_reversals=sums.through_reversals,
        estimate=unbounded,
        named=_with_figures(sums.laws, unbounded, values),
        lossless=tuple(lossless),
        plain_rows=plain,
    )


def whitened_as_good(sums: FitSums, frictionless: Bool[Array, " n"], choice: ModelChoice) -> bool:
    """Whether parts left out are foretold as well by whitened rows as by plain ones.

    Of recordings so long that the choice was made by stretches of them, plain rows are taken.

    Args:
        sums: The pass over the runs.
        frictionless: Joints all of whose moving rows count.
        choice: What runs left out chose.
    """
    if choice.whitened is not None:
        return choice.whitened
    moving = np.sum([motion.moving.sum(axis=0) for motion in sums.motions], axis=0)
    if not np.array_equal(moving, choice.sums.counts.sum(axis=0)):
        return False
    clear = sums.through(frictionless) if frictionless.any() else sums
    partition = partition_motions(sums.motions, clear.evidence.settings)
    blocks = part_of_blocks(sums.motions, partition)
    return choice.foretell_as_well(estimates_left_out(clear, blocks, choice.sums.parts))


def _kind_of_inertia(sums: FitSums, choice: ModelChoice | None) -> Inertia:
    if choice is not None:
        return choice.kind
    asked = sums.options.inertia
    return "consistent" if asked == "auto" else asked


def _inertia_results(
    sums: FitSums,
    solution: BoundedEstimate,
    values: Float[Array, " m"],
    mode: Inertia,
    urdf: Float[Array, "r r"],
) -> InertiaResults:
    """The arm with its identified inertias, and how well they are known.

    Args:
        sums: The pass over the runs.
        solution: The estimate within its bounds.
        values: All parameters.
        mode: How the links' inertias may change.
        urdf: Information on the base parameters that lies in the URDF.
    """
    nominal = sums.baseline.nominal
    base = sums.baseline.base
    unbounded = solution.estimate
    arm = nominal
    if mode != "nominal":
        arm = nominal.with_inertial_parameters(nominal.inertial_parameters + solution.change)
    before = np.diag(np.linalg.inv(urdf))
    informed = 1.0 - np.diag(unbounded.covariance)[: base.rank] / before
    information = unbounded.information[: base.rank, : base.rank]
    return InertiaResults(
        arm=arm,
        base=base,
        change=freeze(base.mapping @ solution.change),
        std=freeze(np.sqrt(np.diag(unbounded.about(values)))[: base.rank]),
        informed=freeze(np.clip(informed, 0.0, 1.0)),
        condition_number=compute_condition(information),
    )


def _with_figures(
    laws: Sequence[NamedLaw], unbounded: JointEstimate, values: Float[Array, " m"]
) -> tuple[NamedLaw, ...]:
    """The laws with their coefficients and the ends of their intervals.

    Args:
        laws: The laws.
        unbounded: The estimate without bounds.
        values: All parameters within their bounds.
    """
    figures = np.column_stack([values, unbounded.limits(values)]).tolist()
    fitted = []
    start = unbounded.first_law
    for law in laws:
        triples = [(value, low, high) for value, low, high in figures[start : start + law.size]]
        fitted.append(replace(law, figures=tuple(triples)))
        start += law.size
    return tuple(fitted)


def with_plain_rows(
    whitened: JointEstimate, choice: ModelChoice, held: Float[Array, "r r"] | None = None
) -> JointEstimate:
    """The estimate by plain rows, which knows how far it lies beside that of whitened ones.

    Where both are right, those of whitened rows have the least variance, and the difference is
    known: intervals are those of the values of least variance. Where the noise is not what
    whitening takes it for, plain values may lie outside; intervals then reach as far as they do.

    Args:
        whitened: The estimate by whitened rows.
        choice: What was chosen, with the sums of plain rows.
        held: Information on the base parameters that lies in the URDF, where the inertias are held
            at its own.

    Source: Hausman 1978.
    """
    problem = choice.problem()
    values = choice.solved("base" if held is None else "nominal", signed=False)
    return replace(
        whitened,
        values=values,
        information=problem.information,
        score=problem.score,
        efficient=whitened.values,
    )


def urdf_share(whitened: JointEstimate, base: BaseParameters, scale: Float[Array, " 10n"]) -> float:
    """How far the URDF's inertial numbers are off, as a share of `scale`.

    Solves Δβᵀ (C + s² B S² Bᵀ)⁻¹ Δβ = r for s, C the covariance of the data's Δβ: where the change
    has its expected size.

    Source: Paule and Mandel 1982.
    """
    rank = base.rank
    cross = whitened.information[:rank, rank:]
    inverse = np.linalg.pinv(whitened.information[rank:, rank:], hermitian=True)
    # What the data tell of the base parameters once the losses are free.
    information = whitened.information[:rank, :rank] - cross @ inverse @ cross.T
    score = whitened.score[:rank] - cross @ inverse @ whitened.score[rank:]
    root = np.linalg.cholesky((base.mapping * scale**2) @ base.mapping.T)
    values, vectors = np.linalg.eigh(root.T @ information @ root)
    values = np.maximum(values, 0.0)
    projected = (vectors.T @ (root.T @ score)) ** 2
    known = values > 1e-9 * values.max()

    def excess(share: float) -> float:
        # In the eigenbasis the data's change is projected / values, its variance 1 / values +
        # share².
        expected = values[known] * (1.0 + share**2 * values[known])
        return float(np.sum(projected[known] / expected) - known.sum())

    low = 0.0
    high = PRIOR_SHARE["base"]
    if excess(low) <= 0.0:
        return 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if excess(middle) > 0.0:
            low = middle
        else:
            high = middle
    return high


def _loss_results(
    solution: BoundedEstimate, values: Float[Array, " m"], sums: FitSums
) -> LossResults:
    """Loss parameters with what their intervals rest on."""
    unbounded = solution.estimate
    n, fitted = solution.losses.shape
    losses = np.zeros((n, len(NAMES)))
    losses[:, :fitted] = solution.losses
    covariance = np.zeros((n, len(NAMES), len(NAMES)))
    dof = np.full((n, len(NAMES)), np.inf)
    least_std = np.zeros((n, len(NAMES)))
    shift = np.zeros((n, len(NAMES)))
    known = unbounded.about(values)
    for j in range(n):
        index = unbounded.index(j)
        covariance[j, :fitted, :fitted] = known[np.ix_(index, index)]
        dof[j, :fitted] = unbounded.dof[index]
        least_std[j, :fitted] = unbounded.std[index]
        shift[j, :fitted] = unbounded.shift(values)[index]
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    on_bound = losses <= ON_BOUND * std + 1e-12
    at_bound = []
    for j in range(n):
        places = np.flatnonzero(on_bound[j, :LOSS_PARAMETERS])
        at_bound.append(tuple(NAMES[k] for k in places))
    widths = sums.baseline.loss.transition_speed
    return LossResults(
        params=LossParameters(losses[:, 0], losses[:, 1], losses[:, 2], losses[:, 3], widths),
        joints=sums.baseline.nominal.joint_names,
        covariance=covariance,
        least_std=freeze(least_std),
        shift=freeze(shift),
        residual_rms=freeze(unbounded.noise),
        at_bound=tuple(at_bound),
        dof=freeze(dof),
    )


def tied_figures(
    unbounded: JointEstimate,
    base: BaseParameters,
    joints: tuple[str, ...],
    named: Sequence[NamedLaw] = (),
) -> tuple[tuple[str, str, float], ...]:
    """Pairs of parameters so correlated that only a combination of them is known.

    Returns:
        Two names and their correlation, the strongest first; empty where all are told apart.
    """
    names = list(base.names)
    for joint in joints:
        names += [f"{joint}.{name}" for name in NAMES[:LOSS_PARAMETERS]]
    if unbounded.offset:
        names += [f"{joint}.{NAMES[-1]}" for joint in joints]
    for law in named:
        names += [f"{joints[law.joint]}.{law.effect}.{k + 1}" for k in range(law.size)]
    std = np.maximum(unbounded.std, 1e-300)
    correlation = unbounded.covariance / np.outer(std, std)
    pairs = np.argwhere(np.triu(np.abs(correlation) > TIED, 1)).tolist()
    pairs.sort(key=lambda pair: -abs(correlation[pair[0], pair[1]]))
    return tuple((names[a], names[b], float(correlation[a, b])) for a, b in pairs)
