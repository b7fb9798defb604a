"""From a session's sums to its causes: the one inference from end to end.

    sums -> sets and variances of three starts (`infer`) -> fine grids (`refine`) -> features
    -> probabilities and parameters

An effect whose class is likelier than not is a name. The others are reported with their probability
and what speaks against them; nothing is struck out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Float
from ident.effects.base import SessionContext
from ident.inference.calibration import Calibration, load_calibration
from ident.inference.estimate import Estimate, Reason, estimate
from ident.inference.features import Described, describe
from ident.inference.held_out_views import Scorers
from ident.inference.infer import Inference, Inferred, infer
from ident.inference.joints_left import JointLeft, Repeated, beside_others, describe_joints
from ident.inference.refine import refine
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior

# Likelier than not.
EVEN_ODDS = 0.5


@dataclass(frozen=True, eq=False)
class Named:
    """A chosen effect with what was found of it."""

    group: Group  # at its point of the fine grid
    described: Described  # features, rivals, held-out scores
    estimate: Estimate  # parameters and probability
    before: HeldOutScore  # held-out score without it, beside those named before it
    after: HeldOutScore  # the same with it

    @property
    def absorbed(self) -> bool:
        """Whether tuned inertias hide it, so that it was scored with the inertias of the URDF."""
        return self.described.view.fixed

    @property
    def affected_joints(self) -> list[int]:
        """Indices of its own joint or, for an effect of the whole arm, of the joints where it
        shows.
        """
        return list(self.described.joints)

    @property
    def named_joints(self) -> list[int]:
        """Indices of the joints to name it with.

        The one joint of an effect whose scope is a joint, wherever it shows; else
        `affected_joints`.
        """
        if self.group.effect.scope == "joint":
            return [self.group.joint]
        return self.affected_joints

    @property
    def log_score(self) -> tuple[float, float]:
        """Gain of log score on parts that the fit never saw, and its standard error [nats]."""
        return self.described.view.after.gain_over(self.described.view.before)

    @property
    def log_evidence(self) -> float:
        """What it adds to the session's log evidence [nats]."""
        return float(np.expm1(self.described.features["log_nats"]))


@dataclass(frozen=True, eq=False)
class Conclusion:
    """The causes of a session.

    Attributes:
        inference: What was reached on coarse grids.
        fine: The likeliest set on fine grids, with the names of other sets.
        scorers: Cross-validated scores on the fine grids' sums.
        names: The effects that are likelier than not, in the order of the torque that they explain.
        unlikely: The other chosen effects.
        ladder: Held-out scores without effects, and after each name.
        joints: What is left at each joint, and how probably it is a cause without a name.
    """

    inference: Inference
    fine: Inferred
    scorers: Scorers
    names: tuple[Named, ...]
    unlikely: tuple[Named, ...]
    ladder: tuple[HeldOutScore, ...]
    joints: Mapping[int, JointLeft]
    calibration: Calibration

    @property
    def groups(self) -> list[Group]:
        """Columns of `names` in the fine grids' sums, in the same order."""
        return [name.group for name in self.names]

    @property
    def evidence(self) -> Evidence:
        """Sums of the names on fine grids, with friction's spread and dispersion."""
        return self.scorers.tuned.evidence

    @property
    def prior(self) -> Prior:
        """What the URDF says of the base parameters, as `held_out` uses it."""
        return self.scorers.tuned.prior

    @property
    def held_out(self) -> HeldOut:
        """Cross-validation of models on left-out parts of the session, beside tuned inertias."""
        return self.scorers.tuned

    def with_repeated(self, repeated: Sequence[Repeated]) -> Conclusion:
        """The same causes, with what the same angles of other runs predict of each joint's residual
        among what is left there.
        """
        joints = {j: left.with_repeated(repeated[j]) for j, left in self.joints.items()}
        return replace(self, joints=joints)

    def gap_probability(self) -> Float[np.ndarray, " n"]:
        """For each joint the probability, from 0 to 1, that a cause without a name is left there.

        Returns:
            By joint; 0 for a joint without rows.
        """
        probability = np.zeros(self.evidence.layout.n)
        features = beside_others([left.features for left in self.joints.values()])
        for joint, values in zip(self.joints, features, strict=True):
            probability[joint] = self.calibration.gaps.probability(values)
        return probability


def conclude(
    evidence: Evidence,
    baseline: Baseline,
    session: SessionContext,
    calibration: Calibration | None = None,
) -> Conclusion:
    """The causes of a session.

    Args:
        evidence: Block sums of all candidates, with discrepancies' columns.
        baseline, session: The tuned model, and the runs.
        calibration: Fitted numbers; those that the package ships if None.
    """
    if calibration is None:
        calibration = load_calibration()
    inference = infer(evidence, baseline, session)
    refined = refine(inference, session, baseline)
    described = describe(inference, refined, session)
    estimates = estimate(described, session, calibration)
    sure, _ = _consistent(described, estimates)
    likely = [described[k].group for k in sure]
    best = refined.best
    fine = Inferred.of(best.model, best.search, _with(best.chosen, likely))
    scorers = Scorers.of(fine)
    told = tell(described, estimates, scorers)
    names = [name.group for name in told.names]
    left = describe_joints(fine, names, scorers.tuned)
    return Conclusion(
        inference=inference,
        fine=fine,
        scorers=scorers,
        names=told.names,
        unlikely=told.unlikely,
        ladder=told.ladder,
        joints={of_joint.joint: of_joint for of_joint in left},
        calibration=calibration,
    )


@dataclass(frozen=True, eq=False)
class Told:
    """Chosen effects by whether they are likelier than not."""

    names: tuple[Named, ...]  # the likelier ones, in the order of the torque that they explain
    unlikely: tuple[Named, ...]
    ladder: tuple[HeldOutScore, ...]  # held-out scores without effects, and after each name


def tell(described: Sequence[Described], estimates: Sequence[Estimate], scorers: Scorers) -> Told:
    """Which of the chosen effects are names.

    Args:
        described, estimates: The effects with their features, and with their probabilities.
        scorers: Cross-validated scores of models with some of them.

    Returns:
        The names in the order of the torque that they explain, the other effects, and the held-out
        scores without effects and after each name.
    """
    sure, hidden = _consistent(described, estimates)
    estimates = list(estimates)
    for k, by in hidden.items():
        estimates[k] = _behind(estimates[k], estimates[by])
    order = sorted(sure, key=lambda k: -_explained(described[k]))
    ladder = [scorers.tuned.score()]
    names: list[Named] = []
    for k in order:
        effect = described[k]
        chosen = [name.group for name in names]
        scorer = scorers.fixed if effect.view.fixed else scorers.tuned
        named = Named(
            group=effect.group,
            described=effect,
            estimate=estimates[k],
            before=scorer.score(chosen),
            after=scorer.score([*chosen, effect.group]),
        )
        names.append(named)
        ladder.append(scorers.tuned.score([name.group for name in names]))
    unlikely = []
    for k, effect in enumerate(described):
        if k not in sure:
            view = effect.view
            named = Named(effect.group, effect, estimates[k], view.before, view.after)
            unlikely.append(named)
    return Told(tuple(names), tuple(unlikely), tuple(ladder))


def _consistent(
    described: Sequence[Described], estimates: Sequence[Estimate]
) -> tuple[list[int], dict[int, int]]:
    """The effects that are likelier than not, the likeliest first, and those that one of them
    hides.

    Of two sets, an effect of one may explain what an effect of the other does: of these one alone
    is a name, that which explains more where both were weighed in one set, or else the likelier.
    What explains more than each of its rivals among the names takes the place of all.
    Effects of one set explain what the others leave, so both may be.
    """
    order = sorted(range(len(described)), key=lambda k: -estimates[k].class_probability)
    names: list[int] = []
    hidden: dict[int, int] = {}
    for k in order:
        if estimates[k].class_probability < EVEN_ODDS:
            break
        rivals = [other for other in names if _rival(described[k], described[other])]
        better = [other for other in rivals if _log_odds(estimates[k], estimates[other]) <= 0.0]
        if better:
            hidden[k] = better[0]
            continue
        names = [other for other in names if other not in rivals]
        names.append(k)
        hidden = {behind: k if by in rivals else by for behind, by in hidden.items()}
        hidden |= dict.fromkeys(rivals, k)
    return names, hidden


def _log_odds(first: Estimate, second: Estimate) -> float:
    """Log odds of one effect against another that explains the same, each by the sums of its own
    set; the mean where both sets weigh them, 0 where neither does [nats].
    """
    weighed = []
    for weighing, other, sign in ((first, second, 1.0), (second, first, -1.0)):
        odds = weighing.odds.get(other.group.effect.id)
        if weighing.group.effect.id == other.group.effect.id:
            odds = weighing.places.get(other.group.joint)
        if odds is not None:
            weighed.append(sign * float(np.log(odds)))
    return float(np.mean(weighed)) if weighed else 0.0


def _behind(estimate: Estimate, named: Estimate) -> Estimate:
    """An effect's estimate where a likelier one explains the same torque: it is left what that
    leaves.
    """
    left = 1.0 - named.class_probability
    reason = Reason(
        "rival_behind",
        float(np.log(max(left, 1e-12))),
        "a likelier cause explains the same",
    )
    return replace(
        estimate,
        probability=estimate.probability * left,
        reasons=(reason, *estimate.reasons),
    )


def _rival(first: Described, second: Described) -> bool:
    """Whether two effects of different sets explain the same torque."""
    if first.solution is second.solution:
        return False
    return second.coarse.key in first.rivals or first.coarse.key in second.rivals


def _with(chosen: Sequence[Group], names: Sequence[Group]) -> list[Group]:
    """A set with some names, each at its own point."""
    keys = {name.key for name in names}
    return [*names, *(group for group in chosen if group.key not in keys)]


def _explained(effect: Described) -> float:
    """Mean square that an effect closes on unseen parts, over its joints [N² m²]."""
    joints = list(effect.joints)
    old = effect.view.before.rms[joints]
    new = effect.view.after.rms[joints]
    return float(np.sum(old**2 - new**2))
