"""Third step of a case: what was reported against what was true; scores with intervals.

Source: Wilson 1927 (shares); Hanley and McNeil 1982 (area under the curve).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.benchmark.cases import Slot
from ident.diagnosis.verdict import above_noise
from ident.effects import optional
from ident.effects.catalogue import CATALOGUE
from ident.simulation.request import Answer, TrueEffect

Z = 1.959964
RESAMPLES = 2000
BINS = 10
REFUSING = ("none_of_catalogue", "partial")
# A name at this probability or above is confident.
CONFIDENT = 0.8
# An effect of several joints shows at those whose visible amplitude is at least this share of the
# largest.
SHOWN_SHARE = 1.0 / 3.0
# Causes outside the catalogue are none of these.
KNOWN = {effect.id: effect for effect in CATALOGUE}
# Beyond these a URDF is wrong rather than imprecise: that links weigh something else is then true
# [1], [m].
WRONG_LINK_ERROR = 0.08
WRONG_COM_M = 0.008
# Names that are true of an arm whose URDF is wrong, whatever else was hidden in it.
EXCUSED_BY_URDF = tuple(effect.id for effect in CATALOGUE if effect.as_change.body)


@dataclass(frozen=True)
class Score:
    """A share or mean with its 95 % interval and the number of cases behind it.

    None if no case speaks of it.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None
    count: int = 0


def share(hits: Iterable[bool]) -> Score:
    """Share of hits with Wilson's 95 % interval; empty without cases."""
    found = [bool(hit) for hit in hits]
    n = len(found)
    if n == 0:
        return Score()
    p = sum(found) / n
    centre = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
    reach = Z / (1 + Z**2 / n) * float(np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2)))
    return Score(p, max(centre - reach, 0.0), min(centre + reach, 1.0), n)


def mean(values: Sequence[float]) -> Score:
    """Mean with the 95 % percentile interval of a bootstrap over cases; empty without cases."""
    if len(values) == 0:
        return Score()
    x = np.asarray(values, dtype=float)
    draws = x[np.random.default_rng(0).integers(len(x), size=(RESAMPLES, len(x)))].mean(axis=1)
    return Score(float(x.mean()), *_ends(draws), len(x))


def _ends(draws: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Percentile interval of a bootstrap."""
    return float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975))


def auroc(positive: Sequence[float], negative: Sequence[float]) -> Score:
    """Probability that a positive case scores above a negative one, ties counting half."""
    n = len(positive)
    m = len(negative)
    if not n or not m:
        return Score()
    difference = np.subtract.outer(
        np.asarray(positive, dtype=float), np.asarray(negative, dtype=float)
    )
    area = float(np.mean((difference > 0.0) + 0.5 * (difference == 0.0)))
    q1 = area / (2.0 - area)
    q2 = 2.0 * area**2 / (1.0 + area)
    variance = area * (1.0 - area) + (n - 1) * (q1 - area**2) + (m - 1) * (q2 - area**2)
    reach = Z * float(np.sqrt(max(variance, 0.0) / (n * m)))
    return Score(area, max(area - reach, 0.0), min(area + reach, 1.0), n + m)


def calibration_curve(
    said: Sequence[float], right: Sequence[bool], bins: int = BINS
) -> list[tuple[float, float, float, Score]]:
    """Bins of equal width that hold anything.

    Their bounds, the mean of what was said, and how often it was right.
    """
    p = np.asarray(said, dtype=float)
    hit = np.asarray(right, dtype=bool)
    which = np.minimum((p * bins).astype(int), bins - 1)
    return [
        (k / bins, (k + 1) / bins, float(p[which == k].mean()), share(hit[which == k]))
        for k in map(int, np.unique(which))
    ]


def calibration_error(said: Sequence[float], right: Sequence[bool]) -> Score:
    """Expected calibration error.

    Mean distance of probability and share right, weighted by the number of names.
    """
    n = len(said)
    if n == 0:
        return Score()
    p = np.asarray(said, dtype=float)
    which = np.minimum((p * BINS).astype(int), BINS - 1)
    over = p - np.asarray(right, dtype=bool)
    draws = np.random.default_rng(0).integers(n, size=(RESAMPLES // 10, n))
    value, *errors = (
        float(np.abs(np.bincount(which[rows], over[rows])).sum() / n)
        for rows in (np.arange(n), *draws)
    )
    return Score(value, *_ends(errors), n)


def is_inside(parameter: str, true: float, low: float, high: float) -> bool:
    """Whether an interval holds a true parameter; a phase is one whatever turns are added to it."""
    if parameter == "phase_rad":
        away = np.angle(np.exp(1j * (true - 0.5 * (low + high))))
        return bool(abs(away) <= 0.5 * (high - low) + 1e-9)
    slack = 1e-6 * abs(true)
    return low - slack <= true <= high + slack


@dataclass(frozen=True)
class Outcome:
    """One case, scored."""

    name: str
    kind: str
    amplitude: float  # visible amplitude [noise floors]
    rich: bool  # whether its motion is rich
    # True effects as (id, joint); the joint is empty for the whole arm.
    truth: tuple[tuple[str, str], ...]
    verdict: str  # of the diagnosis; `failed` if it failed
    named: tuple[
        tuple[str, tuple[str, ...], float], ...
    ] = ()  # names given, as (id, joints, probability)
    strict: bool = False  # whether the first name is the true effect (single effects)
    class_aware: bool = False  # whether the true effect is in the first name's class
    joint: bool = False  # whether the first name is at the true joint
    class_size: int | None = None  # of the first name's class; None without a name
    refused: bool = (
        False  # whether it says that the catalogue does not hold the cause, at the right joint
    )
    set_f1: float | None = None  # of all names with their joints against the truth
    shrink_share: float | None = (
        None  # held-out closing over that of the true name alone; None if that closes nothing
    )
    # True parameters of all true names: each with its effect, the reported value and interval,
    # whether that holds it.
    coverage: tuple[dict[str, Any], ...] = ()
    right: tuple[bool, ...] = ()  # whether each name is true
    excused: tuple[
        bool, ...
    ] = ()  # whether it is true of the world, though nothing of the kind was hidden
    # Names of the plain methods.
    rivals: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    seconds: float | None = None  # time of the diagnosis
    error: str = ""  # what went wrong, if it failed
    # That it was drawn in; empty without one.
    world: Mapping[str, Any] = field(default_factory=dict)
    refusal_score: float | None = (
        None  # how sure it is that the catalogue lacks the cause; None if nothing is fitted
    )
    oracle: float | None = (
        None  # probability that an oracle names the effect; None where it was not worked out
    )
    # Held-out error on the arm without the cause over an oracle's, by model: `edited`, the patched
    # model less the cause; `tuned`, nothing named; `unedited`. None without a test.
    edit: Mapping[str, float] | None = None
    robot: str = ""
    joints: tuple[str, ...] = ()

    @property
    def urdf_wrong(self) -> bool:
        """Whether links of its world's arm weigh something else than any tolerance allows."""
        return urdf_is_wrong(self.world)

    @property
    def judged(self) -> list[tuple[str, float, bool]]:
        """Effect, probability and truth of each name that is true or false."""
        excused = self.excused or (False,) * len(self.right)
        names = zip(self.named, self.right, excused, strict=True)
        return [(effect, p, right) for (effect, _, p), right, free in names if right or not free]

    @property
    def has_false_name(self) -> bool:
        """Whether a name is false that is not excused."""
        return any(not right for _, _, right in self.judged)

    @property
    def has_companion(self) -> bool:
        """Whether a false name stands beside a true one."""
        return any(self.right) and self.has_false_name

    @property
    def confidently_wrong(self) -> bool:
        """Whether a name that is not true was given with confidence."""
        return self.verdict in ("named", "partial") and any(
            p >= CONFIDENT for _, p, right in self.judged if not right
        )

    def to_dict(self) -> dict[str, Any]:
        """Its record, for JSON."""
        record = {
            key: value for key, value in vars(self).items() if key not in ("coverage", "rivals")
        }
        return {**record, "coverage": list(self.coverage)}

    def to_row(self) -> dict[str, Any]:
        """Numbers and words of the case and of its world, for a table with a row a case."""
        flat = {
            key: value
            for key, value in vars(self).items()
            if value is None or isinstance(value, str | int | float)
        }
        return {**flat, **{f"world.{key}": value for key, value in self.world.items()}}


def score_case(
    slot: Slot, answer: Answer, result: Mapping[str, Any], starts: Sequence[float] = ()
) -> Outcome:
    """Scores a case by its opened answer.

    `starts` are the session times at which its runs start [s].
    """
    # Visible amplitude [noise floors]: of single effects as it was asked for, of others as
    # measured.
    seen = [
        float(f"{max(_shares(one, answer).values(), default=0.0):.2g}") for one in answer.effects
    ]
    case = Outcome(
        name=slot.name,
        kind=slot.kind,
        amplitude=slot.amplitude if slot.kind == "single" else max(seen, default=0.0),
        rich=slot.rich,
        truth=tuple((effect.effect, _joint_of(effect)) for effect in answer.effects),
        verdict="failed",
        error=result.get("error", ""),
        robot=answer.robot,
    )
    if "error" in result:
        return case
    record = result["diagnosis"]
    findings = record["findings"]
    matches = [
        next((effect for effect in answer.effects if is_true(effect, f, answer)), None)
        for f in findings
    ]
    free = EXCUSED_BY_URDF if urdf_is_wrong(answer.world) else ()
    # A wrong URDF has links of its own to be named; a class that holds what was planted beside is
    # no such name.
    planted = {effect.effect for effect in answer.effects}
    excused = [
        match is None and f["effect"] in free and not planted & {*f["class"][1:]}
        for match, f in zip(matches, findings, strict=True)
    ]
    counted = [f for f, free in zip(findings, excused, strict=True) if not free]
    only = answer.effects[0] if len(answer.effects) == 1 else None
    if counted:
        first = counted[0]
        case = replace(case, class_size=len(first["class"]))
        if only:
            strict = first["effect"] == only.effect
            classed = only.effect in first["class"]
            case = replace(
                case,
                strict=strict,
                class_aware=classed,
                joint=_is_at(only, first["joints"], answer),
            )
    covers = []  # parameters that both report by the same name
    for true, finding in zip(matches, findings, strict=True):
        for name, value in comparable(true, starts).items() if true else ():
            given = finding["parameters"].get(name, {})
            reported = {
                key: float(given[key])
                for key in ("value", "low", "high")
                if given.get(key) is not None
            }
            if len(reported) == 3:
                inside = is_inside(name, value, reported["low"], reported["high"])
                covers.append(
                    {
                        "effect": finding["effect"],
                        "parameter": name,
                        "true": value,
                        **reported,
                        "inside": inside,
                    }
                )
    # Harmonic mean of precision and recall; a cause that is named at both of its joints is found
    # once.
    hits = sum(match is not None for match in matches)
    found = len({id(one) for one in matches if one is not None})
    precision = hits / max(len(counted), 1)
    recall = found / max(len(answer.effects), 1)
    f1 = 2.0 * precision * recall / (precision + recall) if counted and found else 0.0
    return replace(
        case,
        verdict=record["verdict"],
        named=tuple((f["effect"], tuple(f["joints"]), float(f["probability"])) for f in findings),
        refused=record["verdict"] in REFUSING
        and bool(only and _is_at(only, joints_told(record), answer)),
        set_f1=f1 if answer.effects else None,
        shrink_share=_shrink_share(case.truth, result.get("heldout"), record["joints"], answer),
        coverage=tuple(covers),
        right=tuple(one is not None for one in matches),
        rivals={
            method: tuple((e, j) for e, j in names)
            for method, names in result.get("rivals", {}).items()
        },
        seconds=result.get("seconds"),
        world=answer.world,
        excused=tuple(excused),
        refusal_score=None
        if record.get("outside_score") is None
        else float(record["outside_score"]),
        joints=tuple(record["joints"]),
    )


def urdf_is_wrong(world: Mapping[str, Any]) -> bool:
    """Whether links of a world's arms weigh something else than any tolerance allows."""
    if not world:
        return False
    return bool(
        world["link_error"] > WRONG_LINK_ERROR
        or world["com_error_m"] > WRONG_COM_M
        or world["copied_link"]
    )


def _shares(effect: TrueEffect, answer: Answer) -> dict[str, float]:
    """Its visible amplitude at each joint [noise floors]."""
    return {
        joint: value / max(answer.noise_floor_Nm[joint], 1e-12)
        for joint, value in effect.visible_Nm.items()
    }


def _joint_of(effect: TrueEffect) -> str:
    """Its joint; none where a diagnosis names it without one, even where the cause has one (a push
    at a link).
    """
    whole = effect.effect in KNOWN and KNOWN[effect.effect].scope == "arm"
    return "" if whole or not effect.joints else effect.joints[0]


def shown_joints(effect: TrueEffect, answer: Answer) -> list[str]:
    """Joints at which an effect is visible."""
    seen = _shares(effect, answer)
    least = SHOWN_SHARE * max(seen.values(), default=0.0)
    return [joint for joint, value in seen.items() if value >= least] or list(answer.noise_floor_Nm)


def is_true(true: TrueEffect, finding: Mapping[str, Any], answer: Answer) -> bool:
    """Whether a name is that of a true effect, at a joint where it may stand."""
    same = bool(true.effect == finding["effect"])
    return same and (not _joint_of(true) or _is_at(true, finding["joints"], answer))


def _is_at(true: TrueEffect, joints: Sequence[str], answer: Answer) -> bool:
    """Whether a name for an effect may stand there.

    At its own joint, or where it shows; either of a coupled pair.
    """
    own = _joint_of(true)
    other = (
        true.parameters.get(KNOWN[true.effect].partner if true.effect in KNOWN else "")
        if own
        else None
    )
    allowed = [own, str(other or own)] if own else shown_joints(true, answer)
    return any(joint in joints for joint in allowed)


def joints_told(record: Mapping[str, Any]) -> list[str]:
    """The joint of the largest gap, and those of the first name.

    A gap is what exceeds the noise, by much or significantly, or what had to be tuned away.
    """

    def size(joint: str, one: Mapping[str, Any]) -> float:
        """Size of a joint's gap [noise floors]."""
        unexplained = record.get("leftover", {}).get(joint, 0.0) > 1.0
        left = one["rms_Nm"] if unexplained or above_noise(one) else 0.0
        return float(
            max(left, one.get("tuned_away_Nm") or 0.0) / max(one["noise_floor_Nm"] or 0.0, 1e-12)
        )

    gap = {joint: size(joint, one) for joint, one in record["gap"].items()}
    where = [max(gap, key=lambda j: gap[j])] if gap else []
    if record["findings"]:
        where += record["findings"][0]["joints"]
    return where


def _shrink_share(
    truth: Sequence[tuple[str, str]],
    heldout: Mapping[str, Any] | None,
    joints: Sequence[str],
    answer: Answer,
) -> float | None:
    """Closing of the diagnosis over that of an oracle, in squared noise floors over all joints,
    between 0 and 1.
    """
    alone = heldout["alone"].get(":".join(truth[0])) if heldout and len(truth) == 1 else None
    if heldout is None or alone is None:
        return None
    floor = np.array([answer.noise_floor_Nm[joint] for joint in joints])
    view = heldout[alone["view"]]
    before, oracle, ours = (
        np.square(np.array(rms) / floor) for rms in (view["none"], alone["rms"], view["named"])
    )
    most = float(np.sum(before - oracle))
    return float(np.clip(np.sum(before - ours) / most, 0.0, 1.0)) if most > 0.0 else None


def comparable(true: TrueEffect, starts: Sequence[float]) -> dict[str, float]:
    """True parameters in the conventions of the diagnosis."""
    return (
        optional.simulated_answer(KNOWN[true.effect], true.parameters, starts)
        if true.effect in KNOWN
        else {}
    )
