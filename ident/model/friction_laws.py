"""Laws of one joint that a diagnosis can name and a model can carry: friction beyond Coulomb's and viscous friction.

Each law is linear in its coefficients; what it is bent by (a speed, an exponent, an order) is its shape. The effects of
the same names are made of these columns, so that what was named and what is fitted is one law.

Source: Bittencourt and Gunnarsson 2010 (Stribeck); Carreau 1972 (a lubricant whose viscosity falls with its shear
beyond a knee); Hamon, Gautier and Garrec 2010 (load).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.model.loss import direction

Shape = Mapping[str, float]
# Largest exponent of a law that is believed: no friction bends more, and a file may hold anything.
LARGEST_EXPONENT = 10.0
# A coefficient below this share of its interval's width lies on its bound, as far as a solver goes.
ZERO_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class JointStates:
    """One joint's states at T times, as laws of friction see them.

    Attributes:
        q, dq: Position [rad] and speed [rad/s].
        load: Torque that the joint transmits: rigid torque, without rotor and friction [N m].
        slip: Direction of sliding in [-1, 1].
    """

    q: Float[Array, " T"]
    dq: Float[Array, " T"]
    load: Float[Array, " T"]
    slip: Float[Array, " T"]


def stribeck(at: JointStates, shape: Shape) -> Float[Array, "T 1"]:
    """s exp(−(|v| / v_s)^δ)."""
    speed, exponent = shape["stribeck_velocity_rad_s"], shape["exponent"]
    return (at.slip * np.exp(-((np.abs(at.dq) / speed) ** exponent)))[:, None]


def curved_viscous(at: JointStates, shape: Shape) -> Float[Array, "T 1"]:
    """s |v|^α; with a knee v_k straight below it, s |v| (v² + v_k²)^((α − 1) / 2)."""
    return (at.slip * bent(np.abs(at.dq), shape["exponent"], shape.get("knee_rad_s", 0.0)))[:, None]


def bent(speed: Float[Array, " ..."], exponent: float, knee: float = 0.0) -> Float[Array, " ..."]:
    """A power of speeds, none of them negative; straight below a knee, where there is one."""
    return np.asarray(speed * np.hypot(speed, knee) ** (exponent - 1.0) if knee else speed**exponent)


def by_load(at: JointStates, shape: Shape) -> Float[Array, "T k"]:
    """Driving and half of backdriving, the reverse; with four terms s τ_l² over a typical load and v |τ_l| too."""
    both, gain = at.slip * np.abs(at.load), at.slip**2 * at.load
    driving, backdriving = (both + gain) / 2, (both - gain) / 2
    columns = [driving + backdriving / 2, backdriving + driving / 2]
    if shape["terms"] == 4:
        columns += [at.slip * at.load**2 / shape["load_Nm"], at.dq * np.abs(at.load)]
    return np.stack(columns, axis=1)


def by_position(at: JointStates, shape: Shape) -> Float[Array, "T 2"]:
    """s cos kq, s sin kq."""
    angle = shape["order"] * at.q
    return at.slip[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def asymmetric(at: JointStates, shape: Shape) -> Float[Array, "T 2"]:
    """s² / 2, |v| / 2."""
    return 0.5 * np.stack([at.slip**2, np.abs(at.dq)], axis=1)


@dataclass(frozen=True)
class LawKind:
    """What is known of a law.

    Attributes:
        columns: Torque for coefficients of one.
        shape: Figures that it is bent by; all above zero.
        optional: Further ones that it may have.
        nonnegative: Coefficients that can't be negative.
        words: What it is called beside a joint's name.
        units: Of its coefficients, one after the other; the last one stands for those that follow.
    """

    columns: Callable[[JointStates, Shape], Float[Array, "T k"]]
    shape: tuple[str, ...] = ()
    nonnegative: tuple[int, ...] = ()
    words: str = ""
    units: tuple[str, ...] = ("N m",)
    optional: tuple[str, ...] = ()


KINDS: Mapping[str, LawKind] = {
    "stribeck_friction": LawKind(
        stribeck, ("stribeck_velocity_rad_s", "exponent"), (0,), "friction that falls as motion sets in"
    ),
    "nonlinear_viscous_friction": LawKind(
        curved_viscous,
        ("exponent",),
        (0,),
        "friction that bends over speed",
        ("N m (s/rad)^exponent",),
        optional=("knee_rad_s",),
    ),
    "load_dependent_friction": LawKind(
        by_load, ("terms", "load_Nm"), (0, 1), "friction that grows with the load", ("1", "1", "1", "s/rad")
    ),
    "position_dependent_friction": LawKind(by_position, ("order",), (), "friction that varies with the angle"),
    "asymmetric_friction": LawKind(
        asymmetric, (), (), "friction that differs between the directions", ("N m", "N m s/rad")
    ),
}


@dataclass(frozen=True)
class NamedLaw:
    """A law at a joint.

    Attributes:
        effect: Its name, one of `KINDS`.
        joint: The joint's number, from zero.
        shape: Figures that it is bent by.
        figures: Coefficients as (value, low, high) of their 95 % intervals; empty before it is fitted.
    """

    effect: str
    joint: int
    shape: Shape = field(default_factory=dict)
    figures: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        kind = KINDS.get(self.effect)
        if kind is None:
            raise ValueError(f"{self.effect!r} is no law of a joint that a model carries")
        names = (*kind.shape, *(name for name in kind.optional if self.shape.get(name)))
        kept = {name: float(self.shape[name]) for name in names}
        for name, value in kept.items():
            if not 0.0 < value < np.inf or (name == "exponent" and value > LARGEST_EXPONENT):
                raise ValueError(f"{name} of {self.effect} is {value:g}")
        if kept.get("terms", 2.0) not in (2.0, 4.0):
            raise ValueError(f"{self.effect} has {kept['terms']:g} terms")
        object.__setattr__(self, "shape", kept)
        if self.figures and (len(self.figures) != self.size or not np.isfinite(self.figures).all()):
            raise ValueError(f"{self.effect} has figures {self.figures}")

    @property
    def kind(self) -> LawKind:
        return KINDS[self.effect]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        zero = np.zeros(1)
        return self.columns(JointStates(zero, zero, zero, zero)).shape[1]

    @property
    def bears_load(self) -> bool:
        """Whether it depends on the load."""
        return self.effect == "load_dependent_friction"

    @property
    def vanishes(self) -> bool:
        """Whether all of it came out as zero, which is the bound of what can't be negative."""
        return all(abs(value) <= ZERO_SHARE * (high - low) for value, low, high in self.figures)

    def columns(self, at: JointStates) -> Float[Array, "T k"]:
        """Its torque for coefficients of one [N m]."""
        return self.kind.columns(at, self.shape)

    def torque(self, at: JointStates) -> Float[Array, " T"]:
        """Its torque [N m]."""
        return np.asarray(self.columns(at) @ np.array([value for value, _, _ in self.figures]))

    def to_dict(self) -> dict[str, Any]:
        """For model.toml."""
        return {
            "effect": self.effect,
            "joint": self.joint,
            "shape": dict(self.shape),
            "coefficients": [list(one) for one in self.figures],
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any], joints: int) -> NamedLaw:
        """Reads it back.

        Raises:
            KeyError, TypeError, ValueError: It is damaged.
        """
        joint, triples = record["joint"], []
        if not isinstance(joint, int) or not 0 <= joint < joints:
            raise ValueError(f"{record['effect']} is of joint {joint!r}, which the arm has not")
        for value, low, high in record["coefficients"]:
            triples.append((float(value), float(low), float(high)))
        if not triples:
            raise ValueError(f"{record['effect']} has no coefficients")
        return cls(str(record["effect"]), joint, dict(record["shape"]), tuple(triples))

    def describe(self, joints: Sequence[str]) -> str:
        """In words, with coefficients and intervals."""
        units = self.kind.units
        told = ", ".join(
            f"{value:.3g} [{low:.3g}, {high:.3g}] {units[min(k, len(units) - 1)]}"
            for k, (value, low, high) in enumerate(self.figures)
        )
        shape = ", ".join(f"{name} {value:.3g}" for name, value in self.shape.items())
        return f"{joints[self.joint]}: {self.kind.words} ({self.effect}{', ' if shape else ''}{shape}): {told}"


def states_of(
    joint: int, q: Float[Array, "T n"], dq: Float[Array, "T n"], load: Float[Array, "T n"], slip: Float[Array, "T n"]
) -> JointStates:
    """One joint's states."""
    return JointStates(q[:, joint], dq[:, joint], load[:, joint], slip[:, joint])


def named_torque(
    laws: Sequence[NamedLaw],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    load: Float[Array, "T n"],
    transition_speed: Float[Array, " n"],
) -> Float[Array, "T n"]:
    """Torque of all laws [N m].

    Args:
        laws: Fitted laws.
        q, dq: States.
        load: Rigid torque [N m].
        transition_speed: Width of each joint's turn of dry friction [rad/s].
    """
    out = np.zeros(dq.shape)
    slip = direction(dq, transition_speed)
    for law in laws:
        out[:, law.joint] += law.torque(states_of(law.joint, q, dq, load, slip))
    return out


def named_columns(
    laws: Sequence[NamedLaw], q: Float[Array, "T n"], dq: Float[Array, "T n"], load: Float[Array, "T n"]
) -> Float[Array, "T n s"]:
    """Columns of all laws side by side, each at its own joint; the direction is a plain sign, as in the losses' own."""
    out = np.zeros((*dq.shape, sum(law.size for law in laws)))
    first, slip = 0, np.sign(dq)
    for law in laws:
        out[:, law.joint, first : first + law.size] = law.columns(states_of(law.joint, q, dq, load, slip))
        first += law.size
    return out
