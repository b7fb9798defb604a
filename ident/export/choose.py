"""Which file is written: of all candidates the one that is nearest to recordings that no fit has seen.

Candidates are the URDF's arm, the arm tuned to the same recordings, the arm with its effects, and mixtures: the bodies
of one of them, and at each joint the losses and laws of one. A file whose torque is worse than the URDF's at any joint
is never written; of the others the one whose worst joint, in torque, energy or replay, is best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.export.loading import FILE_OF, WrittenFile
from ident.export.measure import MEASURES, Gap, measure_gap
from ident.laws.motion import Losses
from ident.motion.motion import Motion

# One file is worse than another beyond this ratio of their errors: less is chance, and the simulators' own steps.
WORTH = 1.01
# Errors below these are none: torque [N m], energy [J], position [rad].
LEAST = {"torque": 1e-6, "energy": 1e-6, "position": 1e-7}
SAID = {
    "before": "the URDF's bodies with tuned losses",
    "tuned": "bodies and losses tuned without the effects",
    "after": "bodies, losses and effects together",
}


@dataclass(frozen=True, eq=False)
class Chosen:
    """The file to be written.

    Attributes:
        stated: What it holds.
        bodies: Whose bodies it has, a name of the candidates.
        joints: Whose losses and laws each joint has.
        gaps: Its errors, and those of the candidates that are told beside it.
        worse: Joints at which another candidate is nearer in some measure, with the largest ratio.
    """

    stated: IdentifiedArm
    bodies: str
    joints: tuple[str, ...]
    gaps: Mapping[str, Gap]
    worse: Mapping[str, float]

    @property
    def name(self) -> str:
        """The candidate that it is, or `mixed`."""
        return self.bodies if set(self.joints) == {self.bodies} else "mixed"

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        joints = dict(zip(names, self.joints, strict=True))
        return {"written": self.name, "bodies": self.bodies, "joints": joints, "worse": dict(self.worse)}

    def in_words(self, form: str, names: Sequence[str]) -> list[str]:
        """What a user should know of the choice."""
        lines = []
        if self.name != "after":
            own = [name for name, when in zip(names, self.joints, strict=True) if when != "after"]
            words = f"{SAID[self.bodies]}" + (f"; losses without effects at {', '.join(own)}" if own else "")
            lines.append(f"{FILE_OF[form]}: on these runs the best of its candidates has {words}")
        for name, ratio in self.worse.items():
            lines.append(f"{FILE_OF[form]}: at {name} another candidate is nearer, by a factor of {ratio:.2f}")
        return lines


def choose(form: str, options: Mapping[str, IdentifiedArm], runs: Sequence[Motion], folder: Path) -> Chosen:
    """The nearest candidate of a format.

    Args:
        form: `urdf` or `mjcf`.
        options: What each candidate would hold; the first is what none may be worse than.
        runs: Recordings that no candidate was fitted to.
        folder: A scratch folder.
    """
    payload, names_of = runs[0].payload, next(iter(options.values())).nominal.joint_names
    n = len(names_of)
    found: dict[tuple[str, tuple[str, ...]], Gap] = {}

    def measure(bodies: str, joints: tuple[str, ...]) -> Gap:
        key = bodies, joints
        if key not in found:
            file = WrittenFile.write(form, folder, mix(options, *key))
            found[key] = measure_gap(file.load(payload), runs)
        return found[key]

    alone = {name: measure(name, (name,) * n) for name in options}
    others = [gap for name, gap in alone.items() if name != "after"]
    bound = {one: np.minimum.reduce([getattr(gap, one) for gap in others]) for one in MEASURES}
    for bodies in options:
        names = [bodies, *(name for name in options if name != bodies)]  # of the same errors its own are taken
        ratios = np.array([_ratios(measure(bodies, (name,) * n), bound).max(axis=0) for name in names])
        ratios[1:] *= WORTH
        measure(bodies, tuple(names[k] for k in ratios.argmin(axis=0)))
    least = {"torque": others[0].torque}
    fit = [key for key, gap in found.items() if _ratios(gap, least).max() <= WORTH]
    far = {key: _ratios(found[key], bound) for key in fit}
    # Least where no joint is worse than the bound, and then where all errors are least on the whole.
    rank = {key: (max(one.max(), WORTH), np.log(np.maximum(one, 1e-9)).mean()) for key, one in far.items()}
    bodies, joints = min(fit, key=rank.__getitem__)
    ratios = far[bodies, joints].max(axis=0)
    worse = {name: float(ratio) for name, ratio in zip(names_of, ratios, strict=True) if ratio > WORTH}
    gaps = {name: gap for name, gap in alone.items() if name != "after"} | {"after": found[bodies, joints]}
    return Chosen(mix(options, bodies, joints), bodies, joints, gaps, worse)


def mix(options: Mapping[str, IdentifiedArm], bodies: str, joints: Sequence[str]) -> IdentifiedArm:
    """The bodies of one candidate, with the losses and laws of one at each joint."""
    losses = Losses(
        *(
            np.array([getattr(options[name].losses, one.name)[j] for j, name in enumerate(joints)])
            for one in fields(Losses)
        )
    )
    changes = [change for change in options[bodies].changes if change.of_the_bodies]
    for j, name in enumerate(joints):
        changes += [c for c in options[name].changes if c.joint == j and not c.of_the_bodies]
    return replace(options[bodies], losses=losses, changes=tuple(changes))


def _ratios(gap: Gap, bound: Mapping[str, Array]) -> Float[Array, "m n"]:
    """Errors in units of others, for the measures that those have."""
    return np.array([getattr(gap, one) / np.maximum(bound[one], LEAST[one]) for one in bound])
