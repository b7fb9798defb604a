"""What runs left out chose, and what each alternative costs there."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import Array, Float
from ident.command_options import Inertia
from ident.fitting.held_out_sums import HeldOutSums
from ident.fitting.left_out import Errors, NormalEquations, Selection, assemble, left_out, solve
from ident.fitting.over_parts import no_worse_work
from ident.laws.carried import NamedLaw
from ident.model.loss import TRANSITION_GRID

# Share of the error of the best kind of inertias within which another kind is as good.
AS_GOOD = 0.005
# What a kind of inertias is, and what it costs, in words.
WORDS = {
    "consistent": "near the URDF's, of bodies that can exist",
    "base": "base parameters as the recordings have them",
    "nominal": "the URDF's",
}
COSTS = {
    "consistent": "bodies that can exist cost",
    "base": "base parameters as they come cost",
    "nominal": "the URDF's inertias cost",
}


@dataclass(frozen=True, eq=False)
class ModelChoice:
    """What was chosen, and what each kind of inertias costs on runs left out."""

    selection: Selection
    sums: HeldOutSums
    noise: Float[Array, " n"]  # what each joint's model leaves of runs left out [N m]
    kind: Inertia
    share: float
    errors: dict[Inertia, Errors] = field(default_factory=dict)  # of each kind that was tried
    # Whether the parameters come from whitened rows clear of reversals, or from plain rows of all
    # motion; where None, from whitened ones if they foretell as well.
    whitened: bool | None = None
    given: int = 0  # how many of the laws were asked for

    @property
    def widths(self) -> Float[Array, " n"]:
        """Speed over which each joint's friction turns round [rad/s]."""
        return np.asarray(TRANSITION_GRID)[self.selection.width]

    @property
    def laws(self) -> tuple[NamedLaw, ...]:
        """The laws that were taken."""
        return tuple(self.sums.laws[number] for number in self.selection.laws)

    @property
    def given_laws(self) -> tuple[NamedLaw, ...]:
        """The laws among those taken that were asked for by name."""
        numbers = [number for number in self.selection.laws if number < self.given]
        return tuple(self.sums.laws[number] for number in numbers)

    @property
    def offset(self) -> bool:
        """Whether joints have offsets."""
        return bool(self.selection.offset.any())

    @property
    def left_out_rmse(self) -> Float[Array, " n"]:
        """Torque error of each joint on parts that a fit did not see, where it moves [N m]."""
        return self.errors[self.kind].rmse

    @property
    def torque_rms(self) -> Float[Array, " n"]:
        """Root mean square of each joint's torque in the same samples [N m]."""
        counts = np.maximum(self.sums.counts.sum(axis=0), 1.0)
        return np.asarray(np.sqrt(self.sums.torques.sum(axis=0) / counts))

    def problem(self) -> NormalEquations:
        """Normal equations of all parts."""
        return assemble(self.sums, self.selection, range(self.sums.parts), self.noise)

    def solved(self, kind: Inertia, signed: bool = True) -> Float[Array, " m"]:
        """The unknowns of all parts together."""
        return solve(self.sums, self.problem(), kind, self.share, signed)

    def foretell_as_well(self, solutions: Sequence[Float[Array, " m"]]) -> bool:
        """Whether solutions foretell parts left out as well as those of plain rows.

        As well: within `AS_GOOD` of their error in units of noise, and with work that is no worse.

        Args:
            solutions: All unknowns by rows of another kind, without each part in turn.
        """
        problem = self.problem()
        plain, _ = left_out(self.sums, self.selection, self.noise, "base", self.share)
        squares = np.zeros_like(plain.squares)
        work = np.zeros_like(plain.work)
        for number, solution in enumerate(solutions):
            for joint in range(self.sums.nominal.n):
                weights = problem.row_weights(self.sums, solution, joint)
                of_part = self.sums.squares[joint][number]
                squares[number, joint] = weights @ of_part @ weights
                work[number, joint] = self.sums.work[joint][number] @ weights
        most = (1.0 + AS_GOOD) ** 2 * np.sum(plain.squares / self.noise**2)
        as_good = bool(np.sum(squares / self.noise**2) <= most)
        return as_good and no_worse_work(plain.work.sum(axis=1), work.sum(axis=1))

    def with_rows(self, whitened: bool) -> ModelChoice:
        """A copy whose parameters come from whitened rows in any case, or from plain ones."""
        return replace(self, whitened=whitened)

    def without(self, gone: Collection[tuple[str, int]]) -> ModelChoice:
        """A copy without some laws.

        Args:
            gone: Pairs of an effect's id and a joint's number.
        """
        numbers = []
        for number in self.selection.laws:
            law = self.sums.laws[number]
            if (law.effect, law.joint) not in gone:
                numbers.append(number)
        return replace(self, selection=replace(self.selection, laws=tuple(numbers)))

    def to_dict(self) -> dict[str, object]:
        """For the model's record: what was chosen, and what alternatives leave of runs left out."""
        return {
            "inertia": self.kind,
            "offset": self.offset,
            "urdf_share_believed": self.share,
            "rows": "whitened" if self.whitened else "plain",
            "rmse_by_inertia_Nm": {kind: error.total for kind, error in self.errors.items()},
            "work_error_by_inertia_J": {kind: error.energy for kind, error in self.errors.items()},
            "laws": [self._law_record(number) for number in self.selection.laws],
            "parts": self.sums.parts,
            "left_out": self._left_out_record(),
        }

    def _left_out_record(self) -> dict[str, dict[str, float]]:
        """Each joint's error on parts that a fit did not see, beside its torque [N m]."""
        if self.kind not in self.errors:
            return {}
        joints = self.sums.nominal.joint_names
        sizes = zip(joints, self.left_out_rmse, self.torque_rms, strict=True)
        return {
            joint: {"rmse_Nm": float(error), "torque_rms_Nm": float(torque)}
            for joint, error, torque in sizes
        }

    def _law_record(self, number: int) -> dict[str, object]:
        law = self.sums.laws[number]
        joint = self.sums.nominal.joint_names[law.joint]
        return {"effect": law.effect, "joint": joint, "given": number < self.given}

    def describe(self) -> list[str]:
        """In words: what each constraint costs on runs left out, and what was chosen."""
        inertias = f"link inertias: {WORDS[self.kind]}"
        if self.kind != "nominal":
            share = f"{100 * self.share:.0f} % of each link's scale"
            inertias += f"; the URDF's numbers are believed to {share}"
        offsets = "one a joint, as the table has them" if self.offset else "none"
        lines = [*self._describe_costs(), inertias, f"constant torques: {offsets}"]
        tried = [number for number in self.selection.laws if number >= self.given]
        if tried:
            named = ", ".join(map(self._describe_law, tried))
            lines.append(f"laws that parts left out ask for: {named}")
        return lines

    def _describe_costs(self) -> list[str]:
        """What other kinds of inertias cost, a line each; those that are as good cost nothing."""
        lines = []
        best = self.errors[self.kind]
        for kind, errors in self.errors.items():
            cost = errors.total - best.total
            if kind == self.kind or cost <= AS_GOOD * best.total:
                continue
            worst = int(np.argmax(errors.rmse - best.rmse))
            joint = self.sums.nominal.joint_names[worst]
            line = f"{COSTS[kind]} {cost:.2g} N m on parts left out, most at {joint}"
            if kind == "consistent":
                line += ": a drive gain or a mass of the URDF may be off there"
            lines.append(line)
        return lines

    def _describe_law(self, number: int) -> str:
        law = self.sums.laws[number]
        return f"{law.kind.words} at {self.sums.nominal.joint_names[law.joint]}"
