"""What every effect keeps to, the catalogue's and a user's alike; `check_effect` tries it.

The laws: its record states what its fields hold; columns have the shape that `rows` says, are
finite, the same whenever they are asked for, those of a part of the session the same as those of
the whole, and none of them looks at the measured torque; parameters are intervals about their
values, and what the record names among them is there; sizes are positive; a sentence is one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from ident.arrays import Array, Float
from ident.effects import optional
from ident.effects.base import Effect
from ident.effects.effect_info import SHOWINGS
from ident.effects.interval import Interval
from ident.effects.record import record_fields
from ident.effects.session_context import RunContext, SessionContext, Variant
from ident.errors import InputError

# Columns that should be the same may differ by this share of the largest: rounding.
ROUNDING = 1e-9
# What is added to the measured torque to see whether columns look at it [N m].
LOUDER = 100.0
# Of an effect's grid and joints so many are looked at; a check need not be a search.
MOST_POINTS = 8
MOST_JOINTS = 2


def require_record(effect: Effect | type[Effect], where: str | Path) -> None:
    """Checks what an effect, or its class, states beside the law.

    Args:
        effect: The effect.
        where: The file or effect, for the message.

    Raises:
        InputError: A field holds what it can't; names it and says what it holds.
    """
    kind = effect if isinstance(effect, type) else type(effect)
    for name, hint in record_fields().items():
        value = getattr(effect, name, None)
        if not _fits(value, hint):
            what = f"{name} of {kind.__name__} is {value!r}"
            raise InputError(where, what, f"it holds {_words(hint)}: see EffectRecord")
    if effect.shown_by not in SHOWINGS:
        what = f"{kind.__name__} is shown by {effect.shown_by!r}, which is no kind of motion"
        raise InputError(where, what, f"give one of: {', '.join(SHOWINGS)}")
    for other, family in effect.parted_by.items():
        if family not in SHOWINGS:
            what = f"{kind.__name__} is parted from {other} by {family!r}, no kind of motion"
            raise InputError(where, what, f"give one of: {', '.join(SHOWINGS)}")


def check_effect(effect: Effect, session: SessionContext) -> None:
    """Tries the laws that every effect keeps to, in runs that can show it.

    Args:
        effect: The effect.
        session: Some runs of an arm, as effects see them.

    Raises:
        InputError: The effect breaks one; says which, where, and what to do.
    """
    require_record(effect, effect.id)
    joints = range(session.n if effect.scope == "joint" else 1)
    shown = [joint for joint in joints if _reason(effect, session, joint) is None]
    for joint in shown[:MOST_JOINTS]:
        for variant in _points(effect, session, joint)[:MOST_POINTS]:
            columns = _check_columns(effect, session, joint, variant)
            width = columns[0].shape[-1]
            _check_indices(effect, variant, width)
            _check_reported(effect, session, joint, variant, width)


def _require(holds: bool, effect: Effect, what: str, remedy: str) -> None:
    """Raises for a law that does not hold."""
    if not holds:
        raise InputError(effect.id, what, remedy)


def _reason(effect: Effect, session: SessionContext, joint: int) -> str | None:
    """Why the effect can't be shown at a joint."""
    reason = effect.untestable(session, joint)
    told = reason is None or (isinstance(reason, str) and bool(reason))
    _require(told, effect, f"untestable gives {reason!r}", "return a reason, or None")
    return reason


def _points(effect: Effect, session: SessionContext, joint: int) -> Sequence[Variant]:
    """Points of its grid: all bear the same inner parameters, and each has a finer grid."""
    points = effect.variants(session, joint)
    names = {frozenset(point.inner) for point in points}
    told = "its points bear different inner parameters"
    _require(len(names) <= 1, effect, told, "state the same names in all variants")
    for point in points[:1]:
        finer = optional.refined(effect, session, joint, point)
        _require(len(finer) > 0, effect, "refined gives no point", "return the point itself")
    return points


def _check_columns(
    effect: Effect, session: SessionContext, joint: int, variant: Variant
) -> list[Float[Array, "T ..."]]:
    """Columns: their shape, and what they may hang on."""
    columns = effect.columns(session, joint, variant)
    count = len(session.runs)
    told = f"columns gives {len(columns)} arrays for {count} runs"
    _require(len(columns) == count, effect, told, "return one array a run")
    width = columns[0].shape[-1]
    for run, values in zip(session.runs, columns, strict=True):
        samples = len(run.motion.time[run.motion.coarse] if effect.decimated else run.motion.time)
        lead = (samples,) if effect.rows == "own" else (samples, session.n)
        told = f"columns of {run.motion.name} have shape {values.shape}, not {(*lead, width)}"
        _require(values.shape == (*lead, width), effect, told, "see `rows`")
        finite = bool(np.isfinite(values).all())
        _require(finite, effect, f"columns of {run.motion.name} are not finite", "mend the law")
    again = effect.columns(session, joint, variant)
    told = "columns differ when they are asked for again"
    _require(_alike(columns, again), effect, told, "draw no random numbers, keep no state")
    louder = [_with_louder_torque(session, k) for k in range(count)]
    deaf = effect.columns(replace(session, runs=tuple(louder)), joint, variant)
    told = "columns hang on the measured torque"
    _require(
        _alike(columns, deaf),
        effect,
        told,
        "take modelled torques: what explains itself explains nothing",
    )
    late = effect.columns(replace(session, runs=session.runs[-1:]), joint, variant)
    told = "columns of a run change with the runs beside it"
    remedy = "put what is of the whole session into the variant's shape"
    _require(_alike(columns[-1:], late), effect, told, remedy)
    return columns


def _with_louder_torque(session: SessionContext, number: int) -> RunContext:
    """A run of a session with `LOUDER` [N m] added to its measured torque, else as it was."""
    run = session.runs[number]
    return replace(run, motion=replace(run.motion, tau=run.motion.tau + LOUDER))


def _alike(columns: Sequence[Array], others: Sequence[Array]) -> bool:
    """Whether columns are the same but for rounding."""
    for values, again in zip(columns, others, strict=True):
        largest = float(np.abs(values).max(initial=ROUNDING))
        if values.shape != again.shape or not np.allclose(values, again, atol=ROUNDING * largest):
            return False
    return True


def _check_indices(effect: Effect, variant: Variant, width: int) -> None:
    """Columns that are told by their number are there."""
    numbers = optional.signed(effect, variant)
    there = all(0 <= number < width for number in numbers)
    what = f"nonnegative speaks of columns {tuple(numbers)}, of {width}"
    _require(there, effect, what, "count columns from 0")


def _check_reported(
    effect: Effect, session: SessionContext, joint: int, variant: Variant, width: int
) -> None:
    """What is reported of coefficients of half the plausible size."""
    scale = effect.prior_scale(session, joint, variant)
    if scale is not None:
        has_shape = np.shape(scale) == (width,)
        sound = has_shape and bool(np.all(np.asarray(scale) > 0.0))
        what = f"prior_scale gives {scale}, for {width} columns"
        _require(sound, effect, what, "return a positive size for each column")
    sizes = np.ones(width) if scale is None else np.asarray(scale, dtype=float)
    covariance = np.diag(0.01 * sizes**2)
    estimates = effect.parameters(session, joint, variant, 0.5 * sizes, covariance)
    _check_estimates(effect, estimates)
    missing = _missing(effect, estimates)
    what = f"its record names {', '.join(missing)}, which parameters doesn't report"
    _require(not missing, effect, what, "report them, or name others")
    unbounded = set(effect.physical(session, joint, estimates)) - set(estimates)
    what = f"physical bounds {', '.join(sorted(unbounded))}, which parameters doesn't report"
    _require(not unbounded, effect, what, "bound reported parameters")
    sentence = effect.action("the joint", estimates)
    plain = bool(sentence) and sentence[0].islower() and not sentence.endswith(".")
    _require(
        plain, effect, f"its action is {sentence!r}", "say it in one sentence without full stop"
    )


def _check_estimates(effect: Effect, estimates: Mapping[str, Interval]) -> None:
    """Reported parameters are intervals about their values."""
    for name, interval in estimates.items():
        sound = isinstance(interval, Interval) and interval.low <= interval.value <= interval.high
        _require(sound, effect, f"parameter {name} is {interval!r}", "return an Interval about it")


def _missing(effect: Effect, estimates: Mapping[str, Interval]) -> list[str]:
    """Parameters that the record names and nobody reports; of those that define it one will do."""
    named = {*effect.figures, *filter(None, [effect.typical.figure])}
    missing = sorted(named - set(estimates))
    if effect.defining and not set(effect.defining) & set(estimates):
        missing += effect.defining
    return missing


def _fits(value: object, hint: Any) -> bool:
    """Whether a value is what an annotation says."""
    kind = get_origin(hint)
    inner = get_args(hint)
    if kind is Literal:
        return value in inner
    if kind in (Union, UnionType):
        return any(_fits(value, option) for option in inner)
    if hint is NoneType:
        return value is None
    if kind is None:
        return _is_a(value, hint)
    if kind is tuple and inner[-1] is not Ellipsis:
        pairs = zip(value, inner, strict=False) if isinstance(value, tuple) else ()
        return isinstance(value, tuple) and all(_fits(item, option) for item, option in pairs)
    if issubclass(kind, Mapping):
        return isinstance(value, Mapping) and all(_fits(item, inner[1]) for item in value.values())
    return isinstance(value, kind) and all(_fits(item, inner[0]) for item in value)


def _is_a(value: object, kind: Any) -> bool:
    """Whether a value is of a class; a whole number is a number, too."""
    if kind is float:
        return isinstance(value, int | float)
    if kind is bool or kind is int:
        return type(value) is kind
    return isinstance(value, kind)


def _words(hint: Any) -> str:
    """An annotation in words of Python."""
    return getattr(hint, "__name__", str(hint)) if get_origin(hint) is None else str(hint)
