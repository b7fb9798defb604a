"""Which way gravity pulls on the base: arms hang from ceilings and walls, and URDFs stand on floors.

Each joint's torque is linear in gravity's vector c (base frame),

    tau_j = s_j G_j(q) c + a_j (rnea - g) + b_j tanh(dq / eps) + d_j dq + o_j,

with a scale s_j of its own, near one, for masses and gains that are off. The likeliest direction of c is sought, under
normal residuals with a variance for each joint: the least sum of the logarithms of what is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.checks.effort import TRANSITION_RAD_S, States, collect_states, fit_signed
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel

# From this angle on a base is mounted otherwise; what is less is a tilt, which is a diagnosis's to find [degrees].
LEAST_TURN_DEG = 15.0
# By what factor the residuals must shrink, over the joints that feel gravity together, and what is then explained.
LEAST_GAIN, LEAST_EXPLAINED = 4.0, 0.5
# Scales of gravity that masses and gains may have; part of a torque's variance that no direction explains.
SCALES, FLOOR = (0.3, 3.0), 1e-3
DIRECTIONS, STATES = 800, 1500
GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class Pull:
    """What one joint's torque tells of gravity's direction u: its residual's share is 1 - 2 s b·u + s² u·W·u.

    Attributes:
        b: Inner products of the torque with what each axis of gravity would ask for, shape (3,).
        w: Inner products of these with each other, shape (3, 3); both per variance of the torque.
    """

    b: Float[Array, " 3"]
    w: Float[Array, "3 3"]

    def left(self, directions: Float[Array, "k 3"]) -> Float[Array, " k"]:
        """Share of the torque's variance that each direction leaves."""
        along = directions @ self.b
        square = np.maximum(np.einsum("ki,ij,kj->k", directions, self.w, directions), 1e-12)
        scale = np.clip(along / square, *SCALES)
        return np.asarray(np.maximum(1.0 - 2.0 * scale * along + scale**2 * square, 0.0) + FLOOR)


def mend_mount(session: Session, arm: ArmModel) -> tuple[ArmModel, list[TelemetryIssue]]:
    """The arm as it is mounted: under the gravity that its torque follows, where that is surely not the URDF's.

    Args:
        session: Positions in radians.
        arm: The robot with the session's payload.
    """
    states = collect_states(session, arm) if session.effort_kind != "gravity_compensated" else None
    pulls = {} if states is None else _pulls(states, arm)
    if states is None or not pulls:
        return arm, []
    now = np.array(arm.model.gravity.linear)
    now = now / max(float(np.linalg.norm(now)), 1e-12)
    best = find_direction(list(pulls.values()))
    angle = float(np.degrees(np.arccos(np.clip(best @ now, -1.0, 1.0))))
    gains = {j: float(-np.diff(np.log(pull.left(np.stack([now, best]))))[0]) for j, pull in pulls.items()}
    if angle < LEAST_TURN_DEG or sum(gains.values()) < np.log(LEAST_GAIN):
        return arm, []
    turned = arm.with_gravity(GRAVITY * best)
    heavy = max(gains, key=lambda j: gains[j])
    there = collect_states(session, turned)
    explained = 0.0 if there is None else fit_signed(there, heavy, 1.0).explained
    # A torque of the wrong sign follows gravity upside down, and inertia and friction too: that is no mount.
    as_it_is = max(fit_signed(states, heavy, sign).explained for sign in (1.0, -1.0))
    if explained < max(LEAST_EXPLAINED, as_it_is):
        return arm, []
    share = f"{explained:.0%} of the effort of {session.joints[heavy]}, not {max(as_it_is, 0.0):.0%}"
    return turned, [_describe(session, now, best, angle, share)]


def find_direction(pulls: list[Pull]) -> Float[Array, " 3"]:
    """The unit vector along which gravity most likely pulls: over a sphere, then ever closer around the best."""
    k = np.arange(DIRECTIONS) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * k / DIRECTIONS), np.pi * (1.0 + np.sqrt(5.0)) * k
    places = np.column_stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])
    best = places[0]
    for width in (None, 0.1, 0.02, 0.004):
        near = places if width is None else best + width * places
        near = near / np.linalg.norm(near, axis=1)[:, None]
        best = near[int(np.argmin(sum(np.log(pull.left(near)) for pull in pulls)))]
    return np.asarray(best)


def _pulls(states: States, arm: ArmModel) -> dict[int, Pull]:
    """What each moving joint says that feels some gravity, in whichever direction."""
    rows = slice(None, None, max(1, len(states.q) // STATES))
    q, dq, tau = states.q[rows], states.dq[rows], states.tau[rows]
    if len(q) < 20:
        return {}
    axes = np.stack([arm.with_gravity(GRAVITY * axis).gravity(q) for axis in np.eye(3)], axis=-1)
    change = axes.std(axis=0).max(axis=1)
    least = max(states.settings.heavy_Nm, states.settings.heavy_share * float(change.max()))
    found = {}
    # A joint that stands still is held by its friction, too: how it pulls there says little of gravity.
    for j in np.flatnonzero((change > least) & states.alive & states.moving):
        friction = [np.tanh(dq[:, j] / TRANSITION_RAD_S), dq[:, j], np.ones(len(q))]
        beside, _ = np.linalg.qr(np.column_stack([states.inertial[rows, j], *friction]))
        target = tau[:, j] - beside @ (beside.T @ tau[:, j])
        table = axes[:, j] - beside @ (beside.T @ axes[:, j])
        variance = float(target @ target)
        if variance > 0.0:
            found[int(j)] = Pull(table.T @ target / variance, table.T @ table / variance)
    return found


def _describe(session: Session, now: Array, best: Array, angle: float, share: str) -> TelemetryIssue:
    axis = np.cross(best, now)
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-6 else np.array([1.0, 0.0, 0.0])
    about = next((name for name, unit in zip("xyz", np.eye(3), strict=True) if abs(axis @ unit) > 0.99), None)
    words = about or f"({', '.join(f'{one:.2f}' for one in axis)})"
    signed = angle * (1.0 if about is None or axis["xyz".index(about)] > 0.0 else -1.0)
    line = f"gravity_mps2 = [{', '.join(f'{GRAVITY * one:.2f}' for one in best)}]"
    evidence = (
        f"{session.name}: gravity does not pull where the URDF's base has it: turn the base by {signed:.0f}° about "
        f"{words}, and the model explains {share}; used so from here on"
    )
    return TelemetryIssue("mounting", (), "warning", evidence, f"write {line} in session.toml, as the arm is mounted")
