"""Models that predict a torque log: the laws themselves, and written files read back.

Files predict also the motion under a logged torque: a file is judged by what is in it and not by
what was meant. Without recordings, every file must differ from the tuned arm by exactly what its
effects say.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from ident.arrays import Array, Float
from ident.export.bodies import random_states
from ident.export.identified import IdentifiedArm, in_module
from ident.export.loaded_mjcf import LoadedMjcf
from ident.export.loaded_model import LoadedModel, SimulatorModel
from ident.export.loaded_urdf import LoadedUrdf
from ident.export.mjcf import write_mjcf
from ident.export.urdf_file import tip_in_file, write_urdf
from ident.files import run_python
from ident.laws.acting import Effect, acting_torque, read_log
from ident.laws.motion import Arm, Losses, MovingArm
from ident.model.carried import describe_arm
from ident.motion.motion import Motion
from ident.recordings.recording import Payload

FILE_OF = {"urdf": "robot.urdf", "mjcf": "robot.xml"}
# What has a memory or stands in the bodies already is not compared state by state.
NOT_AT_ONCE = ("delay", "inertial")
# An interval so long that no delay reaches from one state to the next [s].
APART = 1e9

Loading = dict[str, object]
"""Whether a file loads, and how far it is from what it should hold, for a record."""


@dataclass(frozen=True, eq=False)
class LawModel:
    """Rigid body, losses, and laws of identified effects: what a patch holds."""

    arm: Arm  # the chain, its links tuned
    losses: Losses  # rotor inertia and friction
    effects: tuple[Effect, ...] = ()  # those without a law in torque are left out
    # Of a run's joints, as `MovingArm` takes it; half warm where nobody has followed it.
    warmth: float | Array = 0.5

    @classmethod
    def of(cls, identified: IdentifiedArm, payload: Payload | None = None) -> LawModel:
        """All of an identified arm that has a law, with a known payload."""
        arm = describe_arm(identified.tuned.with_payload(payload))
        return cls(arm, identified.losses, tuple(in_module(identified.changes)))

    def joint_torque(self, q: Array, dq: Array, ddq: Array, interval: float) -> Float[Array, "T n"]:
        """Torque that the motors deliver along a run [N m].

        Args:
            q, dq, ddq: Its states, evenly sampled, shape (T, n) [rad, rad/s, rad/s²].
            interval: Time between them [s].
        """
        states = MovingArm(self.arm, self.losses, q, dq, ddq, interval, warmth=self.warmth)
        plain = states.rigid + self.losses.torque(dq, ddq, states.direction)
        return np.asarray(plain + acting_torque(self.effects, states))

    def read_log(self, torque: Array, interval: float) -> Float[Array, "T n"]:
        """What a log says of such a torque, its sensors' errors included [N m]."""
        return read_log(self.effects, torque, interval)


def log_error(model: SimulatorModel, motion: Motion) -> Float[Array, "t n"]:
    """What a model leaves of a run's log through the run's own filter [N m].

    Zero where a joint doesn't slide.
    """
    torque = model.joint_torque(motion.q, motion.dq, motion.ddq, motion.interval)
    predicted = motion.filtered(model.read_log(torque, motion.interval))
    return np.where(motion.settled, motion.tau_filtered - predicted, 0.0)


@dataclass(frozen=True, eq=False)
class WrittenFile:
    """A file of a format (`urdf`, `mjcf`) in its place."""

    form: str
    folder: Path  # where it lies
    stated: IdentifiedArm  # what the file holds

    @classmethod
    def write(cls, form: str, folder: Path, stated: IdentifiedArm) -> WrittenFile:
        """Writes the file into a folder."""
        folder.mkdir(exist_ok=True)
        text = write_urdf(stated) if form == "urdf" else write_mjcf(stated)
        (folder / FILE_OF[form]).write_text(text, encoding="utf-8")
        return cls(form, folder, stated)

    def load(self, payload: Payload | None = None, module: ModuleType | None = None) -> LoadedModel:
        """The file in its simulator.

        Args:
            payload: A known payload on the last link.
            module: The written module, to stand in for what the file lacks.
        """
        path = self.folder / FILE_OF[self.form]
        arm = self.stated.nominal
        model: LoadedModel
        if self.form == "mjcf":
            model = LoadedMjcf(path, arm.joint_names, payload)
        else:
            locked = tuple(arm.locked_joints)
            model = LoadedUrdf.read(path, locked, self.stated.losses, payload, tip_in_file(arm))
        model.module = module
        return model

    def check(self, seed: int = 0) -> Loading:
        """Largest difference of the loaded file from its bodies, losses and laws [N m].

        They are evaluated at random single states: what has a memory (an elastic joint, a delay)
        is not in them.
        """
        changes = self.stated.changes
        model = self.load()
        if any(change.part(self.form) == "second joint" for change in changes):
            return {"loads": True, "torque_difference_Nm": None}
        q, dq, ddq = random_states(self.stated.nominal, np.random.default_rng(seed))
        instant = [change for change in changes if change.part(self.form) not in NOT_AT_ONCE]
        whole = describe_arm(self.stated.whole)
        law = LawModel(whole, self.stated.losses, tuple(in_module(instant)))
        wanted = law.read_log(law.joint_torque(q, dq, ddq, 0.0), 0.0)
        read = model.read_log(model.joint_torque(q, dq, ddq, 0.0), APART)
        return {"loads": True, "torque_difference_Nm": float(np.max(np.abs(read - wanted)))}


def load_module(path: Path) -> ModuleType:
    """Imports a written module from its file."""
    return run_python(path, f"armgap_patch_{path.parent.name.strip('.')}")
