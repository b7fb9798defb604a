"""Files of an identified arm, written and loaded back: into simulators, and into Python.

Without recordings, every file must differ from the tuned arm by exactly what its effects say.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ident.export.bodies import random_states
from ident.export.identified import IdentifiedArm, in_module
from ident.export.loaded import LawModel, LoadedMjcf, LoadedModel, LoadedUrdf
from ident.export.mjcf import write_mjcf
from ident.export.python import describe_arm
from ident.export.urdf import write_urdf
from ident.files import WithoutBytecode
from ident.recordings.recording import Payload

FILE_OF = {"urdf": "robot.urdf", "mjcf": "robot.xml"}


@dataclass(frozen=True, eq=False)
class WrittenFile:
    """A file of a format in its place.

    Attributes:
        form: `urdf` or `mjcf`.
        folder: Where it lies.
        stated: What the file holds.
    """

    form: str
    folder: Path
    stated: IdentifiedArm

    @classmethod
    def write(cls, form: str, folder: Path, stated: IdentifiedArm) -> WrittenFile:
        """Writes the file into a folder."""
        folder.mkdir(exist_ok=True)
        text = write_urdf(stated) if form == "urdf" else write_mjcf(stated)
        (folder / FILE_OF[form]).write_text(text, encoding="utf-8")
        return cls(form, folder, stated)

    def load(self, payload: Payload | None = None) -> LoadedModel:
        """The file in its simulator."""
        path, arm = self.folder / FILE_OF[self.form], self.stated.nominal
        if self.form == "mjcf":
            return LoadedMjcf(path, arm.joint_names, payload)
        return LoadedUrdf(path, tuple(arm.locked_joints), self.stated.losses, payload)

    def check(self, seed: int = 0) -> dict[str, Any]:
        """Largest difference of the loaded file from its bodies, losses and laws, evaluated at random states [N m].

        Single states: what has a memory (an elastic joint, a delay) is not in them.
        """
        changes, model = self.stated.changes, self.load()
        if any(change.part(self.form) == "second joint" for change in changes):
            return {"loads": True, "torque_difference_Nm": None}
        q, dq, ddq = random_states(self.stated.nominal, np.random.default_rng(seed))
        # Link errors are in the bodies already.
        instant = in_module([c for c in changes if c.part(self.form) not in ("delay", "inertial")])
        law = LawModel(describe_arm(self.stated.whole), self.stated.losses, tuple(instant))
        wanted = law.read_log(law.joint_torque(q, dq, ddq, 0.0), 0.0)
        # States that lie for ever apart: no delay reaches from one to the next.
        left = model.read_log(model.joint_torque(q, dq, ddq, 0.0), 1e9) - wanted
        return {"loads": True, "torque_difference_Nm": float(np.max(np.abs(left)))}


def load_module(path: Path) -> ModuleType:
    """Imports a written module from its file."""
    name = f"armgap_patch_{path.parent.name.strip('.')}"
    loader = WithoutBytecode(name, str(path))
    spec = importlib.util.spec_from_loader(name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up while it is being made; a second patch must not find the first one's.
    sys.modules[name] = module
    try:
        loader.exec_module(module)
    finally:
        del sys.modules[name]
    return module
