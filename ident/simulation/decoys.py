"""Decoys: differences from the data sheet that are no effect of the catalogue and must not be named as one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ident.errors import InputError
from ident.simulation.friction import scale_friction
from ident.simulation.hardware import Hardware


def _inertia(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """Masses and inertias of all links off by up to ten per cent, up or down alike."""
    n, bodies = hardware.n, hardware.bodies
    scales = 1.0 + rng.uniform(-0.1, 0.1, (2, n))
    mass, inertia = bodies.mass_scale * scales[0], bodies.inertia_scale * scales[1]
    return hardware.replace(bodies=bodies.replace(mass_scale=mass, inertia_scale=inertia))


def _geometry(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """Joint frames up to a millimetre from where the URDF puts them."""
    shift = hardware.bodies.geometry_shift + rng.uniform(-1e-3, 1e-3, (hardware.n, 3))
    return hardware.replace(bodies=hardware.bodies.replace(geometry_shift=shift))


def _friction(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """Friction half or twice of what an arm of this size has: start values from a data sheet are wrong."""
    factor = np.exp(rng.uniform(-np.log(2.0), np.log(2.0), (2, hardware.n)))
    return hardware.replace(friction=scale_friction(hardware.friction, *factor))


def _controller(hardware: Hardware, rng: np.random.Generator) -> Hardware:
    """A controller of half to one and a half times the bandwidth, with another damping."""
    return hardware.replace(
        bandwidth=hardware.bandwidth * float(rng.uniform(0.5, 1.5)),
        damping_ratio=float(rng.uniform(0.6, 1.1)),
    )


DECOYS: dict[str, Callable[[Hardware, np.random.Generator], Hardware]] = {
    "inertia": _inertia,
    "geometry": _geometry,
    "friction": _friction,
    "controller": _controller,
}


def add_decoy(hardware: Hardware, name: str, rng: np.random.Generator) -> Hardware:
    """The hardware with a decoy.

    Raises:
        InputError: No such decoy.
    """
    if name not in DECOYS:
        raise InputError("--decoy", f"unknown decoy {name!r}", f"choose from: {', '.join(DECOYS)}")
    return DECOYS[name](hardware, rng)
