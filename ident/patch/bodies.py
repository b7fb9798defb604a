"""The links of a patched arm: the URDF's, tuned, and changed by the named effects; each a body that can exist.

A simulator integrates what identification only solves for: a link whose inertia no body has makes motion unstable or is
refused. Such a change is written as far as it leaves a body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arm import ArmModel
from ident.arrays import Array, Float, freeze
from ident.patch.change import Change, Diagnosed
from ident.patch.standalone.chain import link_change

# Shares of a change that are tried.
SHARES = np.linspace(1.0, 0.0, 21)
# A link that the URDF itself leaves without extent is not held to having one.
LEAST_EIGENVALUE = -1e-12


@dataclass(frozen=True, eq=False)
class Links:
    """Change of each link against the URDF.

    Attributes:
        tuned: By tuning, shape (n, 10).
        named: By named link errors, shape (n, 10).
        shares: Share of each link's tuning and of its named error that could be written, shape (n, 2).
    """

    tuned: Float[Array, "n 10"]
    named: Float[Array, "n 10"]
    shares: Float[Array, "n 2"]

    @property
    def total(self) -> Float[Array, "n 10"]:
        """Both changes."""
        return self.tuned + self.named


def pseudo_inertia(link: Float[Array, " 10"]) -> Float[Array, "4 4"]:
    """Positive semidefinite for every body that can exist.

    Source: Wensing, Kim and Slotine 2018, eq. 12.
    """
    mass, x, y, z, xx, xy, yy, xz, yz, zz = link
    half = 0.5 * (xx + yy + zz)
    return np.array([[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z], [x, y, z, mass]])


def is_body(link: Float[Array, " 10"]) -> bool:
    """Whether ten inertial numbers are those of a body."""
    return bool(link[0] > 0.0 and np.linalg.eigvalsh(pseudo_inertia(link))[0] >= LEAST_EIGENVALUE)


def largest_share(link: Float[Array, " 10"], change: Float[Array, " 10"]) -> float:
    """The largest share of a change that leaves a body; all of it where the link was none before."""
    if not is_body(link):
        return 1.0
    return float(next(share for share in SHARES if is_body(link + share * change)))


def change_links(arm: ArmModel, tuning: Float[Array, "n 10"], changes: Sequence[Change]) -> Links:
    """What becomes of the links.

    Args:
        arm: The arm as its URDF describes it.
        tuning: Change by tuning.
        changes: Named effects; link errors among them count.
    """
    nominal = arm.inertial_parameters.reshape(arm.n, 10)
    tuned, named, shares = np.array(tuning), np.zeros((arm.n, 10)), np.ones((arm.n, 2))
    for j in range(arm.n):
        shares[j, 0] = largest_share(nominal[j], tuned[j])
        tuned[j] *= shares[j, 0]
    for change in changes:
        if change.effect == "link_inertial_error":
            j = change.joint
            wanted = link_change(nominal[j] + tuned[j], change.values)
            shares[j, 1] = largest_share(nominal[j] + tuned[j] + named[j], wanted)
            named[j] += shares[j, 1] * wanted
    return Links(freeze(tuned), freeze(named), freeze(shares))


def tuned_arm(arm: ArmModel, diagnosed: Diagnosed) -> tuple[ArmModel, Links]:
    """The arm with tuned links, without named effects; and what the links become with them."""
    links = change_links(arm, diagnosed.tuned.links, diagnosed.changes)
    return arm.with_inertial_parameters(arm.inertial_parameters + links.tuned.ravel()), links
