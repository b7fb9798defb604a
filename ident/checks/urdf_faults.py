"""Bodies of a URDF that none can be.

Inertias that are negative or impossible, links without a mass.

An inertia about the centre of mass has positive principal moments, and none is larger than the
other two together: simulators refuse any other. What such a URDF says of masses and centres may be
right all the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.checks.report import issue_of
from ident.checks.settings import ARRANGEMENT as LIMIT
from ident.recordings.recording import Session, Severity, TelemetryIssue
from ident.robot.arm import ArmModel


def check_bodies_of_urdf(session: Session, arm: ArmModel) -> list[TelemetryIssue]:
    """Names links whose inertia or mass no body can have; empty without any."""
    masses, _, inertias = arm.chain[-3:]
    links = np.array(arm.links)
    joints = np.array(arm.joint_names)
    moments = np.linalg.eigvalsh(inertias)
    issues = []
    impossible = is_impossible(moments) & (masses > 0.0)
    if impossible.any():
        worst = moments[impossible][0]
        seen: dict[str, Any] = {
            "links": ", ".join(links[impossible]),
            "moments": ", ".join(f"{value:.3g}" for value in worst),
        }
        severity: Severity = "warning" if is_negative(moments).any() else "note"
        named = joints[impossible].tolist()
        issues.append(issue_of("impossible_inertia", session, named, severity=severity, **seen))
    bare = masses <= 0.0
    if bare.any():
        seen = {"links": ", ".join(links[bare]), "weight": float(masses.sum())}
        issues.append(issue_of("massless_links", session, joints[bare].tolist(), **seen))
    return issues


def is_impossible(moments: Float[Array, "n 3"]) -> Array:
    """Which principal moments, in rising order, no body has.

    Rounding of URDFs' few digits is allowed for.
    """
    of_others = moments[:, 0] + moments[:, 1]
    uneven = moments[:, 2] > of_others + rounding(moments)
    return np.asarray(is_negative(moments) | uneven)


def is_negative(moments: Float[Array, "n 3"]) -> Array:
    """Which principal moments, in rising order, are negative beyond rounding."""
    return np.asarray(moments[:, 0] < -rounding(moments))


def rounding(moments: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """By how much a URDF's few digits may have each link's moments off [kg m²]."""
    return np.asarray(LIMIT.inertia_rounding * np.maximum(np.abs(moments).max(axis=1), 1e-12))
