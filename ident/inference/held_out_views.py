"""Held-out scores of a session's models: without and with an effect, and along the simplest set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ident.inference.infer import Inference, Inferred
from ident.inference.revision import evidence_of
from ident.regression.cross_validation import HeldOut, HeldOutScore
from ident.regression.design import Group

# Divisor of the URDF's tolerance where its inertias are taken as they are.
FIXED = 20.0


@dataclass(frozen=True, eq=False)
class HeldOutView:
    """Held-out scores without and with one effect, beside tuned inertias or the URDF's."""

    before: HeldOutScore
    after: HeldOutScore
    fixed: bool  # whether the inertias are the URDF's

    def closed(self, joints: Sequence[int]) -> float:
        """Share of the joints' held-out mean square that the effect closes.

        At most 1; below 0 where the effect makes it worse.
        """
        old = self.before.squares[:, joints].sum()
        new = self.after.squares[:, joints].sum()
        return float((old - new) / max(old, 1e-300))


@dataclass(frozen=True, eq=False)
class Scorers:
    """Cross-validated scores of models of one session."""

    tuned: HeldOut  # inertias tuned
    fixed: HeldOut  # inertias as the URDF has them

    @classmethod
    def of(cls, reached: Inferred) -> Scorers:
        """Scorers with a set's variance components.

        Args:
            reached: The set. The scorer `tuned` has its URDF error; `fixed` believes in the URDF
                more.
        """
        evidence = evidence_of(reached.model)
        prior = reached.model.prior()
        factor = FIXED * reached.model.components.urdf.scale
        tuned = HeldOut(evidence, prior, expected=reached.chosen)
        return cls(tuned, tuned.believing(prior.tightened(factor)))


@dataclass(frozen=True, eq=False)
class Turns:
    """Held-out scores along the simplest set, an effect more each time."""

    scorer: HeldOut
    order: tuple[Group, ...]  # the set on fine grids, in the order in which its effects came

    @classmethod
    def of(cls, refined: Inference) -> Turns:
        """Turns along the simplest set's effects on fine grids, in the order in which they came."""
        keys = [group.key for group in refined.simplest.chosen]
        fine = next(reached for reached in refined.reached if reached.simplest)
        order = sorted(fine.chosen, key=lambda group: keys.index(group.key))
        everything: list[Group] = []
        for reached in refined.reached:
            everything += reached.chosen
        expected = tuple(dict.fromkeys(everything))
        evidence = evidence_of(fine.model)
        scorer = HeldOut(evidence, fine.model.prior(), expected=expected)
        return cls(scorer, tuple(order))

    def view(self, group: Group) -> HeldOutView:
        """Held-out scores just before and after an effect came.

        An effect that is not of the simplest set comes after all of that set.
        """
        keys = [other.key for other in self.order]
        step = keys.index(group.key) if group.key in keys else len(keys)
        before = self.order[:step]
        return HeldOutView(
            before=self.scorer.score(before),
            after=self.scorer.score([*before, group]),
            fixed=False,
        )
