"""A C++ header with the identified arm's feed-forward torque: no library, no memory from the heap, one call a cycle."""

from __future__ import annotations

import re

import numpy as np

from ident.arrays import Array
from ident.export.identified import IdentifiedArm
from ident.export.python import describe_arm
from ident.export.templates import fill


def write_cpp(identified: IdentifiedArm) -> str:
    """The header's text: Newton and Euler's recursion in the joints' own frames, as in `ident.laws.motion`.

    Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3.
    """
    arm, losses = identified.whole, identified.losses
    chain, space = describe_arm(arm), "arm_" + re.sub(r"\W", "_", arm.name, flags=re.ASCII)
    rows = []
    for j in range(arm.n):
        mass, first, six = chain.links[j][0], chain.links[j][1:4], chain.links[j][4:]
        inertia = six[[0, 1, 3, 1, 2, 4, 3, 4, 5]]
        parts = [
            f"{{{{{_row(chain.rotations[j].ravel())}}}}}",
            *(f"{{{_row(vector)}}}" for vector in (chain.offsets[j], chain.axes[j])),
            "true" if chain.sliding[j] else "false",
            _row([mass]),
            f"{{{_row(first)}}}",
            f"{{{{{_row(inertia)}}}}}",
            _row([losses.motor_inertia[j], losses.viscous[j], losses.coulomb[j], losses.transition[j]]),
        ]
        rows.append("      {" + ", ".join(parts) + "},")
    names = ", ".join(_text(name) for name in arm.joint_names)
    marks = {
        "NAME": re.sub(r"[^\w .-]", "?", arm.name, flags=re.ASCII),
        "SPACE": space,
        "N": str(arm.n),
        "LINKS": "\n".join(rows),
        "JOINTS": names,
        "UP": _row(-chain.gravity),
    }
    return fill("torque_model.hpp", marks)


def _row(values: Array | list[float]) -> str:
    return ", ".join(repr(float(value)) for value in np.asarray(values))


def _text(name: str) -> str:
    """A string literal of any name: what is not plain becomes octal bytes."""
    kept = (
        chr(byte) if (chr(byte).isascii() and chr(byte).isalnum()) or chr(byte) in "_-./ " else f"\\{byte:03o}"
        for byte in name.encode()
    )
    return '"' + "".join(kept) + '"'
