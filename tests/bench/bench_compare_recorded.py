"""What compare says of pairs of recordings whose difference the recorders measured.

    python tests/bench/bench_compare_recorded.py REAL            # the table
    python tests/bench/bench_compare_recorded.py REAL --fit OUT  # other pairs of these arms, for a calibration

REAL has the recordings of a surgical arm with weights taped on (`dvrk_psm`) and of a servo with bars of several masses
and lengths (`kscale`). `OUT` is then as `python -m ident.benchmark.change_calibration fit` reads it.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.benchmark.change_calibration import compare_pair
from ident.files import atomic_write
from ident.records import as_json

NAMED_FROM = 0.5
BODIES = {"payload", "link_inertial_error"}
# A servo's torque is made from its duty: 0.68 of gravity comes back.
KSCALE_SHARE = 0.5, 1.3
DVRK_SHARE = 0.7, 1.3
DVRK, KSCALE = "dvrk_psm", "kscale"


@dataclass(frozen=True)
class Pair:
    """Two recordings of one arm."""

    folder: str
    before: str
    after: str
    robot: str
    joint: str
    moment_kgm: float | None = None  # of the body that came; None where nothing did
    sense: tuple[float, float] = (0.0, 0.0)  # shares of it between which the figure may lie
    in_table: bool = True

    @property
    def name(self) -> str:
        """Its name in files."""
        return f"{self.folder}_{self.before}_{self.after}"

    def answer(self) -> dict[str, Any]:
        """What changed, as a made case has it."""
        effects = []
        if self.moment_kgm is not None:
            places = [self.joint]
            kind = "payload" if self.folder == KSCALE else "link_inertial_error"
            effects = [
                {"effect": kind, "in_catalogue": True, "joints": places, "may_stand_at": places, "parameters": {}}
            ]
        return {"arm": self.folder, "kind": "recorded" if effects else "untouched", "effects": effects}


def weighted(before: str, after: str, moment: float | None, in_table: bool = True, robot: str = "robot") -> Pair:
    """Two recordings of the surgical arm."""
    return Pair(DVRK, before, after, f"{robot}.urdf", "pitch", moment, DVRK_SHARE, in_table)


def bars(before: str, after: str, moment: float | None, in_table: bool = True) -> Pair:
    """Two recordings of the servo, the first repetition of one bar and the second of another."""
    return Pair(
        KSCALE, f"{before}_rep0", f"{after}_rep1", f"robot_{before}.urdf", "joint", moment, KSCALE_SHARE, in_table
    )


PAIRS = (
    weighted("unloaded", "insertion_105", 0.056),
    weighted("unloaded", "insertion_205", 0.110),
    weighted("unloaded", "parallel_205", 0.030),
    weighted("half_insertion_105", "half_insertion_205", 0.0535),
    weighted("unloaded", "unloaded_again", None),
    weighted("unloaded", "insertion_205", 0.110, robot="robot_guess"),
    bars("0.535_100", "1.168_100", 0.0633),
    bars("0.741_100", "0.969_100", 0.0228),
    bars("0.969_100", "0.969_150", 0.0504),
    bars("0.969_150", "0.969_150", None),
    weighted("insertion_105", "insertion_205", 0.054, in_table=False),
    weighted("unloaded_again", "insertion_105", 0.056, in_table=False),
    weighted("unloaded_again", "parallel_205", 0.030, in_table=False),
    bars("0.535_100", "0.741_100", 0.0206, in_table=False),
    bars("0.535_100", "0.969_100", 0.0434, in_table=False),
    bars("0.741_100", "1.168_100", 0.0427, in_table=False),
    bars("0.535_150", "0.741_150", 0.0309, in_table=False),
    bars("0.741_150", "0.969_150", 0.0342, in_table=False),
    bars("0.535_150", "1.168_150", 0.095, in_table=False),
    bars("0.741_100", "0.741_150", 0.037, in_table=False),
    bars("0.535_100", "0.535_100", None, in_table=False),
    bars("0.741_150", "0.741_150", None, in_table=False),
    bars("1.168_100", "1.168_100", None, in_table=False),
)


def bodies_of(change: Mapping[str, Any], joint: str) -> bool:
    """Whether a body at a joint, or at the flange, is of a change's class."""
    if BODIES & set(change["class"]) and joint in change["joints"]:
        return True
    places = {(place["effect"], place["joint"]) for place in change["elsewhere"]}
    return any((body, where) in places for body in BODIES for where in (joint, None))


def judge(pair: Pair, record: Mapping[str, Any]) -> str:
    """What holds of a comparison, in a word or two."""
    names = [change for change in record["changes"] if change["class_probability"] >= NAMED_FROM]
    bodies = [change for change in names if bodies_of(change, pair.joint)]
    if pair.moment_kgm is None:
        return "holds" if not bodies else "a body that is none"
    if not bodies:
        return "a change, not named" if record["verdict"].startswith("changed") else "missed"
    figure = bodies[0]["parameters"].get("moment_about_axis_kgm")
    if figure is None:
        return "holds, as one of a class"
    low, high = (share * pair.moment_kgm for share in pair.sense)
    right = low <= abs(figure["value"]) <= high
    return f"holds, {figure['value']:.3g} kg m" if right else f"named, but {figure['value']:.3g} kg m"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("real", type=Path)
    parser.add_argument("--fit", type=Path)
    given = parser.parse_args()
    for pair in PAIRS:
        if pair.in_table == (given.fit is not None):
            continue
        folder = given.real / pair.folder
        row = compare_pair([folder / pair.before, folder / pair.after], folder / pair.robot)
        if given.fit is not None:
            for kind, record in (("answers", pair.answer()), ("results", row)):
                with atomic_write(given.fit / kind / f"{pair.name}.json") as part:
                    part.write_text(as_json(record, None) + "\n", encoding="utf-8")
        told = row.get("comparison")
        words = f"refused: {row['error']}" if told is None else f"{told['verdict']}: {judge(pair, told)}"
        changes = [] if told is None else told["changes"]
        names = [f"{change['effect']} {change['class_probability']:.2f}" for change in changes]
        print(f"{pair.name} ({pair.robot}): {words}; {', '.join(names)}; {row['processor_seconds']:.1f} s", flush=True)


if __name__ == "__main__":
    main()
