"""Numbers that decide, from the cases of a check: what healthy arms leave, and how often names are right.

Four kinds of number hang on the worlds in which a diagnosis is used and not on any law:

- how far what is left must stand out (`verdict.stands_out`, `much_left`, `far_left`): in units of these, the largest of
  an arm's joints is about log-normal over healthy arms. They are scaled by the value that one healthy arm in so many
  exceeds (`ALARMS`);
- how far a name is believed where nothing is left open (`selection.most_sure`), where a part of the gap is
  (`verdict.trust_if_open`) and where most of it is (`verdict.trust_if_wide_open`): the share of right names there,
  Laplace's rule on top of what was believed before;
- which names stand in the class of another (`selection.class_odds`): so that 95 % of classes hold the truth.

Each is told with its 95 % interval, so that a second seed can be held against it.

Source: Gelman et al. 2013, section 2.4 (shares with a prior of some cases).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident.blind_check.class_sets import measure_class_sets
from ident.blind_check.scoring import JUDGED, Outcome
from ident.blind_check.statistics import Z, share
from ident.blind_check.summary import BlindReport
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.settings_file import ORIGIN
from ident.errors import InputError
from ident.files import atomic_write
from ident.numerics import normal_quantile

# One healthy arm in so many may be told that something is left.
ALARMS = 200
# Cases that what was believed before counts as.
PRIOR_CASES = 4.0
LEAST_HEALTHY, LEAST_NAMES = 20, 10
# The first line: a check that goes on writes its file anew.
WRITTEN_BY = "# written by armgap"
STANDING = ("stands_out", "much_left", "far_left")


@dataclass(frozen=True)
class Calibrated:
    """A number with its 95 % interval.

    Attributes:
        group, name: Its place among the settings.
        value, low, high: The number.
        count: Cases, or names, behind it.
    """

    group: str
    name: str
    value: float
    low: float
    high: float
    count: int

    def to_dict(self) -> dict[str, Any]:
        told = {key: getattr(self, key) for key in ("value", "low", "high")}
        return {
            "name": f"{self.group}.{self.name}",
            **{k: float(f"{v:.4g}") for k, v in told.items()},
            "count": self.count,
        }


def calibrate(outcomes: Sequence[Outcome], used: DiagnosisSettings = USUAL) -> tuple[Calibrated, ...]:
    """All numbers of which enough cases speak.

    Args:
        outcomes: Cases that were diagnosed with the numbers that are used.
        used: These.
    """
    return (*_standing(outcomes, used), *_trust(outcomes, used), *_classes(outcomes))


def _standing(outcomes: Sequence[Outcome], used: DiagnosisSettings) -> list[Calibrated]:
    healthy = [one for one in outcomes if one.kind in ("healthy", "decoy") and not one.urdf_wrong]
    left = np.array([one.leftover for one in healthy if one.leftover])
    if len(left) < LEAST_HEALTHY:
        return []
    logs, far = np.log(left), normal_quantile(1.0 - 1.0 / ALARMS)
    spread = float(np.std(logs, ddof=1))
    middle = float(np.mean(logs)) + far * spread
    # Of a normal sample: the mean's error, and that of the deviation.
    error = spread * float(np.sqrt(1.0 / len(logs) + far**2 / (2.0 * (len(logs) - 1))))
    value, low, high = (float(np.exp(middle + side * Z * error)) for side in (0.0, -1.0, 1.0))
    return [
        Calibrated("verdict", name, old * value, old * low, old * high, len(left))
        for name, old in ((name, getattr(used.verdict, name)) for name in STANDING)
    ]


def _trust(outcomes: Sequence[Outcome], used: DiagnosisSettings) -> list[Calibrated]:
    surest, held = used.selection.most_sure, used.verdict
    told = [(one.verdict, p, right) for one in outcomes if one.kind in JUDGED for p, right in one.said]
    kinds = (
        ("selection", "most_sure", "named", surest, 1.0),
        ("verdict", "trust_if_open", "partial", held.trust_if_open, surest),
        ("verdict", "trust_if_wide_open", "none_of_catalogue", held.trust_if_wide_open, surest),
    )
    found = []
    for group, name, verdict, before, scale in kinds:
        # Names that have a rival are less sure by themselves.
        sure = [right for given, p, right in told if given == verdict and p >= before * scale - 0.01]
        found.append(_share(group, name, sure, before))
    return [one for one in found if one is not None]


def _classes(outcomes: Sequence[Outcome]) -> list[Calibrated]:
    sets = measure_class_sets(outcomes)
    if sets.odds is None:
        return []
    return [Calibrated("selection", "class_odds", sets.odds, sets.low, max(sets.high, sets.odds), sets.cases)]


def _share(group: str, name: str, right: Sequence[bool], before: float) -> Calibrated | None:
    if len(right) < LEAST_NAMES:
        return None
    found = share(right)
    assert found.low is not None
    assert found.high is not None
    value = (sum(right) + PRIOR_CASES * before) / (len(right) + PRIOR_CASES)
    return Calibrated(group, name, value, min(found.low, value), max(found.high, value), len(right))


def write_calibration(path: Path, report: BlindReport, used: DiagnosisSettings = USUAL) -> tuple[Calibrated, ...]:
    """Writes the settings that a check speaks for.

    Raises:
        InputError: Too few cases for any of them.
    """
    found = calibrate(report.outcomes, used)
    if not found:
        what = f"{len(report.outcomes)} cases say too little for any number; of classes {report.class_sets.words}"
        raise InputError(path, what, f"ask for --cases with {LEAST_HEALTHY} healthy arms or {LEAST_NAMES} names")
    groups: dict[str, dict[str, float]] = {}
    for one in found:
        groups.setdefault(one.group, {})[one.name] = float(f"{one.value:.4g}")
    origin: Mapping[str, Any] = {
        "seed": report.seed,
        "cases": len(report.outcomes),
        "worlds": str(report.run.get("worlds") or ""),
        "diagnosis": str(report.run.get("diagnosis") or ""),
        **({"class_odds": report.class_sets.words} if report.class_sets.odds is None else {}),
        "numbers": [one.to_dict() for one in found],
    }
    with atomic_write(path) as part:
        part.write_text(f"{WRITTEN_BY}\n{tomli_w.dumps({ORIGIN: origin, **groups})}", encoding="utf-8")
    return found
