"""Free positions that are refused because of shapes: the scene's own against the meshes of the URDF.

    python tests/bench/bench_plan_shapes.py [POSITIONS]

A position is free where no two links of a pair that the scene checks meet by Coal on the triangles of their meshes.
Prints, for each arm, the share of such positions that the scene's shapes refuse, and the links at fault.
"""

from __future__ import annotations

import sys
import time
from collections import Counter

import coal
import numpy as np
import pinocchio as pin

from ident.robot.arm import ArmModel
from plan.geometry.scene import Scene

ARMS = ("ur10", "panda", "tm5-900")


def meet(arm: ArmModel, pairs: list[frozenset[str]], q: np.ndarray) -> np.ndarray:
    """Whether meshes of some pairs of links meet, position by position."""
    data, objects = arm.model.createData(), list(arm.geometry.geometryObjects)
    names = [str(arm.model.frames[one.parentFrame].name) for one in objects]
    wanted = [(a, b) for a in range(len(objects)) for b in range(a) if frozenset((names[a], names[b])) in pairs]
    out = np.zeros(len(q), dtype=bool)
    for k, row in enumerate(q):
        pin.forwardKinematics(arm.model, data, row)
        at = [data.oMi[one.parentJoint] * one.placement for one in objects]
        poses = [coal.Transform3s(one.rotation, one.translation) for one in at]
        request = coal.CollisionRequest()
        hits = (
            coal.collide(objects[a].geometry, poses[a], objects[b].geometry, poses[b], request, coal.CollisionResult())
            for a, b in wanted
        )
        out[k] = any(hits)
    return out


def main(positions: int = 2000) -> None:
    """Prints a line an arm."""
    for name in ARMS:
        arm, rng = ArmModel.load(name), np.random.default_rng(77)
        began = time.process_time()
        scene = Scene.build(arm)
        spent = time.process_time() - began
        low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
        q = rng.uniform(low, high, (positions, arm.n))
        pairs = [frozenset(scene.names_of(p)) for p in range(len(scene.pairs))]
        free = ~meet(arm, pairs, q)
        found = np.array([scene.distances(row) for row in q[free]])
        refused = found.min(axis=1) < 0.0
        blame = Counter(scene.pair_name(int(p)) for p in found[refused].argmin(axis=1))
        began = time.process_time()
        scene.separation(q)
        rate = (time.process_time() - began) / len(q)
        print(
            f"{name:8} free {free.mean():6.1%}, refused of them {refused.mean():6.2%} ({dict(blame.most_common(4))}), "
            f"dropped {[one.links for one in scene.unchecked if 'overlap' in one.reason]}, "
            f"scene {spent:.2f} s, {1e6 * rate:.0f} us a position"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
