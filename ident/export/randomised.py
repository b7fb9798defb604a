"""Ranges of an identified arm for trainers: Isaac Lab and MuJoCo Playground draw each joint within them.

Source: Isaac Lab 2.3, isaaclab.assets.Articulation (`write_joint_friction_coefficient_to_sim`); MuJoCo Playground's
`randomization_fn`, a function of an mjx.Model and keys that gives the model and its batched axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ident.files import atomic_folder

RANGES_KIND = "ranges"
# What a trainer draws, and the range of `ident ranges` that it is drawn from.
DRAWN = {"armature": "rotor", "friction": "coulomb", "damping": "viscous"}
HEAD = '''"""Ranges of the robot called ROBOT, as wide as it was measured to differ from day to day, and no wider.

{use}
Rotor inertia [kg m²], dry friction [N m] and viscous friction [N m s/rad] of each joint are drawn evenly and by
themselves. What `ident ranges` says of torque gains and offsets is of the log, not of the arm, and not drawn.
"""
'''
ISAAC = '''
import torch

{table}

def randomize_joints(env, env_ids, asset_cfg):
    """Draws every joint of some environments anew."""
    asset = env.scene[asset_cfg.name]
    if env_ids is None:
        env_ids = torch.arange(env.scene.num_envs, device=asset.device)
    ids, _ = asset.find_joints(list(JOINTS), preserve_order=True)
    drawn = {{}}
    for name, table in RANGES.items():
        low, high = torch.tensor(table, device=asset.device).T
        drawn[name] = low + (high - low) * torch.rand(len(env_ids), len(ids), device=asset.device)
    asset.write_joint_armature_to_sim(drawn["armature"], joint_ids=ids, env_ids=env_ids)
    dry, viscous = drawn["friction"], drawn["damping"]
    asset.write_joint_friction_coefficient_to_sim(dry, dry, viscous, joint_ids=ids, env_ids=env_ids)
'''
PLAYGROUND = '''
import jax
import numpy as np

{table}
FIELDS = {{"armature": "dof_armature", "friction": "dof_frictionloss", "damping": "dof_damping"}}


def randomizer(mj_model):
    """A randomization_fn for environments of a mujoco.MjModel that has these joints."""
    dofs = np.array([mj_model.joint(name).dofadr[0] for name in JOINTS])

    def domain_randomize(model, rng):
        def draw(key):
            keys = jax.random.split(key, len(RANGES))
            drawn = {{}}
            for one, (name, table) in zip(keys, RANGES.items()):
                low, high = np.array(table).T
                values = jax.random.uniform(one, (len(JOINTS),), minval=low, maxval=high)
                drawn[FIELDS[name]] = getattr(model, FIELDS[name]).at[dofs].set(values)
            return drawn

        drawn = jax.vmap(draw)(rng)
        axes = jax.tree_util.tree_map(lambda _: None, model).tree_replace(dict.fromkeys(drawn, 0))
        return model.tree_replace(drawn), axes

    return domain_randomize
'''
USES = {
    "isaaclab_ranges.py": (
        "EventTermCfg(func=randomize_joints, mode='reset', params={'asset_cfg': SceneEntityCfg('robot')})\n",
        ISAAC,
    ),
    "playground_ranges.py": ("train_fn(..., randomization_fn=randomizer(env.mj_model))\n", PLAYGROUND),
}


def write_ranges(out: Path, robot: str, ranges: Mapping[str, Mapping[str, tuple[float, float]]]) -> list[str]:
    """Writes both files.

    Args:
        out: Folder; earlier ranges there are replaced.
        robot: The arm's name.
        ranges: By joint and figure (`rotor`, `viscous`, `coulomb`) the ends of its range.

    Returns:
        Joints that are in neither file, as one of their ranges is not known.
    """
    known = [joint for joint, found in ranges.items() if set(DRAWN.values()) <= set(found)]
    tables = {name: [tuple(max(0.0, end) for end in ranges[j][key]) for j in known] for name, key in DRAWN.items()}
    # Names come from files: as literals they stay text, whatever stands in them.
    table = f"ROBOT = {robot!a}\nJOINTS = {tuple(known)!a}\nRANGES = {tables!r}\n"
    with atomic_folder(out, RANGES_KIND) as folder:
        for name, (use, body) in USES.items():
            (folder / name).write_text(HEAD.format(use=use) + body.format(table=table), encoding="utf-8")
    return [joint for joint in ranges if joint not in known]
