"""One pass over the training runs: sums of all columns that a fit may ask for.

The regression is the diagnosis' own (`ident.regression`), with offsets and the laws that were given
as further columns of the model: whitened rows clear of reversals, friction that varies from run to
run, the URDF as prior.

Rows near reversals are left out of an estimate because dry friction there depends on what was
before. Where there is none, they are as good as any other, and in some recordings the larger half.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.command_options import FitOptions
from ident.effects.base import Variant
from ident.effects.states_effect import StatesEffect
from ident.errors import RecordingError
from ident.laws.carried import NamedLaw
from ident.model.linearisation import LEAST_MOVING, Sliding
from ident.model.loss import TRANSITION_GRID
from ident.motion.motion import Motion
from ident.regression.baseline import Baseline, fit_baseline
from ident.regression.design import LOSS_PARAMETERS, Grid, layout_of
from ident.regression.gather import gather
from ident.regression.gram import Evidence
from ident.regression.runs import build_session
from ident.robot.arm import ArmModel
from ident.robot.tolerance import PRIOR_SHARE

# A joint with a smaller share of its moving samples clear of reversals is fitted where it moves at
# all.
LEAST_SETTLED = 0.1
# Least eigenvalue of the columns of a joint's friction, scaled to length one, at which they count
# as distinguished.
LEAST_PARTED = 1e-7


@dataclass(frozen=True, eq=False)
class FitSums:
    """One pass over the training runs: sums of all columns that a fit may ask for."""

    motions: Sequence[Motion]
    baseline: Baseline  # the arm near its URDF, about which laws by the load are linear
    evidence: Evidence  # the sums; its layout's groups are offsets, joint by joint, then laws
    options: FitOptions  # what is fitted
    laws: tuple[NamedLaw, ...]  # laws of joints whose coefficients are parameters, too
    through_reversals: tuple[str, ...]  # joints for which samples near reversals had to be used too

    @classmethod
    def gather(
        cls,
        motions: Sequence[Motion],
        nominal: ArmModel,
        options: FitOptions,
        laws: Sequence[NamedLaw] = (),
        widths: Float[Array, " n"] | None = None,
    ) -> FitSums:
        """Goes through the runs.

        Args:
            motions: Training runs; known payloads are part of the model.
            nominal: The arm as its URDF describes it.
            options: What is fitted.
            laws: Laws of joints.
            widths: Speed over which each joint's friction turns round [rad/s]; not at all if None.

        Raises:
            RecordingError: A joint hardly moves in any run, or its laws can't be told from plain
                friction.
        """
        share = PRIOR_SHARE.get(options.inertia, PRIOR_SHARE["consistent"])
        baseline = fit_baseline(motions, nominal, share, sliding=_sliding(nominal.n, widths))
        if widths is not None:
            baseline = replace(baseline, loss=replace(baseline.loss, transition_speed=widths))
        moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
        settled = np.sum([motion.settled.sum(axis=0) for motion in motions], axis=0)
        few = np.asarray(settled < np.maximum(LEAST_MOVING, LEAST_SETTLED * moving))
        evidence = _sums(motions, baseline, options.offset == "on", laws, few)
        through = tuple(nominal.joint_names[joint] for joint in np.flatnonzero(few))
        sums = cls(motions, baseline, evidence, options, tuple(laws), through)
        sums._require_parted()
        return sums

    def through(self, joints: Bool[Array, " n"]) -> FitSums:
        """Sums of all moving rows of some joints; of the others as they were.

        Args:
            joints: Which joints.
        """
        also = np.isin(self.baseline.nominal.joint_names, self.through_reversals)
        offset = self.options.offset == "on"
        evidence = _sums(self.motions, self.baseline, offset, self.laws, joints | also)
        return replace(self, evidence=evidence)

    def only(self, laws: Sequence[NamedLaw]) -> FitSums:
        """These sums with some of the laws alone; no column is made anew."""
        layout = self.evidence.layout
        first = len(layout.groups) - len(self.laws)
        groups = list(layout.groups[:first])
        remaining = []
        for group, law in zip(layout.groups[first:], self.laws, strict=True):
            if law in laws:
                groups.append(group)
                remaining.append(law)
        evidence = replace(self.evidence, layout=replace(layout, groups=tuple(groups)))
        return replace(self, evidence=evidence, laws=tuple(remaining))

    def _require_parted(self) -> None:
        """Raises RecordingError where a law can't be told from plain losses and laws beside it."""
        joints = self.baseline.nominal.joint_names
        for joint in sorted({law.joint for law in self.laws}):
            if self._is_parted(joint):
                continue
            laws = " and ".join(law.effect for law in self.laws if law.joint == joint)
            plain = "plain friction or an offset"
            what = f"its motions can't tell {laws} of {joints[joint]} from {plain}"
            remedy = "fit without --with (or --offset), or record motions that show it"
            raise RecordingError(self.motions[0].name, what, remedy)

    def _is_parted(self, joint: int) -> bool:
        """Whether a joint's losses, offset and laws have columns that differ."""
        layout = self.evidence.layout
        losses = layout.rank + LOSS_PARAMETERS * joint + np.arange(LOSS_PARAMETERS)
        further = [group.columns for group in layout.groups if group.joint == joint]
        columns = np.concatenate([losses, *further])
        gram = self.evidence.gram()[np.ix_(columns, columns)]
        size = np.sqrt(np.diag(gram))
        if np.any(size <= 0.0):
            return False
        return bool(np.linalg.eigvalsh(gram / np.outer(size, size))[0] >= LEAST_PARTED)


def _sliding(n: int, widths: Float[Array, " n"] | None) -> Sliding:
    """Direction of motion clear of reversals: a plain sign.

    Unless runs left out say over which speed it turns round.
    """
    speed = np.zeros(n)
    if widths is not None:
        speed = np.where(widths > TRANSITION_GRID[0], widths, 0.0)
    return Sliding(np.zeros(n), speed)


def _sums(
    motions: Sequence[Motion],
    baseline: Baseline,
    offset: bool,
    laws: Sequence[NamedLaw],
    through: Bool[Array, " n"],
) -> Evidence:
    """Sums with offsets of all joints, if they are asked for, and laws.

    Args:
        motions: The runs.
        baseline: The arm near its URDF.
        offset: Whether each joint has an offset.
        laws: Laws of joints.
        through: Joints all of whose moving rows count.
    """
    session = build_session(baseline, motions, common_clock=False)
    grids: list[Grid] = []
    if offset:
        from ident.effects.sensing import TorqueOffset

        grids += [(TorqueOffset(), joint, (Variant(),)) for joint in range(session.n)]
    for law in laws:
        grids.append((StatesEffect(law.effect), law.joint, (Variant(shape=law.shape),)))
    layout = layout_of(session, baseline.base.rank, grids)
    return gather(session, baseline, layout, through=through)
