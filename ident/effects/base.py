"""What an effect is: columns of extra joint torque that a model lacks, linear in coefficients, inside a small grid.

An effect says what torque it would add, given the motion; it never sees the measured torque. The diagnosis filters the
columns like the measured torque, takes out what a refit of the baseline could explain, and asks the data. What else is
known of it is a row of `effects.toml`, or class attributes of a user's effect.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any, ClassVar, Literal

import numpy as np

from ident.arrays import Array, Float
from ident.effects.effect_info import AsChange, Doubt, Expression, Interval, Range, Typical, read_row
from ident.effects.intervals import SizePrior, coefficient_interval, delta_interval, grid_interval, linear_interval
from ident.effects.session_context import (
    RunContext,
    SessionContext,
    Variant,
    arm_mass,
    arm_reach,
    friction_level,
    lacking,
    least_rest_speed,
    rated_torque,
)
from ident.laws.carried import JointStates, LawKind, evaluate, states_of

__all__ = ["Effect", "Expression", "Interval", "Range", "RunContext", "SessionContext", "Variant"]
__all__ += ["delta_interval", "linear_interval"]


class Effect(ABC):
    """An effect of the catalogue."""

    id: ClassVar[str]  # fixed identifier
    # `joint` if it belongs to one joint (or the link that the joint moves), `arm` if to the whole arm.
    scope: ClassVar[Literal["joint", "arm"]] = "joint"
    # `own` if its torque acts on its own joint only: columns of shape (T, k); `all` if on any: (T, n, k).
    rows: ClassVar[Literal["own", "all"]] = "own"
    nonnegative: ClassVar[tuple[int, ...]] = ()  # indices of columns whose coefficients can't be negative
    # Whether wrong inertias of several links could do the same: then tuning them hides the effect.
    inertia_like: ClassVar[bool] = False
    # Whether it happens once: other runs say nothing of its size, and it can't be held out.
    event: ClassVar[bool] = False
    # Whether it acts only beyond a bound of its own (below a speed, past a gap or a travel): how large it seems in a
    # run hangs on how far the run went beyond, where the law isn't the catalogue's to the letter.
    beyond_bound: ClassVar[bool] = False
    # Whether runs act on later ones.
    remembers: ClassVar[bool] = False
    # Whether it acts on whole runs: blocks of one run are no independent witnesses to it.
    by_run: ClassVar[bool] = False
    # Whether its columns are of the samples that the common filter keeps, so smooth that they need no filter.
    decimated: ClassVar[bool] = False
    screens: int = 1
    summary: ClassVar[str] = ""  # one line for reports: what happens and where to look
    # What recordings must hold to show it, by name with the least amount: see `session_context.lacking`.
    needs: ClassVar[Mapping[str, float]] = {}
    # Family of the motion without which it can't be seen, one of `effect_info.SHOWINGS`.
    shown_by: ClassVar[str] = "wide"
    # For other effects, by id, the family of the motion that distinguishes the two, where it is not simply the one that
    # shows one of them.
    parted_by: ClassVar[Mapping[str, str]] = {}
    # For other effects, by id, the change of set-up that distinguishes the two, where no motion does.
    set_ups: ClassVar[Mapping[str, str]] = {}
    twins: ClassVar[tuple[str, ...]] = ()  # other effects, by id, whose columns span its own exactly
    # Reported parameters without which there is no such effect: where the intervals of all of them hold zero, it gets
    # no name.
    defining: ClassVar[tuple[str, ...]] = ()
    typical: ClassVar[Typical] = Typical()  # how large it is taken to be where nobody has found it yet
    doubt: ClassVar[Doubt] = Doubt()  # how far an arm's own law may differ from this one
    partner: ClassVar[str] = ""  # the parameter that is the number of another joint that takes part, or ""
    # Whether it is one of the log alone: the joint gets another torque than what is read.
    of_the_log: ClassVar[bool] = False
    # Whether the reported parameters leave its law open: a diagnosis then reports coefficients and shape beside.
    open_law: ClassVar[bool] = False
    open_shape: ClassVar[bool] = False  # whether they leave open no more than the point of the grid
    left_open: ClassVar[str] = ""  # what even these leave open for a simulator, and what is taken then; "" for nothing
    # Reported parameters that are the columns' coefficients, one after the other; see `parameters`.
    figures: ClassVar[tuple[str, ...]] = ()
    # Largest plausible coefficients, numbers or shares of what the joint has ("0.5 rated"); see `prior_scale`.
    prior: ClassVar[tuple[float | str, ...]] = ()
    # By parameter, its least and largest value, like `prior`, and why no arm has others; see `physical`.
    bounds: ClassVar[Mapping[str, tuple[float | str, float | str, str]]] = {}
    sentence: ClassVar[str] = ""  # what to do about it, with {where} and parameters as {gap_rad:mrad}; see `action`
    # How `urdf` and `mjcf` express it, where that is not by damping and dry friction.
    formats: ClassVar[Mapping[str, Expression]] = {}
    # Its torque in a patch's module, of effects outside the catalogue: a static function (m, j, p) of the motion (m.q,
    # m.dq, m.ddq, m.direction, of shape (T, n)), the joint's index and the parameters by name, that uses NumPy alone
    # and returns shape (T, n); `m.at(j, torque)` puts a torque of shape (T,) at one joint.
    law: ClassVar[Callable[[Any, int, dict[str, float]], Array] | None] = None
    as_change: ClassVar[AsChange] = AsChange()  # what is known of it as a change between two sets of recordings
    # What its curve is drawn over: `speed`, `angle`, `load`, `torque` (load with friction and rotor), `reversal` (time
    # since one); "" for time.
    drawn_over: ClassVar[str] = ""
    # `whole` where the tuned friction is drawn with it, `odd` where its direction is taken out; else "".
    drawn: ClassVar[Literal["", "whole", "odd"]] = ""
    incomparable: ClassVar[frozenset[str]] = frozenset()  # parameters that a simulated arm's answer means otherwise
    opposite: ClassVar[frozenset[str]] = frozenset()  # parameters that it gives with the other sign

    def __init_subclass__(cls) -> None:
        """An effect of the catalogue takes what it does not say itself from its row of `effects.toml`."""
        for name, value in read_row(cls.__dict__.get("id", "")).items():
            if name not in cls.__dict__:
                setattr(cls, name, value)

    def screened(self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]) -> Effect:
        """The effect after a first look at what the tuned model leaves; events learn there when they may have been.

        Args:
            session: All runs.
            leftover: For each run what the model leaves of the torque but not in the same states at other times,
                filtered and decimated, at rest and near stops and turns what goes beyond friction; NaN at a run's
                ends [N m].
        """
        return self

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        """Why these recordings can't show the effect at a joint at all, or None. Must be cheap."""
        return lacking(self.needs, session, joint)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """The inner grid at a joint (`joint` is 0 for an effect of the whole arm)."""
        return (Variant(),)

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        """Whether a point of the inner grid is right about such coefficients: a law made linear there holds near it."""
        return True

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """A finer grid around a point of the inner grid that fits best; laws without inner parameters have none."""
        return (variant,)

    @abstractmethod
    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        """Torque columns of every run [N m per unit of coefficient], (T, k) or (T, n, k) by `rows`.

        Whole sessions are asked for at once because some effects remember from run to run.
        """

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Float[Array, " k"],
        covariance: Float[Array, "k k"],
    ) -> dict[str, Interval]:
        """Physical parameters of the catalogue from coefficients; 95 % intervals for a known variant.

        By default the coefficients themselves, by the names of `figures`.
        """
        names = self.figures or [f"coefficient_{k}" for k in range(len(coefficients))]
        return {name: coefficient_interval(k, coefficients, covariance) for k, name in enumerate(names)}

    def without_dry_friction(
        self, coefficients: Float[Array, " k"], variant: Variant
    ) -> tuple[Float[Array, " k"], float]:
        """Its coefficients without what is a joint's usual dry friction, and that friction [N m].

        Where columns can't be distinguished from dry friction, the tuned joint has it, not the effect: it is there when
        the effect is gone.
        """
        return coefficients, 0.0

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"] | None:
        """Largest plausible size of each coefficient (two standard deviations of the prior), or None for flat."""
        return np.array([_sized(one, session, joint) for one in self.prior]) if self.prior else None

    def typical_coefficients(
        self, session: SessionContext, joint: int, variant: Variant, width: int
    ) -> Float[Array, " k"]:
        """Coefficients of its columns, so many of them, where it is as large as is typical."""
        scale = self.prior_scale(session, joint, variant)
        beta = self.typical.share * (np.ones(width) if scale is None else np.asarray(scale, dtype=float)[:width])
        beta[[k for k in self.typical.absent if k < width]] = 0.0
        return beta

    def size_of(self, session: SessionContext, joint: int, variant: Variant, coefficients: Array) -> float:
        """The reported parameter that scales it, as coefficients have it, without its sign."""
        nothing = np.zeros((len(coefficients), len(coefficients)))
        found = self.parameters(session, joint, variant, coefficients, nothing)
        return abs(float(found[self.typical.figure].value))

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior | None:
        """What is known of its coefficients beforehand; None where each costs what any free parameter does.

        Needed of what is known well enough to tell a small one from the errors that a URDF has anyway.
        """
        return None

    def physical(self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]) -> dict[str, Range]:
        """What reported parameters can be on this arm, by name; parameters that may be anything are left out."""
        return {
            name: Range(_sized(low, session, joint), _sized(high, session, joint), reason)
            for name, (low, high, reason) in self.bounds.items()
        }

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        """What a person at the cell can do about it: one sentence without a full stop.

        Args:
            where: The joint's name, or those of the joints where an effect of the whole arm shows.
            estimates: The reported parameters.
        """
        if self.sentence:
            return self.sentence.format(where=where, **estimates)
        stated = ", ".join(f"{name} {one.value:.3g}" for name, one in estimates.items())
        return f"add {self.id.replace('_', ' ')} of {where} to the model ({stated}): `ident patch` writes it"

    def parts(self, variant: Variant) -> Sequence[tuple[Variant, Sequence[int]]]:
        """Further points of the grid that have some of the columns of this one, and which of them."""
        return ()

    def signed(self, variant: Variant) -> tuple[int, ...]:
        """Columns of a point of the inner grid whose coefficients can't be negative."""
        return self.nonnegative

    def tells_law(self, variant: Variant) -> bool:
        """Whether a diagnosis reports coefficients and shape of this point beside the reported parameters."""
        return self.open_law or self.open_shape

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """Parameters that its law needs beside the reported ones.

        Args:
            reported: The reported parameters.
            coefficients: Those of its columns, where a diagnosis tells them (`open_law`); else empty.
            shape: Shape and inner parameters of the point of the grid that they belong to; else empty.
        """
        return {name: value for name, value in shape.items() if name not in reported}

    def expressed(self, form: str, parameters: Mapping[str, float]) -> Expression | None:
        """How a format (`urdf`, `mjcf`) expresses it with these parameters; None where it is friction to the format."""
        return self.formats.get(form)

    def compared(self, true: Mapping[str, Any], starts: Sequence[float]) -> dict[str, float]:
        """Parameters of a simulated arm's answer in this effect's terms, as far as they have a counterpart.

        Args:
            true: The answer's parameters; names of joints among them have none.
            starts: Session time at which each run starts [s].
        """
        values = {name: float(value) for name, value in true.items() if not isinstance(value, str)}
        kept = {name: value for name, value in values.items() if name not in self.incomparable}
        return {name: -value if name in self.opposite else value for name, value in kept.items()}


# Bounds are of the arm's own rating and friction, which nobody knows better than by this factor.
KNOWN_WITHIN = 1.5
# The number of a grid that must be a speed of motion.
SLOWEST = "stribeck_velocity_rad_s"


def _sized(size: float | str, session: SessionContext, joint: int) -> float:
    """A number, or a share of what a joint has ("0.5 rated" [N m], "3 coulomb" [N m], "1 viscous" [N m s/rad]), or of
    what the arm has ("1 mass" [kg], "0.5 reach" [m]).
    """
    if not isinstance(size, str):
        return float(size)
    share, of = size.split()
    if of == "rated":
        whole = rated_torque(session, joint)
    elif of in ("coulomb", "viscous"):
        whole = friction_level(session, joint)[("coulomb", "viscous").index(of)]
    else:
        whole = {"mass": arm_mass, "reach": arm_reach}[of](session.runs[0].arm)
    return float(share) * whole


class StatesEffect(Effect):
    """An effect with a law of `ident.laws`; one whose row has a `grid` of what bends the law needs no class.

    Args:
        effect: Its id; those of a class have their own.
    """

    states: ClassVar[LawKind]
    needs: ClassVar[Mapping[str, float]] = {"moves": 1.0}
    grid: ClassVar[Mapping[str, Sequence[float]]] = {}
    finer: ClassVar[Mapping[str, Mapping[str, Sequence[float]]]] = {}

    def __init__(self, effect: str = "") -> None:
        vars(self).update({"id": effect, **read_row(effect)} if effect else {})

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """Every combination of the grid's numbers; speeds that are no motion in these recordings are left out."""
        return self._points(session, joint, self.grid)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """The same of `finer`: numbers, or factors of the point's own."""
        if not self.finer:
            return (variant,)
        grid = {
            name: [factor * variant.inner[name] for factor in one.get("times", ())] or one["at"]
            for name, one in self.finer.items()
        }
        return self._points(session, joint, grid)

    def _points(self, session: SessionContext, joint: int, grid: Mapping[str, Sequence[float]]) -> Sequence[Variant]:
        rest = least_rest_speed(session, joint) if SLOWEST in grid else 0.0
        points = [dict(zip(grid, point, strict=True)) for point in product(*grid.values())]
        return tuple(Variant(point) for point in points if point.get(SLOWEST, np.inf) > rest)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        shape = {**variant.shape, **variant.inner}
        found = []
        for run in session.runs:
            at = states_of(joint, run.motion.q, run.motion.dq, run.link, run.direction)
            found.append(evaluate(self.states.columns, at, shape))
        return found

    def at_state(self, shape: Mapping[str, float], dq: float, load: float = 0.0) -> Array:
        """Its columns at an angle of zero, sliding as the speed says: what sentences evaluate, shape (k,)."""
        at = JointStates(*(np.array([value]) for value in (0.0, dq, load, float(np.sign(dq)))))
        return evaluate(self.states.columns, at, shape)[0]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        """The coefficients by the names of `figures`, and the point of the grid with what the grid resolves."""
        bent = {name: grid_interval(value, self.grid.get(name, (value,))) for name, value in variant.inner.items()}
        return {**super().parameters(session, joint, variant, coefficients, covariance), **bent}

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """The point of the grid, and the coefficients that were found there, or those that the parameters tell."""
        stated = coefficients or [reported[name] for name in self.figures or self.defining]
        return {**self.states.usual, **shape, **{f"coefficient_{k}": float(value) for k, value in enumerate(stated)}}


def impossible(effect: Effect, session: SessionContext, joint: int, estimates: Mapping[str, Interval]) -> str | None:
    """Why no arm has an effect of such parameters, or None: a 95 % interval that lies beyond a bound as a whole."""
    for name, allowed in effect.physical(session, joint, estimates).items():
        found, value = estimates[name], estimates[name].value
        # Both ends of a range about zero are sizes; a lower end of its own is a law (friction does not drive).
        slack = KNOWN_WITHIN if allowed.low in (0.0, -allowed.high) else 1.0
        possible = found.high >= slack * allowed.low and found.low <= slack * allowed.high
        if not (np.isfinite(value) and possible):
            bounds = f"lies outside {allowed.low:.3g} to {allowed.high:.3g}"
            where = bounds if allowed.low <= allowed.high else "is not determined"
            return f"{name} {value:.3g} {where}: {allowed.reason}"
    return None
