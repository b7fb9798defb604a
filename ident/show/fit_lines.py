"""What a fit errs by on parts of its recordings that it did not see, in words and as a table; what
comes next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ident.fitting.in_words import describe
from ident.model.carried import CarriedEffect
from ident.model.hybrid import HybridModel
from ident.model.net_gate import describe_gate
from ident.show.console import TEXT_WIDTH, columns
from ident.show.report.numbers import with_error
from ident.show.report.words import effect_name, parameter_name, percent, significant

if TYPE_CHECKING:
    from ident.fitting.fit import FitResults

NEXT = (
    "Next: `ident evaluate MODEL SESSION…` tries it on recordings that it has not seen, "
    "`ident diagnose SESSION… --model MODEL` names what is left, "
    "`ident export MODEL --out DIR` writes it for a simulator."
)
# Begins the line of a choice whose figures stand elsewhere.
TOLD_BY_FIGURES = "constant torques: one a joint"
UNSEEN = "parts of the recordings that the fit did not see"


@dataclass(frozen=True)
class Foretold:
    """A joint's torque on parts that the fit did not see, where the joint moves."""

    joint: str
    error: float  # root mean square of what the model errs by [N m or N]
    torque: float  # that of the torque
    unit: str

    @property
    def share(self) -> float:
        """The error as a share of the torque; 0 where there is no torque."""
        return self.error / self.torque if self.torque > 0.0 else 0.0

    @property
    def cells(self) -> tuple[str, ...]:
        """Joint, error, torque and share as text."""
        sizes = [f"{significant(size)} {self.unit}" for size in (self.error, self.torque)]
        return self.joint, *sizes, percent(self.share)


def foretold_of(model: HybridModel) -> list[Foretold]:
    """What was found when the model was fitted, joint by joint; nothing of a model of before."""
    sizes = model.provenance.get("choice", {}).get("left_out", {})
    slides = dict(zip(model.joint_names, model.nominal.sliding_joints, strict=True))
    return [
        Foretold(joint, size["rmse_Nm"], size["torque_rms_Nm"], "N" if slides[joint] else "N m")
        for joint, size in sizes.items()
    ]


def describe_foretold(model: HybridModel) -> str:
    """The range over the joints and the worst of them, in a sentence; empty where none is known."""
    joints = foretold_of(model)
    if not joints:
        return ""
    worst = max(joints, key=lambda joint: joint.share)
    least = min(joints, key=lambda joint: joint.share)
    ends = dict.fromkeys([percent(least.share), percent(worst.share)])
    sizes = f"{significant(worst.error)} of {significant(worst.torque)} {worst.unit} rms"
    net = " without the net" if model.net is not None else ""
    return (
        f"{model.robot.name}: on {UNSEEN} the torque is off by {' to '.join(ends)} of it{net}, "
        f"most at {worst.joint} ({sizes})."
    )


def foretold_lines(model: HybridModel) -> list[str]:
    """The error of each joint as a table."""
    rows = [joint.cells for joint in foretold_of(model)]
    table = [("joint", "error, rms", "torque, rms", "share"), *rows]
    return columns(table, "lrrr", TEXT_WIDTH) if rows else []


def describe_offsets(model: HybridModel) -> list[str]:
    """The constant torque of each joint in a line; none where none was fitted."""
    figures = [figure for figure in model.figures if figure.name == "offset"]
    sizes = [f"{figure.joint} {with_error(vars(figure))} {figure.unit}" for figure in figures]
    return [f"constant torques: {', '.join(sizes)}"] if sizes else []


def describe_data(result: FitResults) -> list[str]:
    """What the recordings tell of the arm and what they don't, a line each."""
    named = {law.describe(result.identified.loss.joints) for law in result.identified.named}
    return [line for line in describe(result.identified) if line not in named]


def describe_choices(result: FitResults) -> list[str]:
    """What was chosen and what it costs, and what was left out, a line each."""
    model = result.model
    lines = [line for line in result.choice.describe() if not line.startswith(TOLD_BY_FIGURES)]
    coupled = model.provenance.get("coupled_by_choice", [])
    for first, second in zip(coupled[::2], coupled[1::2], strict=True):
        words = f"{first} and {second} turn each other, say parts left out"
        lines.append(f"{words} (--coupling none: leave it)")
    left_out = model.provenance["named_left_out"]
    lines += [f"left out of what the diagnosis names: {cause}" for cause in left_out]
    if model.net is not None and model.net.gate:
        lines.append(describe_gate(model.net.gate, model.joint_names))
        if model.memory is not None:
            memory = describe_gate(
                model.memory.gate, model.joint_names, "memory of the last second"
            )
            lines.append(memory)
    return lines


def describe_laws(model: HybridModel) -> list[str]:
    """Laws beside plain friction with their figures, and effects that are carried, a line each."""
    return [*(law.describe(model.joint_names) for law in model.named), *describe_carried(model)]


def describe_carried(model: HybridModel) -> list[str]:
    """Effects that a model has as they were found before, a line each."""
    return [_carried_in_words(effect, model.joint_names) for effect in model.carried]


def _carried_in_words(effect: CarriedEffect, joints: tuple[str, ...]) -> str:
    """Place, name and sizes of a carried effect, with the intervals that whoever found it gave."""
    place = "the whole arm" if effect.joint < 0 else joints[effect.joint]
    sizes = []
    for key, value in effect.parameters.items():
        name, unit = parameter_name(key)
        low, high = effect.intervals.get(key, (None, None))
        known = low is not None and high is not None
        interval = f" [{significant(low, 3)}, {significant(high, 3)}]" if known else ""
        sizes.append(f"{name} {significant(value, 3)} {unit}".rstrip() + interval)
    origin = "intervals are the diagnosis' own, 95 %" if effect.intervals else "without an interval"
    name = effect_name(effect.effect)
    return f"{place}: {name}, {', '.join(sizes)}; carried as it was found ({origin})"
