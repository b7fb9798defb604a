"""The baseline that every effect is judged against: the user's arm after the best tuning of what it has.

Tunable are the link inertias (held near the URDF by a prior), rotor inertia, viscous and Coulomb friction. What that
tuning can explain is no effect; what an effect explains beyond it is its visible part.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.model.inertia import BaseParameters, base_prior, parameter_scale
from ident.model.linearisation import Sliding, fit_sliding, rigid_torque, tune_arm
from ident.model.loss import LossParameters
from ident.motion.motion import Motion
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings
from ident.robot.arm import ArmModel


@dataclass(frozen=True)
class UrdfError:
    """How far off a URDF's inertias are believed to be."""

    scale: float = 1.0  # of each link's numbers in their own size, in units of the usual belief
    # Of every link's centre of mass besides, root mean square distance [m]: what a drawing's other origin or a hose's
    # weight does to a short link as much as to a long one.
    com_m: float = 0.0
    # Links that are believed as any URDF's all the same: what is off there is to have a name.
    usual: frozenset[int] = frozenset()

    def divided(self, factor: float) -> UrdfError:
        """Both smaller by a factor."""
        return UrdfError(self.scale / factor, self.com_m / factor, self.usual)


@dataclass(frozen=True, eq=False)
class Baseline:
    """The tuned model."""

    nominal: ArmModel  # the arm as the URDF describes it
    arm: ArmModel  # the arm after tuning
    base: BaseParameters  # its base parameters
    prior: Float[Array, "r r"]  # information on the base parameters' change that lies in the URDF, shape (r, r)
    loss: LossParameters  # tuned loss parameters
    sliding: Sliding  # how each joint's dry friction turns round
    number_std: Float[Array, " 10n"]  # standard deviation of each link's inertial numbers, as believed
    settings: RegressionSettings = USUAL_REGRESSION  # what the regression counts with

    def prior_of(self, error: UrdfError, wrong_link: int | None = None, factor: float = 1.0) -> Float[Array, "r r"]:
        """Information on the base parameters' change in a URDF that is so far off, and at one link more by a factor."""
        std = np.hypot(error.scale * self.number_std, _shifted(self.nominal, error.com_m))
        for link in error.usual:
            std[10 * link : 10 * (link + 1)] = min(error.scale, 1.0) * self.number_std[10 * link : 10 * (link + 1)]
        if wrong_link is not None:
            std[10 * wrong_link : 10 * (wrong_link + 1)] *= factor
        return base_prior(self.base, std)


def _shifted(arm: ArmModel, com_m: float) -> Float[Array, " 10n"]:
    """What centres of mass so far off change of each link's inertial numbers, standard deviations."""
    links = arm.inertial_parameters.reshape(arm.n, 10)
    mass, lever = links[:, :1], np.linalg.norm(links[:, 1:4], axis=1, keepdims=True)
    axis = com_m / np.sqrt(3.0)
    moment, inertia = mass * axis, 2.0 * lever * axis + mass * axis**2
    return np.concatenate([0.0 * mass, np.repeat(moment, 3, 1), np.repeat(inertia, 6, 1)], axis=1).ravel()


def fit_baseline(
    motions: Sequence[Motion],
    arm: ArmModel,
    share: float | None = None,
    settings: RegressionSettings = USUAL_REGRESSION,
    still: Collection[int] = (),
    sliding: Sliding | None = None,
) -> Baseline:
    """Tunes the arm on all runs.

    Args:
        motions: All runs.
        arm: The arm as its user has it.
        share: Standard deviation of its inertial numbers, as a share of each link's own; that of a URDF if None.
        settings: What the regression counts with.
        still: Joints that stand still: they get no loss.
        sliding: How dry friction turns round, where that is not to be estimated.
    """
    share = settings.inertia_share if share is None else share
    tuned, number_std = tune_arm(motions, arm, share, still), share * parameter_scale(arm)
    if sliding is None:
        sliding = fit_sliding(motions, [rigid_torque(tuned.arm, motion) for motion in motions])
    prior = base_prior(tuned.base, number_std)
    return Baseline(arm, tuned.arm, tuned.base, prior, tuned.loss, sliding, number_std, settings)
