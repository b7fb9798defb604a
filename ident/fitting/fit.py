"""Fits a hybrid model: inertias and losses, the laws that a diagnosis named, the net."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ident.arrays import Array, Float
from ident.command_options import LUMPED, FitOptions
from ident.errors import RecordingError
from ident.fitting.choice import choose
from ident.fitting.chosen import ModelChoice
from ident.fitting.coupling import (
    EFFECT,
    NO_COUPLING,
    find_coupling,
    fit_coupling,
    read_coupling,
    without_carried,
)
from ident.fitting.fit_sums import FitSums
from ident.fitting.identification import Identified, identify
from ident.fitting.identified_numbers import identified_numbers
from ident.fitting.named_laws import NamedLaws
from ident.fitting.training_range import find_training_range
from ident.laws.carried import NamedLaw, named_torque
from ident.model.carried import CarriedEffect
from ident.model.hybrid import HybridModel
from ident.model.inertia import InertiaResults
from ident.model.loss import LossParameters, LossResults, loss_figures
from ident.motion.motion import Motion
from ident.motion.stretches import hold, runs_recorded
from ident.origin import UNITS, code_commit
from ident.progress import stage
from ident.records import JsonRecord
from ident.results import Result
from ident.robot.arm import ArmModel

if TYPE_CHECKING:
    from ident.model.memory import JointMemory
    from ident.model.residual_net import ResidualNet

FIT_SCHEMA = "ident.fit/1"
# Samples that a choice is made by; of a longer session stretches from all over it.
CHOSEN_SAMPLES = 200_000
# Distributions whose versions a model's record names.
LIBRARIES = ("armgap", "numpy", "scipy", "torch", "pin")
# Called after each joint, or epoch, of the net: its number, how many, the held-back error.
Progress = Callable[[int, int, float], None]


@dataclass(frozen=True, eq=False)
class FitResults(Result):
    """A fitted model and what stands behind it."""

    model: HybridModel
    identified: Identified
    choice: ModelChoice  # what runs left out chose

    @property
    def loss(self) -> LossResults:
        """Friction and rotors, with intervals."""
        return self.identified.loss

    @property
    def inertia(self) -> InertiaResults:
        """Inertias of the links, with intervals."""
        return self.identified.inertia

    def to_dict(self) -> JsonRecord:
        """The model's record."""
        origin = {**self.model.provenance, **self.provenance.to_dict()}
        return {
            **self.model.record(),
            "schema": FIT_SCHEMA,
            "identified": identified_numbers(self.model),
            "provenance": origin,
        }


@dataclass(frozen=True, eq=False)
class _Rigid:
    """What a fit has before the net: the arm with its losses and laws."""

    identified: Identified
    choice: ModelChoice
    left_out: tuple[str, ...]  # what was named and is not in the model, in words, with the reason
    # Where there are named laws, the arm and its losses as the same runs have them without.
    alone: tuple[ArmModel, LossParameters] | None

    def torque(self, motion: Motion, rigid: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Torque of losses and laws along a run [N m]."""
        params = self.identified.loss.params
        named = self.identified.named
        laws = named_torque(named, motion.q, motion.dq, rigid, params.transition_speed)
        return params.torque(motion.dq, motion.ddq) + laws


def fit_hybrid(
    motions: Sequence[Motion],
    robot: ArmModel,
    options: FitOptions | None = None,
    data: Sequence[dict[str, str]] = (),
    progress: Progress | None = None,
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

    Raises:
        RecordingError: The runs can't tell the parameters: a joint hardly moves in any, say.
    """
    options = options or FitOptions()
    nominal = robot
    if options.links == LUMPED:
        from ident.robot.lumped import build_lumped_arm

        nominal = build_lumped_arm(robot)
        motions = [motion.select(nominal.joint_names) for motion in motions]
    stage("inertias and losses", 0.0, 0.5)
    named = (named or NamedLaws()).within(nominal.n)
    motions = _without_carried(motions, nominal, named.carried)
    coupled = coupling_of(motions, nominal, options, named.carried)
    motions = _without_carried(motions, nominal, coupled)
    rigid = _fit_rigid(motions, nominal, options, named)
    identified = rigid.identified
    net, memory = _fit_learned(motions, rigid, options, progress, checkpoint)
    unasked = coupled if options.coupling is None else ()
    model = HybridModel(
        robot=robot,
        nominal=nominal,
        arm=identified.inertia.arm,
        loss=identified.loss.params,
        net=net,
        memory=memory,
        links=options.links,
        inertia=rigid.choice.kind,
        figures=loss_figures(identified.loss),
        named=identified.named,
        carried=named.carried + coupled,
        alone=rigid.alone,
        inertias=identified.inertias,
        trained=find_training_range(motions, nominal, identified),
        provenance={
            **_provenance(motions, options, data),
            **identified.record(),
            "net_parameters": net.parameters if net else 0,
            "net_gate": [gate.to_dict() for gate in net.gate] if net else [],
            **_origin(data),
            "named_left_out": list(rigid.left_out),
            "choice": rigid.choice.to_dict(),
            "coupled_by_choice": [nominal.joint_names[effect.joint] for effect in unasked],
            "memory_gate": [gate.to_dict() for gate in memory.gate] if memory else [],
        },
    )
    return FitResults(model, identified, rigid.choice)


def _without_carried(
    motions: Sequence[Motion], nominal: ArmModel, effects: Sequence[CarriedEffect]
) -> Sequence[Motion]:
    """Runs whose torque is what would be measured without the effects."""
    if not effects:
        return motions
    return [without_carried(motion, nominal, effects) for motion in motions]


def _fit_rigid(
    motions: Sequence[Motion], nominal: ArmModel, options: FitOptions, named: NamedLaws
) -> _Rigid:
    """The arm with its losses, named laws and those that runs left out ask for."""
    choice, sums = choose_and_gather(motions, nominal, options, named.laws)
    identified, left_out = identify_named(sums, named.left_out, choice)
    fitted = {(law.effect, law.joint) for law in identified.named}
    chosen = {(law.effect, law.joint) for law in choice.laws}
    choice = choice.without(chosen - fitted)
    choice = choice.with_rows(not identified.plain_rows)
    alone = None
    if identified.named:
        plain = identify(sums.only(()), choice.without(fitted))
        alone = (plain.inertia.arm, plain.loss.params)
    return _Rigid(identified, choice, left_out, alone)


def identify_named(
    sums: FitSums, left_out: tuple[str, ...], choice: ModelChoice | None = None
) -> tuple[Identified, tuple[str, ...]]:
    """Identifies an arm with named laws beside losses and inertias.

    A law that would have to be below zero, so that friction drives the joint, is left out and the
    rest is fitted again.

    Args:
        sums: One pass over the runs, with the laws.
        left_out: What else was named, in words, with the reason.
        choice: What runs left out chose, with the same laws; those that it took itself go without
            a word.

    Returns:
        What was identified, and what was named and is left out, with the laws that had to go.
    """
    names = sums.baseline.nominal.joint_names
    given = None
    if choice is not None:
        given = {(law.effect, law.joint) for law in choice.given_laws}
    while True:
        identified = identify(sums, choice)
        vanishing = {(law.effect, law.joint) for law in identified.named if law.vanishes}
        if not vanishing:
            return identified, left_out
        for effect, joint in sorted(vanishing):
            if given is None or (effect, joint) in given:
                left_out += (f"{effect} of {names[joint]}: these recordings have none",)
        if choice is not None:
            choice = choice.without(vanishing)
        sums = sums.only([law for law in sums.laws if (law.effect, law.joint) not in vanishing])


def _fit_learned(
    motions: Sequence[Motion],
    rigid: _Rigid,
    options: FitOptions,
    progress: Progress | None,
    checkpoint: Path | None,
) -> tuple[ResidualNet | None, JointMemory | None]:
    """The net for what arm, losses and laws leave, and the joints' memory."""
    if options.net == "none":
        return None, None
    stage("residual net", 0.5, 1.0)
    from ident.model.residual_net import PRESETS, Unexplained, fit_net_of_arm

    unexplained = Unexplained.by(motions, rigid.identified.inertia.arm, rigid.torque)
    preset = replace(PRESETS[options.net], seed=options.seed)
    net = fit_net_of_arm(unexplained, preset, progress, checkpoint)
    if options.net != "default":
        return net, None
    from ident.model.memory import fit_memory

    return net, fit_memory(unexplained, options.seed)


def coupling_of(
    motions: Sequence[Motion],
    nominal: ArmModel,
    options: FitOptions,
    carried: Sequence[CarriedEffect],
) -> tuple[CarriedEffect, ...]:
    """What coupled joints do to each other: of the pair given, or of pairs that parts ask for.

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
) -> tuple[ModelChoice, FitSums]:
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
        chosen = {(law.effect, law.joint) for law in choice.laws}
        chosen -= {(law.effect, law.joint) for law in given}
        if not chosen:
            raise
        choice = choice.without(chosen)
        sums = FitSums.gather(motions, nominal, settled, choice.laws, choice.widths)
    return replace(choice, whitened=True if options.robust else None), sums


def read_versions() -> dict[str, str]:
    """Version of each library, and of Python; `unknown` where one is not installed as a package."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        versions[name] = "unknown"
        for distribution in importlib.metadata.distributions(name=name):
            versions[name] = distribution.version
            break
    return versions


def _provenance(
    motions: Sequence[Motion], options: FitOptions, data: Sequence[dict[str, str]]
) -> JsonRecord:
    """What was fitted to what."""
    given = {**vars(options), "accept": list(options.accept)}
    return {
        # TOML knows no null.
        "options": {name: value for name, value in given.items() if value is not None},
        "runs": runs_recorded(motions),
        "samples": sum(len(motion.time) for motion in motions),
        "cutoff_hz": motions[0].lowpass.cutoff,
    }


def _origin(data: Sequence[dict[str, str]]) -> JsonRecord:
    """The training files, and the code."""
    digests = "".join(sorted(record["sha256"] for record in data))
    origin: JsonRecord = {
        "data": list(data),
        "data_sha256": hashlib.sha256(digests.encode()).hexdigest(),
        "versions": read_versions(),
    }
    commit = code_commit()
    if commit is not None:
        origin["commit"] = commit
    return {**origin, "units": UNITS}
