"""Fits a hybrid model: inertias and losses, the laws that a diagnosis named, the net, and where all that is known."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import Array, Float
from ident.command_options import LUMPED, FitOptions
from ident.errors import InputError, RecordingError
from ident.fitting.choice import Choice, choose
from ident.fitting.coupling import EFFECT, NO_COUPLING, find_coupling, fit_coupling, read_coupling, without_carried
from ident.fitting.identification import Identified, identify
from ident.fitting.joint_estimate import FitSums, quantile
from ident.laws.carried import KINDS, NamedLaw, named_torque
from ident.model.carried import CarriedEffect
from ident.model.hybrid import HybridModel, TrainingRange
from ident.model.inertia import InertiaResults
from ident.model.loss import LossResults, loss_figures
from ident.motion.motion import Motion
from ident.motion.stretches import hold, runs_recorded
from ident.origin import UNITS, code_commit
from ident.progress import stage
from ident.results import Result
from ident.robot.arm import ArmModel
from ident.safe_read import read_record

if TYPE_CHECKING:
    from ident.model.residual_net import ResidualNet

FIT_SCHEMA = "ident.fit/1"
# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where the arm was.
TAILS = 0.001
# States at which the torque's interval is looked at, and the share of them that it holds for.
STATES, COVERED = 2000, 0.95
# Samples that a choice is made by; of a longer session stretches from all over it.
CHOSEN_SAMPLES = 200_000
DIAGNOSIS_SCHEMA = "ident.diagnosis/1"


@dataclass(frozen=True)
class NamedLaws:
    """What a diagnosis names."""

    laws: tuple[NamedLaw, ...] = ()  # laws of joints that a model can carry, not fitted yet
    left_out: tuple[str, ...] = ()  # what else it names, in words, with the reason
    carried: tuple[CarriedEffect, ...] = ()  # what is carried with the parameters that it was found with

    def within(self, joints: int) -> NamedLaws:
        """Those of the first joints; the others, which a lumped model has not, are reported as left out."""
        laws = tuple(law for law in self.laws if law.joint < joints)
        gone = [law for law in self.laws if law.joint >= joints]
        foreign = tuple(f"{law.effect}: the lumped model has no joint {law.joint + 1}" for law in gone)
        carried = tuple(effect for effect in self.carried if effect.joint < joints)
        return NamedLaws(laws, (*self.left_out, *foreign), carried)


def read_named_laws(path: Path, arm: ArmModel) -> NamedLaws:
    """Takes the laws of a diagnosis's JSON.

    Args:
        path: What `ident diagnose --json` wrote.
        arm: The arm that is to be fitted, with the joints of the model.

    Raises:
        InputError: Not a diagnosis, one of another robot, damaged, or one that names nothing.
    """
    record = read_record(path, DIAGNOSIS_SCHEMA, "give the JSON of `ident diagnose`")
    try:
        found = take_laws(record, arm, path)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        what = f"it is damaged ({type(error).__name__}: {error})"
        raise InputError(path, what, "write it anew with `ident diagnose … --json`") from None
    if not found.laws and not found.left_out:
        what = f"nothing to take: its verdict is {record.get('verdict')!r} and no effect is named"
        raise InputError(path, what, "fit without --with, or give a diagnosis with findings")
    return found


def take_laws(record: Mapping[str, Any], arm: ArmModel, path: Path) -> NamedLaws:
    """The laws of joints in a diagnosis's record, and what else it names.

    Args:
        record: As `ident diagnose --json` writes it.
        arm: The arm that is to be fitted.
        path: Where it is from, for messages.

    Raises:
        InputError: It is of another robot.
    """
    foreign = [name for name in record["joints"] if name not in arm.joint_names]
    if record["robot"] != arm.name or len(foreign) == len(record["joints"]):
        what = f"it is of the robot {record['robot']!r}, not of {arm.name!r}"
        raise InputError(path, what, "give a diagnosis of this robot")
    laws, left_out = [], []
    for finding in record["findings"]:
        effect, joint = finding["effect"], finding["joints"][0]
        if effect not in KINDS:
            left_out.append(f"{effect} of {joint}: a fitted model carries friction alone; `ident patch` writes this")
        elif joint in foreign:
            left_out.append(f"{effect} of {joint}: the model has no such joint")
        else:
            reported = {name: float(one["value"]) for name, one in finding["parameters"].items()}
            law = record.get("baseline", {}).get(joint, {}).get("laws", {}).get(effect, {"shape": {}})
            stated = {name: float(value) for name, value in law["shape"].items()}
            shape = {**KINDS[effect].usual, **reported, **stated}
            laws.append(NamedLaw(effect, arm.joint_names.index(joint), shape))
    return NamedLaws(tuple(laws), tuple(left_out))


def identify_named(
    sums: FitSums, left_out: tuple[str, ...], choice: Choice | None = None
) -> tuple[Identified, NamedLaws]:
    """Identifies an arm with named laws beside losses and inertias.

    A law that would have to be below zero, so that friction drives the joint, is left out and the rest is fitted again.

    Args:
        sums: One pass over the runs, with the laws.
        left_out: What else was named, in words, with the reason.
        choice: What runs left out chose, with the same laws; those that it took itself go without a word.

    Returns:
        What was identified, and the laws with those that had to go reported as left out.
    """
    names = sums.baseline.nominal.joint_names
    given = {(law.effect, law.joint) for law in (() if choice is None else choice.given_laws)}
    while True:
        found = identify(sums, choice)
        gone = sorted({(law.effect, law.joint) for law in found.named if law.vanishes})
        if not gone:
            return found, NamedLaws(found.named, left_out)
        asked = [one for one in gone if choice is None or one in given]
        left_out += tuple(f"{effect} of {names[joint]}: these recordings have none" for effect, joint in asked)
        choice = None if choice is None else choice.without(gone)
        sums = sums.only([law for law in sums.laws if (law.effect, law.joint) not in gone])


def find_training_range(motions: Sequence[Motion], nominal: ArmModel, found: Identified) -> TrainingRange:
    """The range of training runs, and how well the torque that was identified from them is known there.

    Args:
        motions: The runs.
        nominal: The arm whose base parameters were identified.
        found: What was identified.
    """
    parts = [np.stack([m.q[m.coarse], m.dq[m.coarse], m.ddq[m.coarse]]) for m in motions]
    states = np.concatenate(parts, axis=1)
    low, high = np.quantile(states, [TAILS, 1.0 - TAILS], axis=1)
    even = np.unique(np.linspace(0, states.shape[1] - 1, STATES).astype(int))
    estimate, params, kept = found.estimate, found.loss.params, np.arange(found.estimate.rank)
    variance = np.empty((len(even), nominal.n))  # of each joint's torque [N² m²]
    for rows in np.array_split(np.arange(len(even)), -(-len(even) // 1000)):
        q, dq, ddq = states[:, even[rows]]
        regressor = nominal.regressor(q, dq, ddq, found.inertia.base.columns)
        sign = np.tanh(dq / np.maximum(params.transition_speed, 1e-9))
        losses = np.stack([ddq, dq, sign, np.ones_like(dq)], axis=-1)[..., : estimate.per_joint]
        for j in range(nominal.n):
            index = np.concatenate([kept, estimate.index(j)])
            x = np.concatenate([regressor[:, j], losses[:, j]], axis=1)
            run = estimate.spread[j] * np.array([params.viscous[j], params.coulomb[j]])
            variance[rows, j] = np.sum((x @ estimate.covariance[np.ix_(index, index)]) * x, axis=1)
            variance[rows, j] += (run[0] * dq[:, j]) ** 2 + (run[1] * sign[:, j]) ** 2
    half = np.sqrt(np.quantile(variance, COVERED, axis=0))
    return TrainingRange(nominal.joint_names, low, high, half * float(np.median(quantile(found.estimate.dof))))


LIBRARIES = ("armgap", "numpy", "scipy", "torch", "pin")


def read_versions() -> dict[str, str]:
    """Version of each library, and of Python; `unknown` where one is not installed as a package."""
    there = {name: next(iter(importlib.metadata.distributions(name=name)), None) for name in LIBRARIES}
    found = {name: "unknown" if one is None else one.version for name, one in there.items()}
    return {"python": platform.python_version(), **found}


@dataclass(frozen=True, eq=False)
class FitResults(Result):
    """A fitted model and what stands behind it."""

    model: HybridModel
    identified: Identified
    choice: Choice  # what runs left out chose

    @property
    def loss(self) -> LossResults:
        return self.identified.loss

    @property
    def inertia(self) -> InertiaResults:
        return self.identified.inertia

    def to_dict(self) -> dict[str, Any]:
        """The model's record."""
        origin = {**self.model.provenance, **self.provenance.to_dict()}
        return {**self.model.record(), "schema": FIT_SCHEMA, "provenance": origin}


def fit_hybrid(
    motions: Sequence[Motion],
    robot: ArmModel,
    options: FitOptions | None = None,
    data: Sequence[dict[str, Any]] = (),
    progress: Callable[[int, int, float], None] | None = None,
    checkpoint: Path | None = None,
    named: NamedLaws | None = None,
) -> FitResults:
    """Fits analytic, loss, named laws and net, in that order.

    Args:
        motions: Training runs with the robot's joints.
        robot: The arm.
        options: What to fit.
        data: One record a training file (name, sha256), kept with the model.
        progress: Called after each joint, or epoch, of the net.
        checkpoint: Folder in which the net's training may stop and go on.
        named: Laws that a diagnosis named, if any.

    Source: paper, figure 2.
    """
    options = options or FitOptions()
    nominal = robot
    if options.links == LUMPED:
        from ident.robot.lumped import build_lumped_arm

        nominal = build_lumped_arm(robot)
        motions = [motion.select(nominal.joint_names) for motion in motions]
    stage("inertias and losses", 0.0, 0.5)
    named = (named or NamedLaws()).within(nominal.n)
    carried = named.carried
    motions = [without_carried(motion, nominal, carried) for motion in motions] if carried else motions
    coupled = coupling_of(motions, nominal, options, carried)
    motions = [without_carried(motion, nominal, coupled) for motion in motions] if coupled else motions
    carried += coupled
    choice, sums = choose_and_gather(motions, nominal, options, named.laws)
    found, named = identify_named(sums, named.left_out, choice)
    arm, loss = found.inertia.arm, found.loss
    kept = {(law.effect, law.joint) for law in found.named}
    choice = choice.without({(law.effect, law.joint) for law in choice.laws} - kept)
    plain = identify(sums.only(()), choice.without(kept)) if found.named else None

    def known(m: Motion, rigid: Float[Array, "T n"]) -> Float[Array, "T n"]:
        laws = named_torque(found.named, m.q, m.dq, rigid, loss.params.transition_speed)
        return loss.params.torque(m.dq, m.ddq) + laws

    net, memory = None, None
    if options.net != "none":
        stage("residual net", 0.5, 1.0)
        from ident.model.residual_net import PRESETS, fit_net_of_arm

        built = replace(PRESETS[options.net], seed=options.seed)
        net = fit_net_of_arm(motions, arm, known, built, progress, checkpoint)
        if options.net == "default":
            from ident.model.memory import fit_memory_of_arm

            memory = fit_memory_of_arm(motions, arm, known, options.seed)
    model = HybridModel(
        robot=robot,
        nominal=nominal,
        arm=arm,
        loss=loss.params,
        net=net,
        memory=memory,
        links=options.links,
        inertia=choice.kind,
        figures=loss_figures(loss),
        named=found.named,
        carried=carried,
        alone=None if plain is None else (plain.inertia.arm, plain.loss.params),
        inertias=found.inertias,
        trained=find_training_range(motions, nominal, found),
        provenance={
            **_provenance(motions, options, data, found, net),
            "named_left_out": list(named.left_out),
            "choice": choice.to_dict(),
            "coupled_by_choice": [nominal.joint_names[effect.joint] for effect in coupled if options.coupling is None],
            "memory_gate": [gate.to_dict() for gate in memory.gate] if memory else [],
        },
    )
    return FitResults(model, found, choice)


def coupling_of(
    motions: Sequence[Motion], nominal: ArmModel, options: FitOptions, carried: Sequence[CarriedEffect]
) -> tuple[CarriedEffect, ...]:
    """What coupled joints do to each other: of the pair that is given, or of pairs that parts left out ask for.

    Args:
        motions: Training runs, without what is carried already.
        nominal: The arm as its URDF describes it.
        options: What is fitted.
        carried: What is carried already; where a coupling is among it, none is looked for.

    Raises:
        InputError: What is given is no pair of joints.
    """
    if options.coupling == NO_COUPLING:
        return ()
    if options.coupling is not None:
        return fit_coupling(motions, nominal, *read_coupling(options.coupling, nominal))
    known = any(effect.effect == EFFECT for effect in carried)
    if known or options.laws == "none":
        return ()
    return find_coupling(motions, nominal)


def choose_and_gather(
    motions: Sequence[Motion], nominal: ArmModel, options: FitOptions, given: Sequence[NamedLaw]
) -> tuple[Choice, FitSums]:
    """What runs left out choose, and one pass over all runs with it.

    Args:
        motions: Training runs.
        nominal: The arm as its URDF describes it.
        options: What is fitted.
        given: Laws that a diagnosis named.

    Raises:
        RecordingError: A joint hardly moves, or given laws can't be told from plain friction.
    """
    tried = options.laws != "none"
    held = hold(motions, CHOSEN_SAMPLES).motions
    choice = choose(held, nominal, options.inertia, options.offset, given, tried)
    settled = replace(options, inertia=choice.kind, offset="on" if choice.offset else "off")
    try:
        sums = FitSums.gather(motions, nominal, settled, choice.laws, choice.widths)
    except RecordingError:
        own = {(law.effect, law.joint) for law in choice.laws} - {(law.effect, law.joint) for law in given}
        if not own:
            raise
        choice = choice.without(own)
        sums = FitSums.gather(motions, nominal, settled, choice.laws, choice.widths)
    return replace(choice, whitened=options.robust), sums


def _provenance(
    motions: Sequence[Motion],
    options: FitOptions,
    data: Sequence[dict[str, Any]],
    found: Identified,
    net: ResidualNet | None,
) -> dict[str, Any]:
    given = {**vars(options), "accept": list(options.accept)}  # TOML knows no null
    return {
        "options": {name: value for name, value in given.items() if value is not None},
        "runs": runs_recorded(motions),
        "samples": sum(len(motion.time) for motion in motions),
        "cutoff_hz": motions[0].lowpass.cutoff,
        **found.record(),
        "net_parameters": net.parameters if net else 0,
        "net_gate": [gate.to_dict() for gate in net.gate] if net else [],
        "data": list(data),
        "data_sha256": hashlib.sha256("".join(sorted(d["sha256"] for d in data)).encode()).hexdigest(),
        "versions": read_versions(),
        **({} if code_commit() is None else {"commit": code_commit()}),
        "units": UNITS,
    }
