"""What a fit errs by on parts of its recordings that it did not see, in words and as a table; what comes next."""

from __future__ import annotations

from dataclasses import dataclass

from ident.model.hybrid import HybridModel
from ident.show.console import columns
from ident.show.report.words import percent, significant

NEXT = (
    "Next: `ident evaluate MODEL SESSION…` tries it on recordings that it has not seen, "
    "`ident diagnose SESSION… --model MODEL` names what is left, "
    "`ident export MODEL --out DIR` writes it for a simulator."
)
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
    """The range over the joints and the worst of them, in a sentence; empty where nothing is known."""
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
    return columns([("joint", "error, rms", "torque, rms", "share"), *rows], "lrrr") if rows else []
