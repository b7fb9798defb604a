"""What a patch writes of an effect against its law evaluated: the module, and MJCF where its table says it has the law.

Each effect is drawn fifty times: a point of its grid and coefficients of a plausible size (`exact_laws`). Of sentences
and cards `test_effect_sentences.py` holds every number of as many draws to the same hundredth.

    python -m tests.bench.bench_shown [EFFECT …]
"""

from __future__ import annotations

import sys

import mujoco
import numpy as np

from ident.arrays import Array
from ident.effects import optional
from ident.effects.base import RunContext
from ident.effects.catalogue import CATALOGUE
from ident.export.identified import Change, IdentifiedArm, untuned
from ident.export.mjcf import write_mjcf
from ident.laws.acting import read_log
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import make_session
from tests.ident.effects.test_effect_sentences import DRAWS, JOINT
from tests.ident.export.exact_laws import GEAR, drawn, in_module

CLOSE = 0.01  # relative error that counts as the law's own


def in_mjcf(run: RunContext, change: Change, wanted: Array) -> tuple[Array, Array]:
    """What the file does with a motion or a command, or a number in it, and what the law does; empty if it has none."""
    part, p, some = change.part("mjcf"), change.values, slice(None, None, 40)
    arm = IdentifiedArm.tuned_to(run.arm, untuned(run.n), (change,))
    own = optional.expressed(change.kind, "mjcf", p) if change.kind else None
    if own is None or not own.part or arm.links.missed > CLOSE / 10.0:  # the file itself says so
        return np.zeros(0), np.zeros(0)
    model = mujoco.MjModel.from_xml_string(write_mjcf(arm))
    data = mujoco.MjData(model)
    numbers = {
        "second joint": lambda: ([model.jnt_stiffness[JOINT + 1].flat[0], model.dof_damping[JOINT + 1].flat[0]], GEAR),
        "delay": lambda: ([model.sensor_delay[JOINT]], ("delay_s",)),
        "cutoff": lambda: ([model.sensor_cutoff[JOINT]], ("limit_Nm",)),
    }
    if part in numbers:
        values, names = numbers[part]()
        return np.array(values), np.array([p[name] for name in names])
    if part in ("gain", "bias"):  # a command is what the log reads
        data.ctrl[:] = 5.0
        mujoco.mj_forward(model, data)
        return read_log([(change.effect, change.joint, p)], data.qfrc_actuator[None], 0.0)[0], data.ctrl.copy()
    found = []
    for q, dq, ddq in zip(run.motion.q[some], run.motion.dq[some], run.motion.ddq[some], strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.array(found) - run.rigid[some], wanted[some]


def error(found: Array, wanted: Array) -> float:
    """Largest deviation as a share of the largest value; NaN where there is nothing to compare."""
    size = np.abs(wanted).max(initial=0.0)
    return float(np.abs(found - wanted).max() / size) if size > 0.0 else np.nan


def cell(errors: Array) -> str:
    """How many are within a hundredth, and the largest."""
    there = errors[np.isfinite(errors)]
    return f"{(there <= CLOSE).sum()} of {len(there)}, {there.max():.2g}" if len(there) else "-"


def main() -> None:
    session, only = make_session(ArmModel.load("tm5-900"), seconds=8.0, runs=2), sys.argv[1:]
    print(f"{'':28}" + "".join(f"{place:>22}" for place in ("module", "MJCF")))
    for effect in (one for one in CATALOGUE if not one.event and (not only or one.id in only)):
        rng, rows = np.random.default_rng(3), []
        for _ in range(DRAWS):
            variant, change, beta = drawn(effect, session, rng)
            found, wanted = in_module(session, change, variant, beta)
            written = in_mjcf(session.runs[1], change, wanted)
            rows.append([error(found, wanted), error(*written)])
        print(f"{effect.id:28}" + "".join(f"{cell(np.array(one)):>22}" for one in zip(*rows, strict=True)), flush=True)


if __name__ == "__main__":
    main()
