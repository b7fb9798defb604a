"""figaroh or mujoco.sysid on a board: each session becomes a job of `run_figaroh.py` or `run_sysid.py`, which runs
in a Python of its own.

    PEER=figaroh PEER_PYTHON=PYTHON python tests/bench/peers/board_jobs.py BOARD ANSWERS/figaroh [--limit 20]
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from board_entry import enter, write_torque
from job import write_job

HERE = Path(__file__).parent
PEER = os.environ.get("PEER", "figaroh")
PYTHON = os.environ.get("PEER_PYTHON", sys.executable)


def mjcf_of(session, folder):
    """The URDF as MuJoCo compiles it, with its joints alone."""
    path = folder / "robot.xml"
    spec = mujoco.MjSpec.from_file(str(session.urdf))
    for joint in spec.joints:
        if joint.name not in session.joints:
            spec.delete(joint)
    spec.compile()
    path.write_text(spec.to_xml())
    return str(path)


def answer(session, out):
    if not session.unseen.is_file():
        return
    time, q = session.motion()
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home) / "job"
        facts = {"urdf": str(session.urdf.resolve()), "joints": session.joints, "friction": True, "physical": True}
        if PEER == "sysid":
            facts["mjcf"] = mjcf_of(session, Path(home))
        write_job(folder, facts, {"train": session.runs_of_model(), "test": [(time, q, np.zeros_like(q))]})
        ended = subprocess.run([PYTHON, HERE / f"run_{PEER}.py", folder], capture_output=True, text=True)
        if ended.returncode:
            print(f"{session.name}: {ended.stderr.strip().splitlines()[-1]}", flush=True)
            return
        with np.load(folder / "out.npz") as arrays:
            write_torque(session, out, arrays["time0"], arrays["tau0"])


if __name__ == "__main__":
    enter(answer)
