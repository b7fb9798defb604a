"""The most that anybody can name: an oracle that knows the world, its noise, and what every cause does to the torque.

The arm runs with each cause of the catalogue at the true joint, at its typical size; what is left of the change of
torque after the best ordinary model is that cause's signature. Torque noise and encoder noise, with their spectra,
and friction that changes from run to run, with its variance, are the noise. Which signature is there, at a size that
nobody knows, is then a question to a linear Gaussian model, whose answer needs the signatures' products alone: noise
is drawn, the most probable cause named, and the share of true names counted.

It is a bound, not a competitor: it knows the true cause's inner parameters, takes noise as that of an unloaded joint,
and needs no smoothing.

Source: Eriksson, Frisk and Krysander 2013 (distinguishability of faults as the Kullback-Leibler divergence).
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.simulation.causes import CATALOGUE, Circumstances
from ident.simulation.simulate import Simulation
from ident.simulation.visibility import STRIDE_S
from ident.simulation.world import noise_density

# Sizes that are thought possible, in visible noise floors, evenly in the logarithm.
SIZES = np.geomspace(0.1, 10.0, 25)
DRAWS = 400
# Causes that show less than this at their typical size are no rivals [noise floors].
LEAST_SHOWN = 0.02


def oracle_accuracy(simulation: Simulation, seed: int = 0) -> float | None:
    """Probability that an oracle names the effect of a case with one effect in a world; None where it is not worked
    out. The seed is that of the drawn noise.
    """
    meter, truth, world = simulation.meter, simulation.answer.effects, simulation.options.world
    if world is None or meter is None or len(truth) != 1 or truth[0].effect not in CATALOGUE:
        return None
    true = CATALOGUE[truth[0].effect]
    names = meter.hardware.arm.joint_names
    joint = names.index(truth[0].joints[0]) if truth[0].joints else len(names) - 1
    scene = Circumstances(meter.hardware, joint, meter.motions, np.random.default_rng(0))
    first = meter.show(true, scene, truth[0].size, simulation.seeds[0], true.view, true.needs_all)
    # The true signature at its size, the others at one noise floor.
    floor, signatures = np.array(list(simulation.answer.noise_floor_Nm.values())), [first.torque]
    for cause in CATALOGUE.values():
        if cause.id == true.id or (cause.needs_all and not true.needs_all):
            continue
        try:
            size = float(np.clip(cause.typical(scene), *cause.bounds(scene)))
            shown = meter.show(cause, scene, size, seed, true.view, true.needs_all)
        except InputError:  # the arm can't move with it: it is not what happened
            continue
        level = float((shown.rms / floor).max())
        if level > LEAST_SHOWN:
            signatures.append(shown.torque / level)
    stack = np.stack(signatures, axis=2)
    gram = np.zeros((stack.shape[2], stack.shape[2]))
    for number in np.unique(first.run):
        rows = first.run == number
        for j in range(stack.shape[1]):
            gram += _whitened(stack[rows, j], first.speed[rows, j], simulation, j)
    gram /= first.share
    return name_by_evidence(gram, np.random.default_rng([seed, 7])) if gram[0, 0] > 0.0 else 0.0


def _whitened(
    torque: Float[Array, "T K"], speed: Float[Array, " T"], simulation: Simulation, j: int
) -> Float[Array, "K K"]:
    """Products of one run and joint; what the run's own friction may explain is taken out as far as it varies."""
    world, hardware = simulation.options.world, simulation.hardware
    assert world is not None
    count = len(torque)
    frequencies = np.fft.rfftfreq(count, STRIDE_S)
    variance = noise_density(hardware, world, frequencies)[:, j] * 0.5 / STRIDE_S
    weight = np.where((frequencies == 0.0) | (2 * np.arange(len(frequencies)) == count), 1.0, 2.0)
    scale = np.sqrt(weight / variance / count)[:, None]
    change = np.hypot(world.friction_spread, world.friction_drift / np.sqrt(2.0))
    own = np.column_stack([np.sign(speed) * hardware.friction.coulomb[j], speed * hardware.friction.viscous[j]])
    spectra = np.fft.rfft(np.column_stack([torque, change * own]), axis=0) * scale
    both = (spectra.conj().T @ spectra).real
    k = torque.shape[1]
    cross, inner = both[:k, k:], both[k:, k:] + np.eye(2)
    return np.asarray(both[:k, :k] - cross @ np.linalg.solve(inner, cross.T))


def name_by_evidence(gram: Float[Array, "K K"], rng: np.random.Generator) -> float:
    """Share of true names over drawn noise; the first signature is the true one, at its true size.

    A cause at b times its signature has the log-likelihood b y - b² G / 2 above that of none, y the product of the
    data with the signature.
    """
    k = len(gram)
    root = np.linalg.cholesky(gram + 1e-9 * np.trace(gram) / k * np.eye(k) + 1e-12 * np.eye(k))
    data = gram[0] + rng.standard_normal((DRAWS, k)) @ root.T
    # Of each signature sizes from the same span of what can be seen: the true one is as large as it is.
    sizes = np.concatenate([-SIZES[::-1], SIZES])
    log_likelihood = data[:, :, None] * sizes - 0.5 * sizes**2 * np.diag(gram)[:, None]
    evidence = np.logaddexp.reduce(log_likelihood, axis=2) - np.log(len(sizes))
    # Before the data, none is as probable as all causes together: what does not show is not named.
    return float(np.mean((evidence.argmax(axis=1) == 0) & (evidence.max(axis=1) > np.log(k))))
