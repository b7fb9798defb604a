"""What a fit's model is to be made of, chosen by runs left out.

Which width friction turns round over, whether a joint has an offset, which laws of friction it follows beyond the
plain ones, and whether links keep the URDF's inertias, take base parameters as they come, or must be bodies: each is
tried on the parts of the recordings in turn that were not used (whole runs; blocks of a single one). What is further
from the plain model is taken where it lowers the error there by more than one standard error of that fall over the
parts, and does not make the work worse by as much.

Rows are plain: filtered torque wherever a joint moves. On twelve real arms, three splits each, whitened rows clear of
reversals left 6 % more on runs left out (geometric mean) and were ahead on 8 of 36, by 2 %; intervals come from them.

Source: Stone 1974; Breiman, Friedman, Olshen and Stone 1984, section 3.4.3 (the one-standard-error rule).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.command_options import Inertia
from ident.errors import RecordingError
from ident.fitting.held_out_sums import HeldOutSums, gather_sums
from ident.fitting.left_out import (
    Errors,
    OwnColumns,
    Problem,
    Selection,
    assemble,
    helps,
    left_out,
    no_worse_work,
    solve,
    surely_less,
)
from ident.laws.carried import NamedLaw
from ident.model.inertia import base_parameters, lift_base, parameter_scale
from ident.model.linearisation import LEAST_MOVING
from ident.model.loss import TRANSITION_GRID
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# How far the URDF's inertial numbers may be off, as shares of each link's scale: tried in turn.
SHARES = (0.1, 0.3, 1.0, 3.0)
# Share of the error of the best kind of inertias within which a kind that is nearer to a real arm is as good.
AS_GOOD, AS_GOOD_SHARE = 0.005, 0.01
# Kinds of inertias, the nearest to a real arm first.
KINDS_OF_INERTIA: tuple[Inertia, ...] = ("consistent", "base", "nominal")
# Laws of friction that are tried at each joint, with what bends them; speeds in rad/s.
TRIED_LAWS: tuple[tuple[str, dict[str, float]], ...] = (
    ("stribeck_friction", {"stribeck_velocity_rad_s": 0.03, "exponent": 1.0}),
    ("stribeck_friction", {"stribeck_velocity_rad_s": 0.1, "exponent": 1.0}),
    ("stribeck_friction", {"stribeck_velocity_rad_s": 0.3, "exponent": 1.0}),
    ("nonlinear_viscous_friction", {"exponent": 0.3, "knee_rad_s": 0.05}),
    ("nonlinear_viscous_friction", {"exponent": 0.6, "knee_rad_s": 0.05}),
    ("load_dependent_friction", {"terms": 2.0, "load_Nm": 1.0}),
)
# What a kind of inertias is, and what it costs, in words.
WORDS = {
    "consistent": "bodies that could exist",
    "base": "base parameters as the recordings have them",
    "nominal": "the URDF's",
}
COSTS = {
    "consistent": "bodies that could exist cost",
    "base": "base parameters as they come cost",
    "nominal": "the URDF's inertias cost",
}
MOST_LAWS = 3  # of a joint
FEWEST_ROWS = 50  # of a part, for it to be a witness of a joint


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen, and what each kind of inertias costs on runs left out."""

    selection: Selection
    sums: HeldOutSums
    noise: Float[Array, " n"]  # what each joint's model leaves of runs left out [N m]
    kind: Inertia
    share: float
    errors: dict[Inertia, Errors] = field(default_factory=dict)  # of each kind that was tried
    # Whether the parameters come from whitened rows clear of reversals; from plain rows of all motion otherwise.
    whitened: bool = False
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
        """Those that were asked for."""
        return tuple(self.sums.laws[number] for number in self.selection.laws if number < self.given)

    @property
    def offset(self) -> bool:
        """Whether joints have offsets."""
        return bool(self.selection.offset.any())

    def problem(self) -> Problem:
        """Normal equations of all parts."""
        return assemble(self.sums, self.selection, range(self.sums.parts), self.noise)

    def solved(self, kind: Inertia, signed: bool = True) -> Float[Array, " m"]:
        """The unknowns of all parts together."""
        return solve(self.sums, self.problem(), kind, self.share, signed)

    def without(self, gone: Collection[tuple[str, int]]) -> Choice:
        """The same without some laws, by their effects and joints."""
        laws = tuple(
            number
            for number in self.selection.laws
            if (self.sums.laws[number].effect, self.sums.laws[number].joint) not in gone
        )
        return replace(self, selection=replace(self.selection, laws=laws))

    def to_dict(self) -> dict[str, Any]:
        """For the model's record: what was chosen, and what each alternative leaves of runs left out [N m]."""
        joints = self.sums.nominal.joint_names
        return {
            "inertia": self.kind,
            "offset": self.offset,
            "urdf_share_believed": self.share,
            "rows": "whitened" if self.whitened else "plain",
            "rmse_by_inertia_Nm": {kind: one.total for kind, one in self.errors.items()},
            "work_error_by_inertia_J": {kind: one.energy for kind, one in self.errors.items()},
            "laws": [
                {"effect": self.sums.laws[k].effect, "joint": joints[self.sums.laws[k].joint], "given": k < self.given}
                for k in self.selection.laws
            ],
            "parts": self.sums.parts,
        }

    def describe(self) -> list[str]:
        """In words: what each constraint costs on runs left out, and what was chosen."""
        lines = []
        best = self.errors[self.kind]
        for kind, errors in self.errors.items():
            cost = errors.total - best.total
            if kind == self.kind or cost <= AS_GOOD * best.total:
                continue
            worst = int(np.argmax(errors.rmse - best.rmse))
            joint = self.sums.nominal.joint_names[worst]
            cause = ": a drive gain or a mass of the URDF may be off there" if kind == "consistent" else ""
            lines.append(f"{COSTS[kind]} {cost:.3g} N m on runs left out, most at {joint}{cause}")
        share = f"within {100 * self.share:.0f} % of each link's scale"
        lines.append(f"inertias: {WORDS[self.kind]}" + ("" if self.kind == "nominal" else f", {share}"))
        lines.append(f"constant torques: {'one a joint' if self.offset else 'none'}")
        if self.selection.laws:
            named = ", ".join(
                f"{self.sums.laws[k].kind.words} at {joint}"
                for k in self.selection.laws
                for joint in [self.sums.nominal.joint_names[self.sums.laws[k].joint]]
                if k >= self.given
            )
            lines += [f"laws that runs left out ask for: {named}"] if named else []
        return lines


def choose(
    motions: Sequence[Motion],
    nominal: ArmModel,
    inertia: Inertia = "auto",
    offset: str = "auto",
    given: Sequence[NamedLaw] = (),
    tried: bool = True,
) -> Choice:
    """Chooses widths, offsets, laws and the kind of inertias.

    Args:
        motions: Training runs.
        nominal: The arm as its URDF describes it.
        inertia: A kind of inertias, or auto.
        offset: auto, on or off.
        given: Laws that are part of the model whatever runs left out say.
        tried: Whether other laws of friction are tried.
    """
    require_moving(motions, nominal)
    base = base_parameters(nominal)
    sums = gather_sums(motions, nominal, base)
    n = nominal.n
    selection = Selection(np.full(n, TRANSITION_GRID.index(0.02)), np.full(n, offset != "off"))
    noise, kind = np.ones(n), "base"
    share = SHARES[1]
    for _ in range(2):
        errors, found = left_out(sums, selection, noise, "base", share)
        noise = np.maximum(errors.rmse, 1e-9)
        selection = _choose_own(sums, selection, [one[: base.rank] for one in found])
    share = _choose_share(sums, selection, noise)
    if offset == "auto":
        selection = _drop_offsets(sums, selection, noise, share)
    errors, found = left_out(sums, selection, noise, "base", share)
    if given or tried:
        tuned = _tuned(sums, selection, noise, share)
        widths = np.asarray(TRANSITION_GRID)[selection.width]
        further = _further_laws(nominal, sums) if tried else ()
        sums = gather_sums(motions, nominal, base, (*given, *further), tuned, widths)
        selection = replace(selection, laws=tuple(range(len(given))))
        changes = [one[: base.rank] for one in found]
        selection = _choose_laws(sums, selection, changes)
        selection = _drop_laws(sums, selection, noise, share, len(given))
        share = _choose_share(sums, selection, noise)
    kinds: tuple[Inertia, ...] = KINDS_OF_INERTIA if inertia == "auto" else (inertia,)
    tried_kinds = {one: left_out(sums, selection, noise, one, share)[0] for one in kinds}
    kind = _best_kind(tried_kinds)
    return Choice(selection, sums, noise, kind, share, tried_kinds, given=len(given))


def require_moving(motions: Sequence[Motion], nominal: ArmModel) -> None:
    """Raises RecordingError where a joint hardly moves in any run."""
    moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
    for joint in np.flatnonzero(moving < LEAST_MOVING):
        what = f"{nominal.joint_names[joint]} hardly moves: its loss can't be fitted"
        raise RecordingError(motions[0].name, what, "add runs that move it, or lock it")


def _best_kind(errors: dict[Inertia, Errors]) -> Inertia:
    """The kind nearest to a real arm among those that are as good as the best."""
    least = min(one.total for one in errors.values())
    return next(kind for kind, one in errors.items() if one.total <= (1.0 + AS_GOOD) * least)


def _choose_share(sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"]) -> float:
    """How far the URDF is believed to be off: the least by which runs left out are foretold as well as by the best."""
    tried = [left_out(sums, selection, noise, "base", share)[0] for share in SHARES]
    lost = [float(np.mean(errors.rmse**2 / noise**2)) for errors in tried]
    most = (1.0 + AS_GOOD_SHARE) ** 2 * min(lost)
    return next(share for share, one in zip(SHARES, lost, strict=True) if one <= most)


def _tuned(sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float) -> ArmModel:
    """The arm with the base parameters that all parts together have."""
    problem = assemble(sums, selection, range(sums.parts), noise)
    change = solve(sums, problem, "base", share)[: sums.base.rank]
    lift = lift_base(sums.base, parameter_scale(sums.nominal))
    return sums.nominal.with_inertial_parameters(sums.nominal.inertial_parameters + lift @ change)


def _choose_own(sums: HeldOutSums, selection: Selection, changes: Sequence[Float[Array, " r"]]) -> Selection:
    """The width over which each joint's friction turns round."""
    width = selection.width.copy()
    rank = sums.base.rank
    for j in range(sums.nominal.n):
        own = OwnColumns.of(sums, j, changes)

        def errors(place: int, own: OwnColumns = own, j: int = j) -> tuple[Array, Array]:
            columns, signed = replace(selection, width=np.full(len(width), place)).of_joint(sums, j)
            return own.errors(columns - rank, signed)

        tried = [errors(place) for place in range(len(TRANSITION_GRID))]
        best = int(np.argmin([squares.sum() for squares, _ in tried]))
        # The sharpest turning that is not surely worse than the best one: Coulomb's own law where nothing else shows.
        width[j] = next(
            place for place, (squares, _) in enumerate(tried[: best + 1]) if not surely_less(squares, tried[best][0])
        )
    return replace(selection, width=width)


def _drop_offsets(sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float) -> Selection:
    """No offsets where runs left out are foretold as well without them."""

    def error(trial: Selection) -> float:
        squares = left_out(sums, trial, noise, "base", share)[0].squares
        return float(np.sum(squares.sum(axis=0) / noise**2))

    none = replace(selection, offset=np.zeros(sums.nominal.n, dtype=bool))
    return none if error(none) <= (1.0 + AS_GOOD) ** 2 * error(selection) else selection


def _drop_laws(
    sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float, given: int
) -> Selection:
    """Laws without which runs left out are foretold no worse once all is fitted anew go, the last ones first."""

    def errors(trial: Selection) -> tuple[float, Array]:
        found = left_out(sums, trial, noise, "base", share)[0]
        return float(np.sum(found.squares.sum(axis=0) / noise**2)), found.work.sum(axis=1)

    least, _ = errors(selection)
    for number in selection.laws[: given - 1 if given else None : -1]:
        trial = replace(selection, laws=tuple(one for one in selection.laws if one != number))
        error, _ = errors(trial)
        if error <= least:
            selection, least = trial, error
    none = replace(selection, laws=selection.laws[:given])
    if not no_worse_work(errors(none)[1], errors(selection)[1]):
        return none
    return selection


def _further_laws(nominal: ArmModel, sums: HeldOutSums) -> tuple[NamedLaw, ...]:
    """Laws that are tried at every joint."""
    found = []
    for joint in range(nominal.n):
        for effect, shape in TRIED_LAWS:
            found.append(NamedLaw(effect, joint, shape))
    return tuple(found)


def _choose_laws(sums: HeldOutSums, selection: Selection, changes: Sequence[Float[Array, " r"]]) -> Selection:
    """Laws that runs left out ask for, joint by joint, the most helpful first; one of a kind at a joint."""
    chosen = list(selection.laws)
    rank = sums.base.rank
    for j in range(sums.nominal.n):
        own = OwnColumns.of(sums, j, changes)
        here = [number for number in chosen if sums.laws[number].joint == j]

        def errors(numbers: Sequence[int], own: OwnColumns = own, j: int = j) -> tuple[Array, Array]:
            columns, signed = replace(selection, laws=tuple(numbers)).of_joint(sums, j)
            return own.errors(columns - rank, signed)

        squares, work = errors(here)
        while len(here) < MOST_LAWS:
            taken = {sums.laws[number].effect for number in here}
            trials = [number for number, law in enumerate(sums.laws) if law.joint == j and law.effect not in taken]
            if not trials:
                break
            found = [errors([*here, number]) for number in trials]
            best = int(np.argmin([one[0].sum() for one in found]))
            if not (helps(squares, found[best][0]) and no_worse_work(work, found[best][1])):
                break
            here.append(trials[best])
            squares, work = found[best]
        chosen += [number for number in here if number not in chosen]
    return replace(selection, laws=tuple(chosen))
