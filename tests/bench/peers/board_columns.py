"""A stranger's entry on a public board: track 1 from its README alone, in numpy and pandas, without a model of the arm.

    python tests/bench/peers/board_columns.py BOARD OUT

Torque is fitted by waves of all angles, products of speeds, accelerations, viscous and Coulomb friction, together with
the arm before where there is one. Of a few effects, each a column at each joint of the session alone, the one that
explains most of what is left there gets half of the probability if it is a tenth or more.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pandas

SMALL = 1e-9
SLOW = 0.05  # speed over which friction falls from rest [rad/s]
ABSORBED = 1e-6  # share below which an ordinary arm explains a column, or a direction is none
LEAST = 0.1  # share of what is left at a joint that a name has to explain


def read(folder, joints):
    """Angles, speeds, accelerations and torques of all runs."""
    parts = [[], [], [], []]
    for path in sorted(folder.glob("*.parquet")):
        run = pandas.read_parquet(path)
        time = run["time"].to_numpy()
        angle = run[[f"{joint}/position" for joint in joints]].to_numpy()
        speed = np.gradient(angle, time, axis=0)
        if f"{joints[0]}/velocity" in run:
            speed = run[[f"{joint}/velocity" for joint in joints]].to_numpy()
        torque = run[[f"{joint}/effort" for joint in joints]].to_numpy()
        whole = (angle, speed, np.gradient(speed, time, axis=0), torque)
        for rows, values in zip(parts, whole, strict=True):
            rows.append(values)
    return [np.concatenate(rows) for rows in parts]


def ordinary(angle, speed, push):
    """Columns of an arm without anything wrong."""
    waves = np.hstack([np.sin(angle), np.cos(angle)])
    heavy = [waves[:, [a]] * waves[:, a:] for a in range(waves.shape[1])]
    whirl = [speed[:, [a]] * speed[:, a:] for a in range(speed.shape[1])]
    lazy = [push[:, [a]] * waves for a in range(push.shape[1])]
    first = np.ones((len(angle), 1))
    return np.hstack([first, waves, *heavy, *whirl, *lazy, push, speed, np.tanh(speed / SLOW)])


def suspects(angle, speed, model, j):
    """A column for each effect that is looked for at a joint."""
    sign = np.tanh(speed[:, j] / SLOW)
    rest = sign * np.exp(-((speed[:, j] / (2.0 * SLOW)) ** 2))
    return {
        "stribeck_friction": rest,
        "nonlinear_viscous_friction": sign * np.sqrt(np.abs(speed[:, j])),
        "load_dependent_friction": sign * np.abs(model),
        "asymmetric_friction": np.abs(sign),
        "spring_torque": angle[:, j],
        "torque_offset": np.ones(len(angle)),
        "torque_gain_error": model,
        "torque_delay": np.gradient(model),
        "torque_ripple": np.sin(angle[:, j] * 100.0),
    }


def choose(board, name, facts):
    """The effect and joint of the column that explains most of what is left; None where it is little."""
    joints = facts["joints"]
    after = read(board / "sessions" / name, joints)
    rows = len(after[0])
    if facts["before"]:
        before = read(board / "before" / name, joints)
        after = [np.concatenate(pair) for pair in zip(after, before, strict=True)]
    angle, speed, push, torque = after
    usual = ordinary(angle, speed, push)
    usual /= np.maximum(np.linalg.norm(usual, axis=0), SMALL)
    basis, sizes, _ = np.linalg.svd(usual, full_matrices=False)
    basis = basis[:, sizes > ABSORBED * sizes[0]]
    left = torque - basis @ (basis.T @ torque)
    model = torque - left
    best, chosen = LEAST, None
    for j, joint in enumerate(joints):
        for effect, column in suspects(angle, speed, model[:, j], j).items():
            felt = np.where(np.arange(len(column)) < rows, column, 0.0)
            new = felt - basis @ (basis.T @ felt)
            if new @ new < ABSORBED * (felt @ felt):
                continue
            share = (new @ left[:, j]) ** 2 / (new @ new) / (left[:, j] @ left[:, j])
            if share > best:
                best, chosen = share, (effect, joint)
    return chosen


def answer(board, name, facts, effects):
    """An answer as README.md of the board says."""
    chosen = choose(board, name, facts) or ("none", "")
    labels = [*effects, "none", "other"]
    share = {label: 0.5 / (len(labels) - 1) for label in labels} | {chosen[0]: 0.5}
    rows = []
    for effect, about in effects.items():
        joint = chosen[1] if effect == chosen[0] else facts["joints"][0]
        place = "" if about["scope"] == "arm" else joint
        rows.append({"effect": effect, "joint": place, "probability": share[effect]})
    head = {"schema": "ident.board_answer/1", "session": name, "effects": rows}
    return {**head, "none": share["none"], "other": share["other"]}


def main(folder, out):
    board, place = Path(folder), Path(out)
    place.mkdir(parents=True, exist_ok=True)
    effects = json.loads((board / "effects.json").read_text())["effects"]
    for name, facts in json.loads((board / "board.json").read_text())["sessions"].items():
        (place / f"{name}.json").write_text(json.dumps(answer(board, name, facts, effects)))


if __name__ == "__main__":
    main(*sys.argv[1:])
