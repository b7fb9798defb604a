"""What a fit's model is to be made of, chosen by runs left out.

Which width friction turns round over, whether a joint has an offset, which laws of friction it
follows beyond the plain ones, and whether links keep the URDF's inertias, take base parameters as
they come, or must be bodies: each is tried on the parts of the recordings in turn that were not
used (whole runs; blocks of a single one). What is further from the plain model is taken where it
lowers the error there by more than one standard error of that fall over the parts, and does not
make the work worse by as much. A law of friction must help by Student's test over the parts, and
again by fits to the rows alone in which a joint slides in one direction beyond the speed over which
its friction turns round: near reversals a joint may stick or creep, and what it does there is
smeared by filters.

Rows are plain: filtered torque wherever a joint moves. On twelve real arms, three splits each,
whitened rows clear of reversals left 6 % more on runs left out (geometric mean) and were ahead on
8 of 36, by 2 %. On simulated arms their values are two to six times nearer the truth. Parameters
come from them where they foretell parts left out as well (`ModelChoice.foretell_as_well`), and
intervals always.

Source: Stone 1974; Breiman, Friedman, Olshen and Stone 1984, section 3.4.3 (the one-standard-error
rule).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.command_options import Inertia
from ident.errors import RecordingError
from ident.fitting.chosen import AS_GOOD, ModelChoice
from ident.fitting.held_out_sums import HeldOutSums, Tuned, gather_sums
from ident.fitting.left_out import (
    Errors,
    OwnColumns,
    OwnErrors,
    Selection,
    assemble,
    coulomb_of,
    left_out,
    solve,
)
from ident.fitting.over_parts import (
    CONFIRMED,
    helps,
    helps_alike,
    no_worse_work,
    surely_less,
)
from ident.laws.carried import NamedLaw
from ident.model.inertia import base_parameters, lift_base
from ident.model.linearisation import LEAST_MOVING
from ident.model.loss import TRANSITION_GRID
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale

# How far the URDF's inertial numbers may be off, as shares of each link's scale: tried in turn.
SHARES = (0.1, 0.3, 1.0, 3.0)
# Share of the error of the best of these within which a smaller one is as good.
AS_GOOD_SHARE = 0.01
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
MOST_LAWS = 3  # of a joint
# Width of friction's turning that the search starts from [rad/s].
FIRST_WIDTH = 0.02
# Widths are chosen so many times, each time by the noise that the last ones left.
PASSES = 2
# Least noise of a joint [N m].
LEAST_NOISE = 1e-9


def choose(
    motions: Sequence[Motion],
    nominal: ArmModel,
    inertia: Inertia = "auto",
    offset: str = "auto",
    given: Sequence[NamedLaw] = (),
    tried: bool = True,
) -> ModelChoice:
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
    selection = Selection(
        width=np.full(nominal.n, TRANSITION_GRID.index(FIRST_WIDTH)),
        offset=np.full(nominal.n, offset != "off"),
    )
    selection, noise = _choose_widths(sums, selection)
    share = _choose_share(sums, selection, noise)
    if offset == "auto":
        selection = _drop_offsets(sums, selection, noise, share)
    if given or tried:
        plain, solutions = left_out(sums, selection, noise, "base", share)
        changes = [unknowns[: base.rank] for unknowns in solutions]
        unknowns = _solve_all(sums, selection, noise, share)
        coulomb = coulomb_of(sums, unknowns)
        dryness = coulomb / sums.clear_rmse(plain.clear, noise)
        widths = np.asarray(TRANSITION_GRID)[selection.width]
        tuned = Tuned(_tuned(sums, unknowns), widths, dryness)
        further = _further_laws(nominal) if tried else ()
        sums = gather_sums(motions, nominal, base, (*given, *further), tuned)
        selection = replace(selection, laws=tuple(range(len(given))))
        selection = _choose_laws(sums, selection, changes)
        selection = _drop_laws(sums, selection, noise, share, len(given))
        share = _choose_share(sums, selection, noise)
    kinds: tuple[Inertia, ...] = KINDS_OF_INERTIA if inertia == "auto" else (inertia,)
    errors = {kind: left_out(sums, selection, noise, kind, share)[0] for kind in kinds}
    best = _best_kind(errors)
    return ModelChoice(selection, sums, noise, best, share, errors, given=len(given))


def require_moving(motions: Sequence[Motion], nominal: ArmModel) -> None:
    """Raises RecordingError where a joint hardly moves in any run."""
    moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
    for joint in np.flatnonzero(moving < LEAST_MOVING):
        what = f"{nominal.joint_names[joint]} hardly moves: its loss can't be fitted"
        raise RecordingError(motions[0].name, what, "add runs that move it, or lock it")


def _best_kind(errors: dict[Inertia, Errors]) -> Inertia:
    """The kind nearest to a real arm among those that are as good as the best."""
    least = min(error.total for error in errors.values())
    most = (1.0 + AS_GOOD) * least
    return next(kind for kind, error in errors.items() if error.total <= most)


def _choose_share(sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"]) -> float:
    """How far the URDF is believed to be off: the least share that is as good as the best.

    As good: runs left out are foretold as well.
    """
    losses = []
    for share in SHARES:
        errors, _ = left_out(sums, selection, noise, "base", share)
        losses.append(float(np.mean(errors.rmse**2 / noise**2)))
    most = (1.0 + AS_GOOD_SHARE) ** 2 * min(losses)
    return next(share for share, loss in zip(SHARES, losses, strict=True) if loss <= most)


def _solve_all(
    sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float
) -> Float[Array, " m"]:
    """The unknowns that all parts together have."""
    problem = assemble(sums, selection, range(sums.parts), noise)
    return solve(sums, problem, "base", share)


def _tuned(sums: HeldOutSums, unknowns: Float[Array, " m"]) -> ArmModel:
    """The arm with the base parameters among the unknowns."""
    change = unknowns[: sums.base.rank]
    lift = lift_base(sums.base, parameter_scale(sums.nominal))
    return sums.nominal.with_inertial_parameters(sums.nominal.inertial_parameters + lift @ change)


def _choose_widths(sums: HeldOutSums, selection: Selection) -> tuple[Selection, Float[Array, " n"]]:
    """The width over which each joint's friction turns round, and the noise that it was chosen by.

    Returns:
        The selection with these widths, and what each joint's model left of runs left out before
        the last of them were chosen [N m].
    """
    noise = np.ones(sums.nominal.n)
    for _ in range(PASSES):
        errors, solutions = left_out(sums, selection, noise, "base", SHARES[1])
        noise = np.maximum(errors.rmse, LEAST_NOISE)
        changes = [unknowns[: sums.base.rank] for unknowns in solutions]
        width = selection.width.copy()
        for j in range(sums.nominal.n):
            width[j] = _sharpest_width(sums, selection, changes, j)
        selection = replace(selection, width=width)
    return selection, noise


def _sharpest_width(
    sums: HeldOutSums, selection: Selection, changes: Sequence[Float[Array, " r"]], joint: int
) -> int:
    """The place in the grid of the sharpest turning that is not surely worse than the best one.

    That is Coulomb's own law where nothing else shows.
    """
    columns = OwnColumns.of(sums, joint, changes)
    squares = []
    for place in range(len(TRANSITION_GRID)):
        trial = replace(selection, width=np.full(len(selection.width), place))
        squares.append(_errors_of_joint(sums, trial, columns, joint).squares)
    best = int(np.argmin([square.sum() for square in squares]))
    sharper = enumerate(squares[: best + 1])
    return next(place for place, square in sharper if not surely_less(square, squares[best]))


def _errors_of_joint(
    sums: HeldOutSums, selection: Selection, columns: OwnColumns, joint: int
) -> OwnErrors:
    """What a joint's model leaves of each part left out."""
    return columns.errors(*_own_columns(sums, selection, joint))


def _own_columns(
    sums: HeldOutSums, selection: Selection, joint: int
) -> tuple[Int[Array, " c"], Bool[Array, " c"]]:
    """Which of a joint's own columns a selection takes; which coefficients can't be negative."""
    places, signed = selection.of_joint(sums, joint)
    return places - sums.base.rank, signed


def _error(
    sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float
) -> tuple[float, Float[Array, " f"]]:
    """Squares of all joints left of all parts, in units of noise, and the work of each part."""
    errors, _ = left_out(sums, selection, noise, "base", share)
    squares = float(np.sum(errors.squares.sum(axis=0) / noise**2))
    return squares, errors.work.sum(axis=1)


def _drop_offsets(
    sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float
) -> Selection:
    """No offsets where runs left out are foretold as well without them."""
    none = replace(selection, offset=np.zeros(sums.nominal.n, dtype=bool))
    without, _ = _error(sums, none, noise, share)
    with_offsets, _ = _error(sums, selection, noise, share)
    return none if without <= (1.0 + AS_GOOD) ** 2 * with_offsets else selection


def _drop_laws(
    sums: HeldOutSums, selection: Selection, noise: Float[Array, " n"], share: float, given: int
) -> Selection:
    """Laws go without which runs left out are foretold no worse, the last ones first.

    All is fitted anew without each. The first `given` laws stay.
    """
    least, _ = _error(sums, selection, noise, share)
    for number in reversed(selection.laws[given:]):
        others = tuple(law for law in selection.laws if law != number)
        trial = replace(selection, laws=others)
        error, _ = _error(sums, trial, noise, share)
        if error <= least:
            selection = trial
            least = error
    none = replace(selection, laws=selection.laws[:given])
    _, work_without = _error(sums, none, noise, share)
    _, work = _error(sums, selection, noise, share)
    return selection if no_worse_work(work_without, work) else none


def _further_laws(nominal: ArmModel) -> tuple[NamedLaw, ...]:
    """Laws that are tried at every joint."""
    laws = []
    for joint in range(nominal.n):
        for effect, shape in TRIED_LAWS:
            laws.append(NamedLaw(effect, joint, shape))
    return tuple(laws)


def _choose_laws(
    sums: HeldOutSums, selection: Selection, changes: Sequence[Float[Array, " r"]]
) -> Selection:
    """Laws that runs left out ask for, joint by joint."""
    chosen = list(selection.laws)
    for joint in range(sums.nominal.n):
        laws = _choose_laws_of_joint(sums, selection, changes, joint)
        chosen += [number for number in laws if number not in chosen]
    return replace(selection, laws=tuple(chosen))


def _choose_laws_of_joint(
    sums: HeldOutSums, selection: Selection, changes: Sequence[Float[Array, " r"]], joint: int
) -> list[int]:
    """Numbers of the laws that runs left out ask for at a joint, the most helpful first.

    At most one law of an effect. Laws of the selection stay.
    """
    columns = OwnColumns.of(sums, joint, changes)
    chosen = [number for number in selection.laws if sums.laws[number].joint == joint]

    def errors_with(laws: Sequence[int]) -> OwnErrors:
        return _errors_of_joint(sums, replace(selection, laws=tuple(laws)), columns, joint)

    def clear_squares_with(laws: Sequence[int]) -> Float[Array, " f"]:
        trial = replace(selection, laws=tuple(laws))
        return columns.clear_squares(*_own_columns(sums, trial, joint))

    before = errors_with(chosen)
    while len(chosen) < MOST_LAWS:
        trials = _untried_laws(sums, chosen, joint)
        if not trials:
            break
        errors = [errors_with([*chosen, number]) for number in trials]
        best = int(np.argmin([error.squares.sum() for error in errors]))
        with_law = [*chosen, trials[best]]
        if not _is_better(before, errors[best]):
            break
        # What helps near starts, stops and reversals alone mends what is smeared there, or how
        # friction turns round: a law helps where the joint slides, too.
        clear_before = clear_squares_with(chosen)
        clear_after = clear_squares_with(with_law)
        if not helps_alike(clear_before, clear_after, CONFIRMED):
            break
        chosen = with_law
        before = errors[best]
    return chosen


def _is_better(before: OwnErrors, after: OwnErrors) -> bool:
    """Whether squares surely fall, all alike or part by part, and work is no worse."""
    falls = helps(before.squares, after.squares) or helps_alike(before.squares, after.squares)
    return falls and no_worse_work(before.work, after.work)


def _untried_laws(sums: HeldOutSums, chosen: Sequence[int], joint: int) -> list[int]:
    """Numbers of a joint's laws whose effect is not chosen yet."""
    taken = {sums.laws[number].effect for number in chosen}
    numbers = []
    for number, law in enumerate(sums.laws):
        if law.joint == joint and law.effect not in taken:
            numbers.append(number)
    return numbers
