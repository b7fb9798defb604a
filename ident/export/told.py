"""What a user of the written files should know beside the effects, and what no file says."""

from __future__ import annotations

from collections.abc import Sequence

from ident.export.formats import LOADED, stood_in
from ident.export.identified import IdentifiedArm
from ident.export.learned import FILE as LEARNED
from ident.model.hybrid import HybridModel
from ident.recordings.columns import listed
from ident.show.report.words import effect_name

# Less of the tuned torque than this is not worth a word.
LEAST_MISSED = 0.005
NO_ROTORS = (
    "robot.urdf: a URDF has no place for rotor inertia; take it from parameters.toml "
    "(Pinocchio: armature)"
)


def notes_on_arm(identified: IdentifiedArm, module: str) -> list[str]:
    """What a user of an arm's files should know.

    Args:
        identified: The arm.
        module: Name of its Python module.
    """
    lines = [NO_ROTORS]
    if not identified.is_level:
        pull = " ".join(f"{component:.2f}" for component in identified.gravity)
        lines.append(
            f"gravity pulls along ({pull}) m/s² of the base: "
            "robot.urdf stands on a link `level`, turned so"
        )
    lines += _turning_friction(identified)
    lines += _doubtful(identified)
    missed = identified.links.missed
    if missed > LEAST_MISSED:
        lines.append(
            "the inertias as identified belong to no bodies that can exist: the files have the "
            f"nearest that can, which leave out {100.0 * missed:.1f} % of the torque that the "
            "change makes"
        )
    locked = identified.nominal.locked_joints
    if locked:
        fixed = [f"{name} at {position:g}" for name, position in locked.items()]
        lines.append(f"robot.xml: not in the recordings, or fingers, and so fixed: {listed(fixed)}")
    return lines + _stood_in(identified, module)


def _turning_friction(identified: IdentifiedArm) -> list[str]:
    """Joints whose dry friction turns round over a displacement."""
    losses = identified.losses
    turning = (losses.range > 0.0) & (losses.coulomb > 0.0)
    if not turning.any():
        return []
    joints = identified.nominal.joint_names
    names = ", ".join(joints[j] for j in turning.nonzero()[0])
    return [
        f"{names}: dry friction turns round over a displacement (sliding_range_rad of "
        "parameters.toml), for which neither file has words: robot.xml sticks and slips at once, "
        "robot.urdf leaves it to the simulator"
    ]


def _doubtful(identified: IdentifiedArm) -> list[str]:
    """Effects that are written although they are less likely than not."""
    doubtful = [change for change in identified.changes if change.probability < 0.5]
    if not doubtful:
        return []
    names = ", ".join(f"{effect_name(change.effect)} of {change.joints[0]}" for change in doubtful)
    return [f"less likely than not, and written all the same: {names}"]


def _stood_in(identified: IdentifiedArm, module: str) -> list[str]:
    """At which joints losses stand in for laws, by format."""
    names = identified.nominal.joint_names
    lines = []
    for form in LOADED:
        indices = {change.joint for change in stood_in(identified.changes, form)}
        joints = [names[j] for j in sorted(indices)]
        if joints:
            lines.append(
                f"{form}: at {', '.join(joints)} the losses nearest to the effects' laws stand in "
                f"for them; {module} (extra_torque) has the laws"
            )
    return lines


def notes_on_model(model: HybridModel) -> list[str]:
    """What of a fitted model stands in its folder alone."""
    lines = []
    if model.net is not None or model.loss.offset.any():
        lines.append(
            "the residual net and torque offsets are in the model folder and, of format cpp, "
            f"{LEARNED} alone"
        )
    if model.carried:
        names = ", ".join(effect.effect for effect in model.carried)
        lines.append(
            f"carried effects ({names}) are in the model folder alone: "
            "`ident patch` writes what it can"
        )
    return lines


def notes_on_losses(identified: IdentifiedArm, files: Sequence[str]) -> list[str]:
    """Which files know no law of an effect, and what stands in for it there.

    Args:
        identified: The arm.
        files: Names of the files that hold losses alone.
    """
    effects = [f"{change.effect} of {change.joints[0]}" for change in identified.changes]
    if not files or not effects:
        return []
    return [
        f"{listed(files)}: no place for {listed(effects)}: of friction of a joint, what is "
        "nearest along these motions stands in"
    ]
