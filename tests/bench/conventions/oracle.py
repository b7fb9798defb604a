"""An oracle that knows two hypotheses: whether a log tells them apart, by blocks of time, and whether they are one.

It shares nothing with the search's cost but the rigid torque: friction, rotor and offset are free, and so is each
joint's size within a factor of two, as masses and gains are off. Of each block of time it takes the logarithm of how
much more the one leaves than the other, over the joints. Blocks are the independent observations: the mean over them
in its standard errors, z, is worth z² / 2 nats, and a change is seen in the log where that is more than the change's
description is long.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from ident.arrays import Array
from ident.checks.conventions.description import description_length
from ident.checks.conventions.hypothesis import Hypothesis
from ident.checks.conventions.masses import guessed_masses
from ident.checks.conventions.model import Model
from ident.checks.conventions.products import read_as
from ident.checks.conventions.readings import Log
from ident.checks.conventions.settings import DESCRIPTION

# Blocks of time that count as independent.
BLOCKS = 20
# Factor by which masses and gains may be off in the oracle's eyes.
FREE_SIZE = 2.0
# By how much more must be left for two hypotheses not to be one [nats]; share of a variance below which nothing is.
SAME, FLOOR = 0.5, 1e-3
# How far off a factor of all masses may be.
FACTOR_OFF = 1.33


def residual(log: Log, model: Model, hypothesis: Hypothesis, free_size: float = 1.0) -> Array:
    """What a hypothesis leaves of each joint's torque, friction and rotor projected out, shape (n, T).

    Args:
        log: States.
        model: The URDF's torque.
        hypothesis: How both are read.
        free_size: Factor within which each joint's size is the best one.
    """
    reading = read_as(log, model, hypothesis)
    tau = reading.tau.copy()
    for joint, scale in hypothesis.effort_scale:
        tau[joint] /= scale
    rigid = reading.rigid
    if hypothesis.body is not None:
        rigid = rigid + reading.body @ np.array(hypothesis.body)
    size = (tau * rigid).sum(axis=1) / np.maximum((rigid**2).sum(axis=1), 1e-300)
    size = np.clip(size, 1.0 / free_size, free_size)
    return np.asarray(tau - size[:, None] * rigid)


def evidence(log: Log, model: Model, truth: Hypothesis, other: Hypothesis) -> float:
    """What the log says for the truth against another hypothesis [nats]; negative where it is against it."""
    lefts = [residual(log, model, each, FREE_SIZE) ** 2 for each in (other, truth)]
    # Each in the recorded torque's own unit.
    units = [np.ones(len(lefts[0])) for _ in lefts]
    for unit, each in zip(units, (other, truth), strict=True):
        for joint, scale in each.effort_scale:
            unit[joint] = scale**2
    lefts = [left * unit[:, None] for left, unit in zip(lefts, units, strict=True)]
    usual = lefts[1].mean(axis=1)[:, None] + 1e-12
    blocks = [
        np.stack([block.mean(axis=1) for block in np.array_split(left, BLOCKS, axis=1)], axis=1) for left in lefts
    ]
    more = np.log((blocks[0] + usual) / (blocks[1] + usual)).sum(axis=0)
    error = more.std(ddof=1) / np.sqrt(BLOCKS)
    z = float(more.mean() / max(float(error), 1e-12))
    return 0.5 * z * abs(z)


def is_visible(log: Log, model: Model, truth: Hypothesis) -> bool:
    """Whether the log says more for the changes, each and some together, than their description is long.

    Changes that undo one another are none: gravity upside down and all torques of the other sign.
    Nor are changes that other masses explain as well, where the URDF's are guesses.
    """
    whole = description_length(truth, model.usual_orders)
    guess = guessed_masses(log, model)
    if guess is not None:
        plain = description_length(guess.hypothesis, model.usual_orders)
        guessed = plain + guess.more * float(DESCRIPTION.observations)
        if evidence(log, model, truth, guess.hypothesis) < whole - guessed:
            return False
    names = truth.changes
    for count in range(1, len(names) + 1):
        for left_out in combinations(names, count):
            less = truth
            for name in left_out:
                less = without(less, name)
            told = evidence(log, model, truth, less)
            if told < whole - description_length(less, model.usual_orders):
                return False
    return True


def is_told_apart(log: Log, model: Model, truth: Hypothesis, guess: Hypothesis) -> bool:
    """Whether the log says more for the truth against a guess than its description is longer."""
    lengths = [description_length(each, model.usual_orders) for each in (truth, guess)]
    return evidence(log, model, truth, guess) > lengths[0] - lengths[1]


def without(truth: Hypothesis, name: str) -> Hypothesis:
    """The truth but for one of its changes."""
    plain = Hypothesis.as_it_is(len(truth.order))
    kind, _, joint = name.partition(" ")
    field = {"zero": "quarters"}.get(kind, kind)
    if kind == "order":
        joint_of = {column: j for j, column in enumerate(truth.order)}
        return replace(truth, order=plain.order, effort_order=tuple(joint_of[column] for column in truth.effort_order))
    if kind == "effort_order":
        return replace(truth, effort_order=truth.order)
    if kind == "effort_scale":
        return replace(truth, effort_scale=())
    if joint:
        return truth.with_entry(field, int(joint), getattr(plain, field)[int(joint)])
    return replace(truth, **{field: getattr(plain, field)})


def is_same(log: Log, model: Model, guess: Hypothesis, truth: Hypothesis, is_sound: bool) -> bool:
    """Whether two hypotheses say the same of the masses, where they are known, and mean the same torque beside."""
    if is_sound and not _same_masses(guess, truth):
        return False
    # A body turned with the last joint's zero is another body: then the torque is the same with the guess's own.
    own_links = replace(guess, parameters=truth.parameters)
    alike = replace(own_links, mass_factor=truth.mass_factor, effort_scale=truth.effort_scale, body=truth.body)
    guesses = [alike, replace(own_links, effort_scale=truth.effort_scale)] if is_sound else [alike]
    return alike == truth or min(more_left(log, model, each, truth) for each in guesses) < SAME


def _same_masses(guess: Hypothesis, truth: Hypothesis) -> bool:
    """Whether both have a factor of about the same size, the same joints in another unit, and a body or none."""
    has_factor = (guess.mass_factor == 1.0) == (truth.mass_factor == 1.0)
    near = abs(np.log(guess.mass_factor / truth.mass_factor)) < np.log(FACTOR_OFF)
    joints = [joint for joint, _ in guess.effort_scale] == [joint for joint, _ in truth.effort_scale]
    joints = joints and (guess.parameters is None) == (truth.parameters is None)
    if guess.body is None or truth.body is None:
        return bool(has_factor and near and joints and guess.body == truth.body)
    return bool(has_factor and near and joints)


def more_left(log: Log, model: Model, guess: Hypothesis, truth: Hypothesis) -> float:
    """By how much more of the torque a guess leaves than the truth, all joints together [nats]."""
    left = [(residual(log, model, each) ** 2).mean(axis=1) for each in (guess, truth)]
    floor = FLOOR * log.tau.var(axis=0)[list(truth.effort_order)] + 1e-12
    return float(np.log((left[0] + floor) / (left[1] + floor)).sum())
