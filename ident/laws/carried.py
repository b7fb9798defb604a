"""The table of what is known of each effect beside its law, and the laws of one joint's states that
it tells of.

Laws of one joint's states that a diagnosis can name and a model can carry, fitted and kept.

The effects of the same names are made of the same columns, so that what was named and what is
fitted is one law.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ident.arrays import Array, Float
from ident.laws.friction_laws import JointStates
from ident.laws.motion import direction
from ident.units import TORQUE

# Torque of a joint for coefficients of one, by its states and what bends the law [N m].
Columns = Callable[[JointStates, Mapping[str, float]], list[Any]]

TABLE: Mapping[str, Any] = tomllib.loads(
    (Path(__file__).parents[1] / "effects/effects.toml").read_text(encoding="utf-8")
)
Shape = Mapping[str, float]
# Largest exponent of a law that is believed: no friction bends more, and a file may hold anything.
LARGEST_EXPONENT = 10.0
# A coefficient below this share of its interval's width lies on its bound, as far as a solver goes.
ZERO_SHARE = 1e-3
# Parameters that bend no law: how many columns it has, and their scale.
SCALING = ("terms", "load_Nm")


class LawKind(NamedTuple):
    """What is known of a law: its row of the table, see `effects.toml`."""

    columns: Columns
    words: str
    shape: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    usual: Shape = {}  # noqa: RUF012 (read alone)
    units: tuple[str, ...] = (TORQUE,)
    labels: tuple[str, ...] = ()  # what each coefficient is
    nonnegative: tuple[int, ...] = ()
    bears_load: bool = False


# Rows that have `states` name the file of this package in which the function of the effect's name
# is its law.
KINDS: dict[str, LawKind] = {}
for _effect, _row in TABLE["effects"].items():
    if "states" in _row:
        _fields: dict[str, Any] = dict(_row["states"])
        _columns = getattr(import_module(f"ident.laws.{_fields.pop('file')}"), _effect)
        for _name, _value in _fields.items():
            if isinstance(_value, list):
                _fields[_name] = tuple(_value)
        _nonnegative = tuple(_row.get("nonnegative", ()))
        KINDS[_effect] = LawKind(_columns, nonnegative=_nonnegative, **_fields)
COLUMNS: Mapping[str, Columns] = {effect: kind.columns for effect, kind in KINDS.items()}


@dataclass(frozen=True)
class NamedLaw:
    """A law at a joint."""

    effect: str  # its name, one of `KINDS`
    joint: int  # the joint's number, from zero
    shape: Shape = field(default_factory=dict)  # parameters that it is bent by
    # Coefficients as (value, low, high) of their 95 % intervals; empty before it is fitted.
    figures: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        kind = KINDS.get(self.effect)
        if kind is None:
            raise ValueError(f"{self.effect!r} is no law of a joint that a model carries")
        names = (*kind.shape, *(name for name in kind.optional if self.shape.get(name)))
        values = {name: float(self.shape[name]) for name in names}
        for name, value in values.items():
            if not 0.0 < value < np.inf or (name == "exponent" and value > LARGEST_EXPONENT):
                raise ValueError(f"{name} of {self.effect} is {value:g}")
        if values.get("terms", 2.0) not in (2.0, 4.0):
            raise ValueError(f"{self.effect} has {values['terms']:g} terms")
        object.__setattr__(self, "shape", values)
        has_size = len(self.figures) == self.size
        if self.figures and not (has_size and np.isfinite(self.figures).all()):
            raise ValueError(f"{self.effect} has figures {self.figures}")

    @property
    def kind(self) -> LawKind:
        """The law's row of the table.

        Raises:
            KeyError: The table has no such law.
        """
        return KINDS[self.effect]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        zero = np.zeros(1)
        return len(self.kind.columns(JointStates(zero, zero, zero, zero), self.shape))

    @property
    def bears_load(self) -> bool:
        """Whether it depends on the load of the gear."""
        return self.kind.bears_load

    @property
    def vanishes(self) -> bool:
        """Whether all of it came out as zero, which is the bound of what can't be negative."""
        return all(abs(value) <= ZERO_SHARE * (high - low) for value, low, high in self.figures)

    def columns(self, states: JointStates) -> Float[Array, "T k"]:
        """Its torque for each coefficient of one, the others zero, side by side [N m]."""
        return evaluate(self.kind.columns, states, self.shape)

    def torque(self, states: JointStates) -> Float[Array, " T"]:
        """Its torque with its coefficients, at T states of its joint [N m]."""
        coefficients = np.array([value for value, _, _ in self.figures])
        return np.asarray(self.columns(states) @ coefficients)

    def to_dict(self) -> dict[str, Any]:
        """Its record for model.toml.

        Returns:
            `effect` (id), `joint` (index from 0), `shape` (values by name) and `coefficients`, each
            a list of value, low and high.
        """
        return {
            "effect": self.effect,
            "joint": self.joint,
            "shape": dict(self.shape),
            "coefficients": [list(figure) for figure in self.figures],
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any], joints: int) -> NamedLaw:
        """Reads a law from its record (`to_dict`).

        Args:
            record: The record.
            joints: Number of the arm's joints.

        Raises:
            KeyError, TypeError, ValueError: It is damaged.
        """
        joint = record["joint"]
        if not isinstance(joint, int) or not 0 <= joint < joints:
            raise ValueError(f"{record['effect']} is of joint {joint!r}, which the arm has not")
        figures = []
        for value, low, high in record["coefficients"]:
            figures.append((float(value), float(low), float(high)))
        if not figures:
            raise ValueError(f"{record['effect']} has no coefficients")
        return cls(str(record["effect"]), joint, dict(record["shape"]), tuple(figures))

    def describe(self, joints: Sequence[str]) -> str:
        """The law in words: joint, what it is, shape, and coefficients with 95 % intervals.

        Args:
            joints: Names of the joints.
        """
        reported = ", ".join(self._figure_in_words(k) for k in range(len(self.figures)))
        bending = {name: value for name, value in self.shape.items() if name not in SCALING}
        shape = ", ".join(f"{name} {value:.3g}" for name, value in bending.items())
        bent = f" ({shape})" if shape else ""
        return f"{joints[self.joint]}: {self.kind.words}{bent}: {reported}"

    def _figure_in_words(self, index: int) -> str:
        """One coefficient by its name, with unit and 95 % interval, which ends where it may."""
        value, low, high = self.figures[index]
        kind = self.kind
        unit = kind.units[min(index, len(kind.units) - 1)]
        label = f"{kind.labels[index]} " if index < len(kind.labels) else ""
        vanishing = ZERO_SHARE * (high - low)
        shown = 0.0 if abs(value) <= vanishing else value
        least = 0.0 if abs(low) <= vanishing else low
        least = max(least, 0.0) if index in kind.nonnegative else least
        return f"{label}{shown:.3g} {unit} [{least:.3g}, {high:.3g}]"


def states_of(
    joint: int,
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    load: Float[Array, "T n"],
    slip: Float[Array, "T n"],
) -> JointStates:
    """One joint's states, as laws of friction take them.

    Args:
        joint: Its index.
        q, dq: Positions and velocities of all joints [rad, rad/s].
        load: Torque that each gear transmits [N m].
        slip: Direction of sliding in [-1, 1].
    """
    return JointStates(
        q[:, joint],
        dq[:, joint],
        load[:, joint],
        slip[:, joint],
    )


def evaluate(columns: Columns, states: JointStates, shape: Shape) -> Float[Array, "T k"]:
    """A law's columns side by side: its torque for each coefficient of one [N m].

    Args:
        columns: The law.
        states: One joint's T states.
        shape: Its numbers that are no coefficients, by name.
    """
    return np.stack(columns(states, shape), axis=1)


def named_torque(
    laws: Sequence[NamedLaw],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    load: Float[Array, "T n"],
    transition_speed: Float[Array, " n"],
) -> Float[Array, "T n"]:
    """Torque of all laws together, joint by joint [N m].

    Args:
        laws: The laws.
        q, dq: Positions and velocities [rad, rad/s].
        load: Torque that each gear transmits [N m].
        transition_speed: Speed over which each joint's friction changes its sign; a plain sign
            where it is 0 [rad/s].
    """
    out = np.zeros(dq.shape)
    slip = direction(dq, transition_speed)
    for law in laws:
        states = states_of(law.joint, q, dq, load, slip)
        out[:, law.joint] += law.torque(states)
    return out


def named_columns(
    laws: Sequence[NamedLaw],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    load: Float[Array, "T n"],
) -> Float[Array, "T n s"]:
    """Columns of all laws side by side, each at its own joint and zero at the others [N m].

    The direction of sliding is the plain sign of the speed, as in the losses' own columns.

    Args:
        laws: The laws; s is the sum of their coefficients.
        q, dq: Positions and velocities [rad, rad/s].
        load: Torque that each gear transmits [N m].
    """
    out = np.zeros((*dq.shape, sum(law.size for law in laws)))
    first = 0
    slip = np.sign(dq)
    for law in laws:
        states = states_of(law.joint, q, dq, load, slip)
        last = first + law.size
        out[:, law.joint, first:last] = law.columns(states)
        first = last
    return out
