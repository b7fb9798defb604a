"""The baseline that every effect is judged against: the user's arm after the best tuning of what it has.

Tunable are the link inertias (held near the URDF by a prior), rotor inertia, viscous and Coulomb friction. What that
tuning can explain is no effect; what an effect explains beyond it is its visible part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ident.arrays import Array, Float
from ident.diagnosis.regression.settings import USUAL_REGRESSION, RegressionSettings
from ident.model.inertia import BaseParameters, base_prior, fit_inertia, parameter_scale
from ident.model.loss import LossModel, LossParameters
from ident.model.presliding import Sliding, fit_sliding
from ident.motion.motion import Motion
from ident.motion.out_of_core import few
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class Baseline:
    """The tuned model.

    Attributes:
        nominal: The arm as the URDF describes it.
        arm: The arm after tuning.
        base: Its base parameters.
        prior: Information on the base parameters' change that lies in the URDF, shape (r, r).
        loss: Tuned loss figures.
        sliding: How each joint's dry friction turns round.
        number_std: Standard deviation of each link's inertial numbers, as believed.
        settings: What the regression counts with.
    """

    nominal: ArmModel
    arm: ArmModel
    base: BaseParameters
    prior: Float[Array, "r r"]
    loss: LossParameters
    sliding: Sliding
    number_std: Float[Array, " 10n"]
    settings: RegressionSettings = USUAL_REGRESSION

    def prior_of_a_wrong_link(self, link: int, factor: float) -> Float[Array, "r r"]:
        """Information on the base parameters' change if one link's numbers are believed less, by a factor."""
        scale = self.number_std.copy()
        scale[10 * link : 10 * (link + 1)] *= factor
        return base_prior(self.base, scale)


def fit_baseline(
    motions: Sequence[Motion],
    arm: ArmModel,
    share: float | None = None,
    settings: RegressionSettings = USUAL_REGRESSION,
) -> Baseline:
    """Tunes the arm on all runs.

    Args:
        motions: All runs; of a spooled session an even choice is enough to linearise about.
        arm: The arm as its user has it.
        share: Standard deviation of its inertial numbers, as a share of each link's own; that of a URDF if None.
        settings: What the regression counts with.
    """
    share = settings.inertia_share if share is None else share
    motions = few(motions)
    model = LossModel()
    results = fit_inertia(motions, arm, "base", model, share)
    rigid = [rigid_torque(results.arm, motion) for motion in motions]
    loss = model.fit(motions, rigid)
    number_std = share * parameter_scale(arm)
    prior = base_prior(results.base, number_std)
    sliding = fit_sliding(motions, rigid)
    return Baseline(arm, results.arm, results.base, prior, loss.params, sliding, number_std, settings)


def rigid_torque(arm: ArmModel, motion: Motion) -> Float[Array, "T n"]:
    """Rigid torque of a run with its known payload [N m]."""
    return arm.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
