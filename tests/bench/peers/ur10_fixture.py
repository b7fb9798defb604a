"""figaroh's UR10 with a known truth, made anew from its recipe: states and torque of two motions, noise by seeds.

The arm has no friction. Its true inertias are those of the URDF, drawn off by seed 0: masses by 10 %, centres of mass
by 2 cm, second moments of mass by 20 % along axes that are turned by 0.2 rad, so that every body stays possible. The
motions are Fourier series of five harmonics about a posture: seed 18 for training (10 s), 100 for validation (8 s).

Source: thanhndv212/figaroh-examples, examples/ur10/identification_truth.py and data/truth/protocol.yaml (version 1),
whose figures, seeds and order of draws stand here; masses and lengths are those of the UR10e's URDF beside them.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
RATE_HZ = 100.0
CENTRE = np.array([0.0, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0.0])
REACH_RAD, HARMONICS = 1.2, 5
TOP_SPEED = 0.7 * np.array([2.0943951, 2.0943951, 3.14159265, 3.14159265, 3.14159265, 3.14159265])
# Fundamental [Hz] and seed of each motion.
TRAINING, VALIDATION = (0.1, 18), (0.125, 100)
TRUTH_SEED, MASS_SPREAD, COM_SPREAD_M, MOMENT_SPREAD, AXES_SPREAD_RAD = 0, 0.1, 0.02, 0.2, 0.2
# Torque noise as a share of each joint's root mean square in training, position noise [rad].
LEVELS = {"none": (0.0, 0.0), "low": (0.01, 1e-5), "high": (0.05, 1e-4)}
SEEDS = {"training": (101, 102, 103, 104, 105), "validation": (201, 202, 203, 204, 205)}
# What the recipe's own files say of the training torque [N m]: whoever makes it anew must meet it.
TRAINING_RMS_NM = np.array([4.483975005539655, 47.193304991418046, 22.063469489757296])
TRAINING_RMS_NM = np.append(TRAINING_RMS_NM, [1.8828845815112194, 0.25157756448722224, 0.06996137149665518])

# Joint origin (xyz, rpy), mass, centre of mass, orientation and principal moments of each link of the chain.
_HALF = "1.5707963267948966"
_SHOULDER, _ARM = (0.03147431257693659, 0.021875624999999996), (0.42175380379841093, 0.03636562499999999)
_FOREARM, _WRIST = (0.11079302548902206, 0.010884375), (0.005108247956699999, 0.005512499999999999)
_LAST = (0.00014434577559500002, 0.00020452500000000002)
LINKS = (
    ("shoulder_link", "0 0 0.1807", "0 0 0", 7.778, "0 0 0", "0 0 0", _SHOULDER),
    ("upper_arm_link", "0 0 0", "1.570796327 0 0", 12.93, "-0.306 0.0 0.175", f"0 {_HALF} 0", _ARM),
    ("forearm_link", "-0.6127 0 0", "0 0 0", 3.87, "-0.285775 0.0 0.0393", f"0 {_HALF} 0", _FOREARM),
    ("wrist_1_link", "-0.57155 0 0.17415", "0 0 0", 1.96, "0 0 0", "0 0 0", _WRIST),
    ("wrist_2_link", "0 -0.11985 -2.458164590756244e-11", "1.570796327 0 0", 1.96, "0 0 0", "0 0 0", _WRIST),
    (
        *("wrist_3_link", "0 0.11655 -2.390480459346185e-11", "1.570796326589793 3.141592653589793 3.141592653589793"),
        *(0.202, "0.0 0.0 -0.025", "0 0 0", _LAST),
    ),
)
# What is mounted on the last link, about its frame: mass, first moments, inertia (xx, xy, yy, xz, yz, zz).
WRIST_3 = (
    0.47400000000000009,
    (-0.0013618153318366135, -0.0095502871808523376, -0.0046899895247451704),
    (0.0038666771550539963, -0.00018652554541069523, 0.0061748731375646689),
    (4.0949299973973887e-06, 4.5182723511901787e-05, 0.0072031825645269172),
)
LIMITS = ((330.0, 2.0943951), (330.0, 2.0943951), (150.0, 3.14159265), *[(56.0, 3.14159265)] * 3)


@dataclass(frozen=True)
class Split:
    """One motion as an estimator sees it, evenly sampled, shapes (T, 6)."""

    time: Float[Array, " T"]
    q: Float[Array, "T n"]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    tau: Float[Array, "T n"]
    true_q: Float[Array, "T n"]
    true_tau: Float[Array, "T n"]


class Fixture:
    """The arm, its truth and its two motions."""

    @cached_property
    def nominal(self) -> pin.Model:
        model = pin.buildModelFromXML(write_urdf())
        mass, first, (xx, xy, yy), (xz, yz, zz) = WRIST_3
        numbers = np.array([mass, *first, xx, xy, yy, xz, yz, zz])
        model.inertias[6] = pin.Inertia.FromDynamicParameters(numbers)
        return model

    @cached_property
    def truth(self) -> pin.Model:
        """The true arm: draws in the recipe's order."""
        model, rng = pin.Model(self.nominal), np.random.RandomState(TRUTH_SEED)
        for k in range(1, 7):
            body = self.nominal.inertias[k]
            mass = body.mass * np.exp(rng.normal(0.0, MASS_SPREAD))
            centre = body.lever + rng.normal(0.0, COM_SPREAD_M, 3)
            second = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
            sizes, axes = np.linalg.eigh(second)
            sizes = sizes * np.exp(rng.normal(0.0, MOMENT_SPREAD, 3))
            axes = pin.exp3(rng.normal(0.0, AXES_SPREAD_RAD, 3)) @ axes
            second = (axes * sizes) @ axes.T
            model.inertias[k] = pin.Inertia(mass, centre, np.trace(second) * np.eye(3) - 0.5 * (second + second.T))
        return model

    @cached_property
    def training_rms(self) -> Float[Array, " n"]:
        """Root mean square of the training torque without noise, by which noise is scaled [N m]."""
        return np.sqrt(np.mean(self._states(TRAINING)[3] ** 2, axis=0))

    def split(self, name: str, level: str = "none", number: int = 0) -> Split:
        """A motion with the noise of a level, drawn with the seed of a number from 0 to 4."""
        q, dq, ddq, tau = self._states({"training": TRAINING, "validation": VALIDATION}[name])
        share, position = LEVELS[level]
        rng = np.random.RandomState(SEEDS[name][number])
        of_torque, of_position = rng.standard_normal(tau.shape), rng.standard_normal(q.shape)
        time = np.arange(len(q)) / RATE_HZ
        measured = tau + of_torque * share * self.training_rms
        return Split(time, q + of_position * position, dq, ddq, measured, q, tau)

    def _states(self, motion: tuple[float, int]) -> tuple[Array, Array, Array, Array]:
        fundamental, seed = motion
        rng = np.random.RandomState(seed)
        a, b = rng.uniform(-1.0, 1.0, (6, HARMONICS)), rng.uniform(-1.0, 1.0, (6, HARMONICS))
        w = 2 * np.pi * fundamental * np.arange(1, HARMONICS + 1)
        phase = np.outer(np.arange(round(RATE_HZ / fundamental)) / RATE_HZ, w)
        sine, cosine = np.sin(phase), np.cos(phase)
        q = sine @ (a / w).T - cosine @ (b / w).T
        dq = cosine @ a.T + sine @ b.T
        ddq = cosine @ (b * w).T - sine @ (a * w).T
        gain = np.minimum(REACH_RAD / np.abs(q).max(axis=0), TOP_SPEED / np.abs(dq).max(axis=0))
        q, dq, ddq = CENTRE + gain * q, gain * dq, gain * ddq
        data = self.truth.createData()
        tau = np.array([pin.rnea(self.truth, data, *row) for row in zip(q, dq, ddq, strict=True)])
        return q, dq, ddq, tau

    def check(self) -> None:
        """Fails where this is not the recipe's arm: its training torque is known."""
        off = np.abs(self.training_rms / TRAINING_RMS_NM - 1.0)
        assert off.max() < 1e-9, f"not the recipe's fixture: its training torque is off by {off}"

    def write_urdf(self, path: Path) -> Path:
        """The nominal arm as a URDF, the tool a part of the last link."""
        path.write_text(write_urdf(self.nominal.inertias[6]), encoding="utf-8")
        return path


def write_urdf(last: pin.Inertia | None = None) -> str:
    """The chain as URDF text; the last link's inertia may be given whole."""
    parts = ['<robot name="ur10e">', '<link name="base_link"/>', '<link name="base_link_inertia"/>']
    parts.append(_fixed("base_link", "base_link_inertia"))
    parent = "base_link_inertia"
    for joint, (effort, speed), (name, xyz, rpy, mass, centre, turn, (across, along)) in zip(
        JOINTS, LIMITS, LINKS, strict=True
    ):
        moments = f'ixx="{across!r}" ixy="0" ixz="0" iyy="{across!r}" iyz="0" izz="{along!r}"'
        if last is not None and name == LINKS[-1][0]:
            mass, turn, centre = float(last.mass), "0 0 0", " ".join(repr(float(value)) for value in last.lever)
            rows = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
            moments = " ".join(f'{key}="{float(last.inertia[at])!r}"' for key, at in rows.items())
        parts.append(
            f'<link name="{name}"><inertial><mass value="{mass!r}"/><origin xyz="{centre}" rpy="{turn}"/>'
            f"<inertia {moments}/></inertial></link>"
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            f'<limit effort="{effort}" velocity="{speed}" lower="-6.283" upper="6.283"/></joint>'
        )
        parent = name
    return "".join([*parts, "</robot>"])


def _fixed(parent: str, child: str) -> str:
    return (
        f'<joint name="{child}_fixed" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        '<origin xyz="0 0 0" rpy="0 0 3.141592653589793"/></joint>'
    )
