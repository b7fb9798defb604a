"""Probabilities of changes: rows of pairs of sets with truth, stored, and a calibration that is fitted to them.

    python -m ident.benchmark.change_calibration store CASES RESULTS
    python -m ident.benchmark.change_calibration fit CASES RESULTS --out calibration_changes.toml

`CASES` is what `python -m ident.benchmark.real_check make … --compare` writes. `store` writes for each pair the
likeliest set of changes with its features and rivals (`ident.diagnosis.change.name_changes`); what is there already is
not made again. `fit` takes those that are what was planted, or of its class, for right and all others for wrong, and
prints how the probabilities hold on arms that were left out whole.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident.arrays import Array, Bool, Float
from ident.benchmark.logistic import Logistic, fit_logistic, log_score
from ident.benchmark.real_check import holds
from ident.diagnosis.change.from_reports import design_reports
from ident.diagnosis.change.name_changes import MOST_BEHIND, LikelyChange, likely_set
from ident.errors import InputError
from ident.files import atomic_write
from ident.records import as_json
from ident.safe_read import read_json
from ident.sessions import Given, inspect_sources

# Features, and the way in which each speaks by its meaning; 0 where it may speak either way.
SIGNS = {
    "log_nats": 1,
    "gain_in_errors": 1,
    "folds_that_gain": 1,
    "share_of_gap": 1,
    "log_size_over_runs": 1,
    "log_size_over_days": 1,
    "log_share_of_evidence": 1,
    "log_left_over_noise": -1,
    "log_null_ratio": -1,
    "names_a_joint": -1,
    "columns": 0,
    "rival_behind": 0,
}
RIDGES = np.geomspace(1e-3, 1.0, 7)
NAMED_FROM = 0.5


@dataclass(frozen=True, eq=False)
class Rows:
    """Changes of all pairs."""

    features: Float[Array, "N k"]
    right: Bool[Array, " N"]
    arm: Array  # of each row
    case: Array  # of each row

    @property
    def weights(self) -> Float[Array, " N"]:
        """By which each arm counts alike."""
        counts = {arm: int((self.arm == arm).sum()) for arm in np.unique(self.arm)}
        weights = np.array([1.0 / counts[arm] for arm in self.arm])
        return np.asarray(weights * len(weights) / weights.sum())


def as_row(one: LikelyChange, joints: Sequence[str]) -> dict[str, Any]:
    """A change as it is stored."""
    own = one.group.effect.scope == "joint"
    acts_on = [joints[j] for j in one.group.acts_on(len(joints))]
    rivals = []
    for (effect, joint, _), deficit in one.rivals.items():
        rivals.append({"effect": effect, "joint": joints[joint] if joint >= 0 else "", "deficit": deficit})
    return {
        "effect": one.group.effect.id,
        "joint": joints[one.group.joint] if own else "",
        "joints": acts_on,
        "features": dict(one.features),
        "rivals": rivals,
    }


def as_finding(row: Mapping[str, Any]) -> dict[str, Any]:
    """A stored change as a finding, with its class and its other places."""
    near = [rival for rival in row["rivals"] if rival["deficit"] <= MOST_BEHIND]
    joints = [row["joint"]] if row["joint"] else row["joints"]
    here = [rival["effect"] for rival in near if not rival["joint"] or rival["joint"] in joints]
    elsewhere = [rival for rival in near if rival["joint"]]
    return {"effect": row["effect"], "joints": joints, "class": here, "elsewhere": elsewhere}


def store(cases: Path, results: Path) -> None:
    """Writes the rows of each pair that has none."""
    for folder in sorted((cases / "cases").iterdir()):
        path = results / f"{folder.name}.json"
        if path.is_file() or not (folder / "before").is_dir():
            continue
        sides = [folder / "before", folder / "after"]
        record: dict[str, Any] = {"changes": []}
        try:
            arm, reports = inspect_sources(Given(sides, sides[1] / "robot.urdf")).whole
            design, excluded = design_reports(reports[:1], reports[1:], arm)
            joints = design.baseline.nominal.joint_names
            record["changes"] = [as_row(one, joints) for one in likely_set(design, excluded)]
        except InputError as error:
            record["error"] = str(error)
        with atomic_write(path) as part:
            part.write_text(as_json(record, None) + "\n", encoding="utf-8")
        print(folder.name, len(record["changes"]), flush=True)


def read_rows(cases: Path, results: Path) -> Rows:
    """All stored changes with their labels.

    Raises:
        InputError: There are none.
    """
    features, right, arm, case = [], [], [], []
    for path in sorted(results.glob("*.json")):
        answer = read_json(cases / "answers" / path.name, "make the cases first")
        for row in read_json(path, "store the rows first")["changes"]:
            finding = as_finding(row)
            features.append([row["features"][name] for name in SIGNS])
            right.append(any(holds(finding, effect) for effect in answer["effects"]))
            arm.append(answer["arm"])
            case.append(path.stem)
    if not features:
        raise InputError(results, "holds no change", "store the rows first")
    return Rows(np.array(features), np.array(right), np.array(arm), np.array(case))


def leave_arms_out(rows: Rows, ridge: float) -> Float[Array, " N"]:
    """Probability of each row by a fit without its arm."""
    found = np.zeros(len(rows.right))
    for arm in np.unique(rows.arm):
        out = rows.arm == arm
        model = _fit(rows, ridge, ~out)
        found[out] = model.probability(rows.features[out])
    return found


def _fit(rows: Rows, ridge: float, chosen: Bool[Array, " N"]) -> Logistic:
    features, right = rows.features[chosen], rows.right[chosen]
    return fit_logistic(features, right, rows.weights[chosen], tuple(SIGNS), ridge, SIGNS)


def fit(rows: Rows) -> tuple[Logistic, float, Float[Array, " N"]]:
    """The calibration of the ridge that holds best on arms left out, that ridge, and the probabilities there."""
    held_out = {float(ridge): leave_arms_out(rows, float(ridge)) for ridge in RIDGES}
    best = max(held_out, key=lambda ridge: log_score(held_out[ridge], rows.right, rows.weights))
    return _fit(rows, best, np.ones(len(rows.right), dtype=bool)), best, held_out[best]


def write(model: Logistic, ridge: float, rows: Rows, out: Path) -> None:
    """Writes the calibration."""
    terms = {}
    for k, name in enumerate(model.names):
        if np.isfinite(model.scaling.scale[k]):
            centre, scale = float(model.scaling.centre[k]), float(model.scaling.scale[k])
            terms[name] = {"weight": float(model.weights[k]), "centre": centre, "scale": scale}
    arms = sorted(np.unique(rows.arm).tolist())
    record = {
        "schema": "ident.calibration_changes/1",
        "intercept": model.intercept,
        "ridge": ridge,
        "pairs": len(np.unique(rows.case)),
        "rows": len(rows.right),
        "arms": arms,
        "feature": terms,
    }
    with atomic_write(out) as part:
        part.write_text(tomli_w.dumps(record), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", choices=("store", "fit"))
    parser.add_argument("cases", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--out", type=Path, default=Path("calibration_changes.toml"))
    given = parser.parse_args()
    if given.job == "store":
        store(given.cases, given.results)
        return
    rows = read_rows(given.cases, given.results)
    model, ridge, held_out = fit(rows)
    write(model, ridge, rows, given.out)
    named = held_out >= NAMED_FROM
    print(f"{len(rows.right)} changes of {len(np.unique(rows.case))} pairs, {int(rows.right.sum())} of them right")
    print(f"ridge {ridge:.3g}; held-out log score {log_score(held_out, rows.right, rows.weights):.3f} nats a change")
    print(f"named on arms left out: {int((named & rows.right).sum())} right, {int((named & ~rows.right).sum())} wrong")


if __name__ == "__main__":
    main()
