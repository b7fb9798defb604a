"""What an effect is: columns of extra joint torque that a model lacks, linear in coefficients, inside a small grid.

An effect says what torque it would add, given the motion; it never sees the measured torque. The diagnosis filters the
columns like the measured torque, takes out what a refit of the baseline could explain, and asks the data.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.knowledge import Doubt, Expression, Interval, Range, Typical
from ident.effects.size_prior import SizePrior
from ident.motion.motion import Motion
from ident.motion.out_of_core import choose_runs
from ident.robot.arm import ArmModel

T = TypeVar("T")

__all__ = ["Effect", "Interval", "RunContext", "SessionContext", "Variant", "delta_interval", "linear_interval"]


@dataclass(frozen=True, eq=False)
class RunContext:
    """One run as the effects see it; T samples of n joints, before the common filter.

    Attributes:
        motion: The run (q, dq, ddq smoothed, time on the session clock, filter).
        arm: The rigid arm with its payload.
        rigid: Rigid torque of the motion [N m].
        link: Modelled torque that the joint transmits: rigid torque without rotor inertia and friction [N m].
        friction: Modelled friction torque of the baseline (viscous + Coulomb) [N m].
        direction: Direction of sliding in [-1, 1]; each joint turns round over its own displacement or speed.
        temperature: Measured joint temperature [degC], or None.
        position_command: Commanded position [rad], or None.
        rotor: Modelled torque of the rotors' inertia [N m], or None where it isn't modelled.

    The regressor and the derivatives are computed once, when first asked for, and live as long as the run does: a long
    session is gone through with fresh copies of its runs (`dataclasses.replace`), a few at a time.
    """

    motion: Motion
    arm: ArmModel
    rigid: Float[Array, "T n"]
    link: Float[Array, "T n"]
    friction: Float[Array, "T n"]
    direction: Float[Array, "T n"]
    temperature: Float[Array, "T n"] | None = None
    position_command: Float[Array, "T n"] | None = None
    rotor: Float[Array, "T n"] | None = None

    @property
    def n(self) -> int:
        return self.motion.n

    @property
    def total(self) -> Float[Array, "T n"]:
        """Whole modelled torque of the motor, seen at the joint [N m]."""
        torque: Array = self.rigid + self.friction
        return torque if self.rotor is None else torque + self.rotor

    @cached_property
    def regressor(self) -> Float[Array, "T n 10n"]:
        """Regressor of the rigid torque in the links' inertial parameters."""
        return self.arm.regressor(self.motion.q, self.motion.dq, self.motion.ddq)

    @cached_property
    def derivatives(self) -> tuple[Float[Array, "T n n"], Float[Array, "T n n"], Float[Array, "T n n"]]:
        """Derivatives of the rigid torque by position, velocity and acceleration; rows are torques.

        Each of their entries lies side by side for all samples: they are asked for one by one.
        """
        by_sample = self.arm.derivatives(self.motion.q, self.motion.dq, self.motion.ddq)
        q, dq, ddq = (np.moveaxis(np.ascontiguousarray(np.moveaxis(one, 0, -1)), -1, 0) for one in by_sample)
        return q, dq, ddq

    @cached_property
    def kept(self) -> dict[Any, Any]:
        """What else was made of the run and will be asked for again, by whatever names it."""
        return {}

    def copied(self) -> RunContext:
        """A copy that knows the derivatives if this one does, and takes what more it computes along when it goes."""
        copy = replace(self)
        if "derivatives" in vars(self):
            vars(copy)["derivatives"] = self.derivatives
        return copy

    @property
    def interval(self) -> float:
        """Sampling interval [s]."""
        return self.motion.interval


@dataclass(frozen=True, eq=False)
class SessionContext:
    """All runs, in order, and what holds for all of them.

    Attributes:
        runs: The runs.
        common_clock: Whether time goes on from run to run.
        joint_names: The joints.
        gear_ratios: Reduction of each joint, or None where it is not known.
        rated_torque: Effort limits [N m].
        tuned: Change of the links' inertial numbers by tuning, shape (10 n,), or None where nobody tuned them.
        every: One of how many runs is asked for typical sizes: 1, or more where the runs of hours wait on disk.
    """

    runs: Sequence[RunContext]
    common_clock: bool
    joint_names: tuple[str, ...]
    gear_ratios: Float[Array, " n"] | None
    rated_torque: Float[Array, " n"]
    tuned: Float[Array, " 10n"] | None = None
    every: int = 1

    @property
    def n(self) -> int:
        return len(self.joint_names)

    @cached_property
    def survey(self) -> SessionContext:
        """The session itself, or an even choice of its runs, held in memory, where there are very many."""
        return self if self.every == 1 else replace(self, runs=tuple(self.surveyed(self.runs)), every=1)

    def surveyed(self, of_runs: Sequence[T]) -> Sequence[T]:
        """Of what there is one of for each run, those of the survey's runs."""
        return [of_runs[k] for k in choose_runs(len(of_runs), self.every)]


@dataclass(frozen=True)
class Variant:
    """One point of an effect's inner grid: the figures in which its torque is not linear.

    Attributes:
        inner: Names (with units) and values, such as {"stribeck_velocity_rad_s": 0.05, "exponent": 2}; the same names
            in all variants of an effect. They are reported, with intervals from their likelihood over the grid.
        other: Another joint that takes part (coupling), or None.
        shape: Further figures that the columns need and nobody asks for: centres and scales of the whole session,
            points about which a law is linearised. Columns of a part of a session then match those of the whole.
    """

    inner: Mapping[str, float] = field(default_factory=dict)
    other: int | None = None
    shape: Mapping[str, float] = field(default_factory=dict)


class Effect(ABC):
    """An effect of the catalogue.

    Class attributes:
        id: Fixed identifier.
        scope: `joint` if it belongs to one joint (or the link that the joint moves), `arm` if to the whole arm.
        rows: `own` if its torque acts on its own joint only: columns of shape (T, k); `all` if on any: (T, n, k).
        nonnegative: Indices of columns whose coefficients can't be negative.
        inertia_like: Whether wrong inertias of several links could do the same: then tuning them hides the effect.
        event: Whether it happens once: other runs say nothing of its size, and it can't be held out.
        bursts: Whether it acts in short bursts, so that a mean over the session says little of its size.
        beyond_bound: Whether it acts only beyond a bound of its own (below a speed, past a gap or a travel): how large
            it seems in a run hangs on how far the run went beyond, where the law isn't the catalogue's to the letter.
        remembers: Whether runs act on later ones: its figures then need every run, not an even choice of them.
        by_run: Whether it acts on whole runs: blocks of one run are no independent witnesses to it.
        summary: One line for reports: what happens and where to look.
        shown_by: Family of the motion without which it can't be seen, one of `informative_motions.SHOWINGS`.
        parted_by: For other effects, by id, the family of the motion that tells the two apart, where it is not simply
            the one that shows one of them.
        set_ups: For other effects, by id, the change of set-up that tells the two apart, where no motion does.
        twins: Other effects, by id, whose columns span its own exactly.
        defining: Reported figures without which there is no such effect: where the intervals of all of them hold zero,
            nothing is named.
        typical: How large it is taken to be where nobody has found it yet.
        doubt: How far an arm's own law may differ from this one.
        partner: The figure that is the number of another joint that takes part, or "".
        of_the_log: Whether it is one of the log alone: the joint gets another torque than what is read.
        open_law: Whether the reported figures leave its law open: a diagnosis then tells coefficients and shape beside.
        left_open: What even these leave open for a simulator, and what is taken then; "" for nothing.
        formats: How `urdf` and `mjcf` express it, where that is not by damping and dry friction.
        law: Its torque in a patch's module, of effects outside the catalogue: a static function (m, j, p) of the
            motion (m.q, m.dq, m.ddq, m.direction, of shape (T, n)), the joint's index and the figures by name, that
            uses NumPy alone and returns shape (T, n); `m.at(j, torque)` puts a torque of shape (T,) at one joint.
        incomparable: Figures that mean something else in a simulated arm's answer.
        opposite: Figures that a simulated arm's answer tells with the other sign.
    """

    id: ClassVar[str]
    scope: ClassVar[Literal["joint", "arm"]] = "joint"
    rows: ClassVar[Literal["own", "all"]] = "own"
    nonnegative: ClassVar[tuple[int, ...]] = ()
    inertia_like: ClassVar[bool] = False
    event: ClassVar[bool] = False
    bursts: ClassVar[bool] = False
    beyond_bound: ClassVar[bool] = False
    remembers: ClassVar[bool] = False
    by_run: ClassVar[bool] = False
    screens: int = 1
    summary: ClassVar[str] = ""
    shown_by: ClassVar[str] = "wide"
    parted_by: ClassVar[Mapping[str, str]] = {}
    set_ups: ClassVar[Mapping[str, str]] = {}
    twins: ClassVar[tuple[str, ...]] = ()
    defining: ClassVar[tuple[str, ...]] = ()
    typical: ClassVar[Typical] = Typical()
    doubt: ClassVar[Doubt] = Doubt()
    partner: ClassVar[str] = ""
    of_the_log: ClassVar[bool] = False
    open_law: ClassVar[bool] = False
    left_open: ClassVar[str] = ""
    formats: ClassVar[Mapping[str, Expression]] = {}
    law: ClassVar[Callable[[Any, int, dict[str, float]], Array] | None] = None
    incomparable: ClassVar[frozenset[str]] = frozenset()
    opposite: ClassVar[frozenset[str]] = frozenset()

    def screened(self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]) -> Effect:
        """The effect after a first look at what the tuned model leaves; events learn there when they may have been.

        Args:
            session: All runs.
            leftover: For each run what the model leaves of the torque, filtered and decimated; zero where that
                doesn't count [N m].
        """
        return self

    def asked(self, session: SessionContext) -> SessionContext:
        """The runs that its figures are taken from: all of them, or enough of very many."""
        return session if self.remembers else session.survey

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        """Why these recordings can't show the effect at a joint at all, or None. Must be cheap."""
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        """The inner grid at a joint (`joint` is 0 for an effect of the whole arm)."""
        return (Variant(),)

    def essential(self, variant: Variant) -> tuple[int, ...]:
        """Columns without which it would be another effect: they must earn their own place; () if there are none."""
        return ()

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        """Whether a point of the inner grid is right about such coefficients: a law made linear there holds near it."""
        return True

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """A finer grid around a point of the inner grid that fits best; laws without inner figures have none."""
        return (variant,)

    @abstractmethod
    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        """Torque columns of every run [N m per unit of coefficient], (T, k) or (T, n, k) by `rows`.

        Whole sessions are asked for at once because some effects remember from run to run.
        """

    @abstractmethod
    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Float[Array, " k"],
        covariance: Float[Array, "k k"],
    ) -> dict[str, Interval]:
        """Physical figures of the catalogue from coefficients; 95 % intervals for a known variant."""

    def without_dry_friction(
        self, coefficients: Float[Array, " k"], variant: Variant
    ) -> tuple[Float[Array, " k"], float]:
        """Its coefficients without what is a joint's usual dry friction, and that friction [N m].

        Where columns can't be told from dry friction, the tuned joint has it, not the effect: it is there when the
        effect is gone.
        """
        return coefficients, 0.0

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"] | None:
        """Largest plausible size of each coefficient (two standard deviations of the prior), or None for flat."""
        return None

    def size_prior(self, session: SessionContext, joint: int, variant: Variant) -> SizePrior | None:
        """What is known of its coefficients beforehand; None where each costs what any free figure does.

        Needed of what is known well enough to tell a small one from the errors that a URDF has anyway.
        """
        return None

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """What reported figures can be on this arm, by name; figures that may be anything are left out."""
        return {}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        """What a person at the cell can do about it: one sentence without a full stop.

        Args:
            where: The joint's name, or those of the joints where an effect of the whole arm shows.
            figures: The reported figures.
        """
        told = ", ".join(f"{name} {figure.value:.3g}" for name, figure in figures.items())
        return f"add {self.id.replace('_', ' ')} of {where} to the model ({told}): `ident patch` writes it"

    def parts(self, variant: Variant) -> Sequence[tuple[Variant, Sequence[int]]]:
        """Further points of the grid that have some of the columns of this one, and which of them."""
        return ()

    def signed(self, variant: Variant) -> tuple[int, ...]:
        """Columns of a point of the inner grid whose coefficients can't be negative."""
        return self.nonnegative

    def tells_law(self, variant: Variant) -> bool:
        """Whether a diagnosis tells coefficients and shape of this point beside the reported figures."""
        return self.open_law

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """Figures that its law needs beside the reported ones.

        Args:
            reported: The reported figures.
            coefficients: Those of its columns, where a diagnosis tells them (`open_law`); else empty.
            shape: Shape and inner figures of the point of the grid that they belong to; else empty.
        """
        return {}

    def expressed(self, form: str, figures: Mapping[str, float]) -> Expression | None:
        """How a format (`urdf`, `mjcf`) expresses it with these figures; None where it is friction to the format."""
        return self.formats.get(form)

    def compared(self, true: Mapping[str, Any], starts: Sequence[float]) -> dict[str, float]:
        """Figures of a simulated arm's answer in this effect's terms, as far as they have a counterpart.

        Args:
            true: The answer's figures; names of joints among them have none.
            starts: Session time at which each run starts [s].
        """
        figures = {name: float(value) for name, value in true.items() if not isinstance(value, str)}
        kept = {name: value for name, value in figures.items() if name not in self.incomparable}
        return {name: -value if name in self.opposite else value for name, value in kept.items()}


def linear_interval(
    weights: Float[Array, " k"], coefficients: Float[Array, " k"], covariance: Float[Array, "k k"], shift: float = 0.0
) -> Interval:
    """Interval of a linear combination of coefficients."""
    value = float(weights @ coefficients) + shift
    reach = 1.96 * float(np.sqrt(max(weights @ covariance @ weights, 0.0)))
    return Interval(value, value - reach, value + reach)


# Draws behind an interval: its ends are then sure to a twentieth of its width.
INTERVAL_DRAWS = 400


def drawn_interval(
    function: Callable[[Float[Array, " k"]], float], coefficients: Float[Array, " k"], covariance: Float[Array, "k k"]
) -> Interval:
    """95 % interval of any function of coefficients that are not negative, from draws of them.

    For what bends within the coefficients' spread, where the delta method tells anything.
    """
    if not covariance.any():
        return Interval(*3 * (function(coefficients),))
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    # The same draws every time: a figure is told the same when it is told again.
    normal = np.random.default_rng(0).standard_normal((INTERVAL_DRAWS, len(coefficients)))
    drawn = coefficients + (normal * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    told = np.array([function(one) for one in np.maximum(drawn, 0.0)])
    value, (low, high) = function(coefficients), np.quantile(told, (0.025, 0.975))
    return Interval(value, min(value, float(low)), max(value, float(high)))


def delta_interval(
    function: Any, coefficients: Float[Array, " k"], covariance: Float[Array, "k k"], step: float = 1e-4
) -> Interval:
    """Interval of a smooth function of coefficients by the delta method, derivatives by central differences."""
    if not covariance.any():
        return Interval(*3 * (float(function(coefficients)),))
    size = np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0.0)), 1e-12) * step / 1e-2
    gradient = np.array(
        [
            (function(coefficients + size[i] * unit) - function(coefficients - size[i] * unit)) / (2 * size[i])
            for i, unit in enumerate(np.eye(len(coefficients)))
        ]
    )
    value = float(function(coefficients))
    reach = 1.96 * float(np.sqrt(max(gradient @ covariance @ gradient, 0.0)))
    return Interval(value, value - reach, value + reach)
