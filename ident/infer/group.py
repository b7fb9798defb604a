"""Which joints of a robot the columns of a table are where nothing names them, and they are fewer.

A chain may begin with a torso's joints or a lift, and end with a gripper's. The columns are those
of joints in a row: of each such group all conventions are searched, and the group is taken under
which the torques are likeliest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ident.checks.conventions.find import Conventions, find_conventions
from ident.checks.conventions.settings import DESCRIPTION, SEARCH
from ident.infer.guess import Reason, Signals
from ident.infer.units import session_of
from ident.recordings.columns import listed
from ident.robot.arm import ArmModel


def likeliest_group(signals: Signals, arm: ArmModel, read: Callable[[Signals], Signals]) -> Signals:
    """The signals under the names of the joints that explain the torque best.

    Those that stand first in the robot, where no others are surely likelier.

    Args:
        signals: Columns in the units of the file, called by the robot's first joints.
        arm: The robot.
        read: Makes SI of them under the limits of the joints that they are called by.

    Returns:
        The signals with a reason for the joints that says how the groups compare; as they were
        where they are of all joints, are named, or hold too little to tell.
    """
    count = len(signals.joints)
    if not signals.by_place or count >= arm.n:
        return signals
    searched: dict[tuple[str, ...], Conventions] = {}
    for first in range(arm.n - count + 1):
        joints = arm.joint_names[first : first + count]
        session = session_of(read(replace(signals, joints=joints)), arm)
        conventions = session and find_conventions(session, arm.keeping(joints))
        if conventions:
            searched[joints] = conventions
    if signals.joints not in searched:
        return signals
    likeliest = min(searched, key=lambda joints: searched[joints].best.cost)
    first_cost = searched[signals.joints].best.cost
    odds = DESCRIPTION.observations * (first_cost - searched[likeliest].best.cost)
    chosen = likeliest if odds > math.log(SEARCH.sure_odds) else signals.joints
    shares = []
    for joints in sorted(searched, key=lambda joints: searched[joints].best.cost):
        share = 100.0 * searched[joints].best.explains
        shares.append(f"{share:.1f} % ({joints[0]} to {joints[-1]})")
    seen = f"of its {arm.n} joints {count} are logged; so read the torque is explained to "
    told = Reason("arm", f"{chosen[0]} to {chosen[-1]}", seen + listed(shares))
    reasons = []
    for reason in signals.reasons:
        is_joints = reason.what == "joints"
        reasons.append(replace(reason, guess=", ".join(chosen)) if is_joints else reason)
    return replace(signals, joints=chosen, reasons=(*reasons, told))
