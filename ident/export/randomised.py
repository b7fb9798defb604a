"""Ranges of an identified arm for trainers: Isaac Lab and MuJoCo Playground draw each joint within them.

Source: Isaac Lab 2.3, isaaclab.assets.Articulation (`write_joint_friction_coefficient_to_sim`); MuJoCo Playground's
`randomization_fn`, a function of an mjx.Model and keys that gives the model and its batched axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ident.export.templates import fill
from ident.files import atomic_folder

RANGES_KIND = "ranges"
# What a trainer draws, and the range of `ident ranges` that it is drawn from.
DRAWN = {"armature": "rotor", "friction": "coulomb", "damping": "viscous"}
FILES = ("isaaclab_ranges.py", "playground_ranges.py")


def write_ranges(out: Path, robot: str, ranges: Mapping[str, Mapping[str, tuple[float, float]]]) -> list[str]:
    """Writes both files.

    Args:
        out: Folder; earlier ranges there are replaced.
        robot: The arm's name.
        ranges: By joint and figure (`rotor`, `viscous`, `coulomb`) the ends of its range.

    Returns:
        Joints that are in neither file, as one of their ranges is not known.
    """
    known = [joint for joint, found in ranges.items() if set(DRAWN.values()) <= set(found)]
    tables = {name: [tuple(max(0.0, end) for end in ranges[j][key]) for j in known] for name, key in DRAWN.items()}
    # Names come from files: as literals they stay text, whatever stands in them.
    table = f"ROBOT = {robot!a}\nJOINTS = {tuple(known)!a}\nRANGES = {tables!r}\n"
    with atomic_folder(out, RANGES_KIND) as folder:
        for name in FILES:
            (folder / name).write_text(fill(f"{name}.txt", {"TABLE": table}), encoding="utf-8")
    return [joint for joint in ranges if joint not in known]
