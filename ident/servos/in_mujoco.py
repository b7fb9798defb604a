"""A written servo.xml loaded back and rolled out by MuJoCo, beside our own steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from xml.sax.saxutils import quoteattr

import numpy as np

from ident.arrays import Array, Float
from ident.servos.roll_out import STEP_S, Drive, ServoModel
from ident.servos.servo_files import as_mujoco

BODY = """\
<option timestep="{step!r}" integrator="implicitfast" gravity="0 0 0"/>
<worldbody><body>
  <inertial pos="0 0 0" mass="1" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
  <joint name={name} class={servo} axis="0 0 1"/>
</body></worldbody>
"""


def mujoco_error(joint: str, model: ServoModel, drives: Sequence[Drive]) -> float:
    """Mean absolute error of the file's roll-outs [rad]; NaN where MuJoCo is not installed.

    Args:
        joint: Its name.
        model: The servo's.
        drives: Runs of the joint.
    """
    if find_spec("mujoco") is None:
        return float("nan")
    errors = []
    for drive in drives:
        # A file holds one stiffness: each run is rolled out with its session's.
        held = replace(model, stiffness=(model.stiffness[drive.session],))
        positions = roll_out(as_mujoco({joint: held}), joint, model.offset, drive)
        errors.append(float(np.mean(np.abs(positions - drive.position))))
    return float(np.mean(errors))


def roll_out(text: str, joint: str, offset: float, drive: Drive) -> Float[Array, " T"]:
    """Where the joint of a file goes, from where it was, by goals alone [rad].

    Args:
        text: A servo.xml.
        joint: The joint.
        offset: Of its zero, by which goals are moved [rad].
        drive: What it was told, what it carried, and when the motor held it.
    """
    import mujoco

    names = {"name": quoteattr(joint), "servo": quoteattr(f"servo_{joint}")}
    body = BODY.format(step=STEP_S, inertia=drive.inertia, **names)
    model = mujoco.MjModel.from_xml_string(text.replace("<mujoco>", f"<mujoco>{body}", 1))
    data = mujoco.MjData(model)
    data.qpos[0] = drive.position[0]
    goals = drive.goal + offset
    if model.nhistory:
        samples = int(model.actuator_history[0, 0])
        mujoco.mj_initCtrlHistory(model, data, 0, None, np.full((samples, 1), goals[0]))
    gain = model.actuator_gainprm[0].copy()
    bias = model.actuator_biasprm[0].copy()
    positions = np.empty(len(drive.time))
    positions[0] = data.qpos[0]
    begin = drive.time[0]
    for t in range(1, len(drive.time)):
        data.ctrl[0] = goals[t - 1]
        model.actuator_gainprm[0] = gain * drive.driven[t - 1]
        model.actuator_biasprm[0] = bias * drive.driven[t - 1]
        while data.time < drive.time[t] - begin - 0.5 * STEP_S:
            angle = data.qpos[0]
            of_cosine = drive.cosine[t] * np.cos(angle)
            data.qfrc_applied[0] = -of_cosine - drive.sine[t] * np.sin(angle)
            mujoco.mj_step(model, data)
        positions[t] = data.qpos[0]
    return positions
