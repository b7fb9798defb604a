"""Bodies on links, and masses that are not where the URDF has them: numbers that decide."""

from __future__ import annotations

from dataclasses import dataclass

from ident.records import Numbers, number


@dataclass(frozen=True)
class AddedBodySettings(Numbers):
    """Bodies on links."""

    least_mass_share: float = number(
        0.0001,
        "1",
        "mass over the arm's below which a body is none",
        "chosen: its place can't be determined",
    )
    least_column: float = number(
        1e-06,
        "1",
        "a column whose torque is less than this share of its link's largest acts on nothing",
        "chosen: rounding",
    )
    structure_states: int = number(
        30,
        "1",
        "states by which what acts is judged",
        "chosen: more tell the same",
    )
    place_steps: int = number(
        4,
        "1",
        "steps of Gauss and Newton towards a body's place",
        "chosen: they have settled",
    )


@dataclass(frozen=True)
class RigidBodySettings(Numbers):
    """Masses that are not where the URDF has them."""

    payload_reaches: tuple[float, ...] = number(
        (0.03, 0.12),
        "m",
        "distances of the load from the last joint's frame, along its axis, about which its "
        "inertia is linearised",
        "chosen: a gripper and a tool",
    )
    largest_payload_share: float = number(
        0.5,
        "1",
        "largest load over the arm's moving mass",
        "chosen: makers rate arms by a sixth to a half",
    )
    least_payload_share: float = number(
        0.003,
        "1",
        "least load over it",
        "chosen: lighter ones matter little",
    )
    largest_lever_share: float = number(
        0.27,
        "1",
        "distance of a load's centre from the flange over the arm's reach",
        "chosen: as makers rate arms",
    )
    largest_inertia_share: float = number(
        0.4,
        "1",
        "share of a link's mass that a URDF may be off",
        "chosen: as the catalogue draws it",
    )
    least_link_share: float = number(
        0.005,
        "1",
        "links lighter than this share of the arm's mass have no scale of their own",
        "chosen: a flange",
    )
    least_link_length: float = number(
        0.09,
        "1",
        "and those shorter than this share of its reach",
        "chosen: a flange",
    )
    widest: float = number(
        2.0,
        "1",
        "deviation of a link's change in units of that, where the recordings do not determine it",
        "chosen: most of the link itself",
    )


ADDED_BODY = AddedBodySettings()
RIGID_BODY = RigidBodySettings()
