"""Third step of a case: what was reported against what was true; scores with intervals.

Source: Wilson 1927 (shares); Hanley and McNeil 1982 (area under the curve).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import Array, Float, Int
from ident.benchmark.cases import Slot
from ident.diagnosis.verdict import above_noise
from ident.effects import optional
from ident.effects.catalogue import CATALOGUE
from ident.records import JsonRecord, JsonTable
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
    outcomes = [bool(hit) for hit in hits]
    n = len(outcomes)
    if n == 0:
        return Score()
    p = sum(outcomes) / n
    shrink = 1 + Z**2 / n
    centre = (p + Z**2 / (2 * n)) / shrink
    reach = Z / shrink * float(np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2)))
    return Score(p, max(centre - reach, 0.0), min(centre + reach, 1.0), n)


def mean(values: Sequence[float]) -> Score:
    """Mean with the 95 % percentile interval of a bootstrap over cases; empty without cases."""
    count = len(values)
    if count == 0:
        return Score()
    cases = np.asarray(values, dtype=float)
    drawn = np.random.default_rng(0).integers(count, size=(RESAMPLES, count))
    means = cases[drawn].mean(axis=1)
    return Score(float(cases.mean()), *_ends(means), count)


def _ends(draws: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Percentile interval of a bootstrap."""
    return float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975))


def auroc(positive: Sequence[float], negative: Sequence[float]) -> Score:
    """Probability that a positive case scores above a negative one, ties counting half."""
    n = len(positive)
    m = len(negative)
    if not n or not m:
        return Score()
    scores = np.asarray(positive, dtype=float)
    other_scores = np.asarray(negative, dtype=float)
    difference = np.subtract.outer(scores, other_scores)
    area = float(np.mean((difference > 0.0) + 0.5 * (difference == 0.0)))
    # Probability that two positive cases score above a negative one, and one above two.
    two_positive = area / (2.0 - area)
    two_negative = 2.0 * area**2 / (1.0 + area)
    between_positive = (n - 1) * (two_positive - area**2)
    between_negative = (m - 1) * (two_negative - area**2)
    variance = area * (1.0 - area) + between_positive + between_negative
    reach = Z * float(np.sqrt(max(variance, 0.0) / (n * m)))
    return Score(area, max(area - reach, 0.0), min(area + reach, 1.0), n + m)


def calibration_curve(
    said: Sequence[float], right: Sequence[bool], bins: int = BINS
) -> list[tuple[float, float, float, Score]]:
    """How often names of about one probability are right, in bins of equal width.

    Args:
        said: Probability of each name, 0 to 1.
        right: Whether it was.
        bins: How many.

    Returns:
        For each bin that holds any: its bounds, the mean of what was said, and the share right.
    """
    p = np.asarray(said, dtype=float)
    hit = np.asarray(right, dtype=bool)
    bin_of_name = _bin_of(p, bins)
    curve = []
    for k in map(int, np.unique(bin_of_name)):
        inside = bin_of_name == k
        curve.append((k / bins, (k + 1) / bins, float(p[inside].mean()), share(hit[inside])))
    return curve


def _bin_of(p: Float[Array, " k"], bins: int) -> Int[Array, " k"]:
    """Number of the bin of equal width that each probability falls into."""
    return np.minimum((p * bins).astype(int), bins - 1)


def calibration_error(said: Sequence[float], right: Sequence[bool]) -> Score:
    """Expected calibration error.

    Mean distance of probability and share right, weighted by the number of names.
    """
    n = len(said)
    if n == 0:
        return Score()
    p = np.asarray(said, dtype=float)
    bin_of_name = _bin_of(p, BINS)
    over = p - np.asarray(right, dtype=bool)

    def error(names: Int[Array, " n"]) -> float:
        """That of some names, each as often as it is drawn."""
        distances = np.abs(np.bincount(bin_of_name[names], over[names]))
        return float(distances.sum() / n)

    draws = np.random.default_rng(0).integers(n, size=(RESAMPLES // 10, n))
    resampled = [error(names) for names in draws]
    return Score(error(np.arange(n)), *_ends(resampled), n)


def is_inside(parameter: str, true: float, low: float, high: float) -> bool:
    """Whether an interval holds a true parameter; a phase is one whatever turns are added to it."""
    if parameter == "phase_rad":
        away = np.angle(np.exp(1j * (true - 0.5 * (low + high))))
        return bool(abs(away) <= 0.5 * (high - low) + 1e-9)
    slack = 1e-6 * abs(true)
    return low - slack <= true <= high + slack


@dataclass(frozen=True)
class Outcome:
    """One case, scored.

    Attributes:
        name: The case.
        kind: Its kind.
        amplitude: Visible amplitude [noise floors].
        rich: Whether its motion is rich.
        truth: True effects as (id, joint); the joint is empty for the whole arm.
        verdict: Of the diagnosis; `failed` if it failed.
        named: Names given, as (id, joints, probability).
        strict: Whether the first name is the true effect (single effects).
        class_aware: Whether the true effect is in the first name's class.
        joint: Whether the first name is at the true joint.
        class_size: Of the first name's class; None without a name.
        refused: Whether it says that the catalogue does not hold the cause, at the right joint.
        set_f1: Of all names with their joints against the truth.
        shrink_share: Held-out closing over that of the true name alone; None if that closes
            nothing.
        coverage: True parameters of all true names: each with its effect, the reported value and
            interval, whether that holds it.
        right: Whether each name is true.
        excused: Whether it is true of the world, though nothing of the kind was hidden.
        rivals: Names of the plain methods.
        seconds: Time of the diagnosis.
        error: What went wrong, if it failed.
        world: That it was drawn in; empty without one.
        refusal_score: How sure it is that the catalogue lacks the cause; None if nothing is fitted.
        oracle: Probability that an oracle names the effect; None where it was not worked out.
        edit: Held-out error on the arm without the cause over an oracle's, by model: `edited`, the
            patched model less the cause; `tuned`, nothing named; `unedited`. None without a test.
        robot: The arm.
        joints: Its joints.
    """

    name: str
    kind: str
    amplitude: float
    rich: bool
    truth: tuple[tuple[str, str], ...]
    verdict: str
    named: tuple[tuple[str, tuple[str, ...], float], ...] = ()
    strict: bool = False
    class_aware: bool = False
    joint: bool = False
    class_size: int | None = None
    refused: bool = False
    set_f1: float | None = None
    shrink_share: float | None = None
    coverage: tuple[JsonRecord, ...] = ()
    right: tuple[bool, ...] = ()
    excused: tuple[bool, ...] = ()
    rivals: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    seconds: float | None = None
    error: str = ""
    world: JsonTable = field(default_factory=dict)
    refusal_score: float | None = None
    oracle: float | None = None
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
        if self.verdict not in ("named", "partial"):
            return False
        return any(p >= CONFIDENT for _, p, right in self.judged if not right)

    def to_dict(self) -> JsonRecord:
        """Its fields by their names, without "rivals"; "coverage" is a list."""
        record = {
            key: value for key, value in vars(self).items() if key not in ("coverage", "rivals")
        }
        return {**record, "coverage": list(self.coverage)}

    def to_row(self) -> JsonRecord:
        """Numbers and words of the case and of its world, for a table with a row a case."""
        plain = str | int | float
        row = {key: value for key, value in vars(self).items() if isinstance(value, plain | None)}
        return row | {f"world.{key}": value for key, value in self.world.items()}


@dataclass(frozen=True, eq=False)
class _JudgedNames:
    """The names of a case beside what was planted."""

    answer: Answer
    findings: Sequence[JsonTable]
    matches: Sequence[TrueEffect | None]  # the true effect that each name is of
    excused: Sequence[bool]  # whether it is true of the world, though nothing of it was hidden

    @classmethod
    def of(cls, findings: Sequence[JsonTable], answer: Answer) -> _JudgedNames:
        """The names of a diagnosis's record, judged.

        A wrong URDF has links of its own to be named; a class that holds what was planted beside is
        no such name.
        """
        free = EXCUSED_BY_URDF if urdf_is_wrong(answer.world) else ()
        planted = {effect.effect for effect in answer.effects}
        matches = [_match(finding, answer) for finding in findings]
        excused = []
        for match, finding in zip(matches, findings, strict=True):
            others = {*finding["class"][1:]}
            is_free = match is None and finding["effect"] in free and not planted & others
            excused.append(is_free)
        return cls(answer, findings, matches, excused)

    @property
    def counted(self) -> list[JsonTable]:
        """The names that are true or false."""
        pairs = zip(self.findings, self.excused, strict=True)
        return [finding for finding, free in pairs if not free]

    def set_f1(self) -> float | None:
        """Harmonic mean of precision and recall; None where nothing was planted.

        A cause that is named at both of its joints is found once.
        """
        if not self.answer.effects:
            return None
        true = [match for match in self.matches if match is not None]
        causes = {id(match) for match in true}
        if not causes or not self.counted:
            return 0.0
        precision = len(true) / max(len(self.counted), 1)
        recall = len(causes) / max(len(self.answer.effects), 1)
        return 2.0 * precision * recall / (precision + recall)

    def coverage(self, starts: Sequence[float]) -> list[JsonRecord]:
        """Parameters that both report by the same name, and whether the interval holds the true."""
        covers: list[JsonRecord] = []
        for true, finding in zip(self.matches, self.findings, strict=True):
            if true is None:
                continue
            for name, value in comparable(true, starts).items():
                reported = _reported(finding["parameters"].get(name, {}))
                if reported is None:
                    continue
                covers.append(
                    {
                        "effect": finding["effect"],
                        "parameter": name,
                        "true": value,
                        **reported,
                        "inside": is_inside(name, value, reported["low"], reported["high"]),
                    }
                )
        return covers


def _match(finding: JsonTable, answer: Answer) -> TrueEffect | None:
    """The true effect that a name is of; None if it is of none."""
    for effect in answer.effects:
        if is_true(effect, finding, answer):
            return effect
    return None


def _reported(interval: JsonTable) -> dict[str, float] | None:
    """Value and ends of a parameter's interval; None where one of them is missing."""
    reported = {}
    for key in ("value", "low", "high"):
        if interval.get(key) is None:
            return None
        reported[key] = float(interval[key])
    return reported


def score_case(
    slot: Slot, answer: Answer, result: JsonTable, starts: Sequence[float] = ()
) -> Outcome:
    """Scores a case by its opened answer.

    `starts` are the session times at which its runs start [s].
    """
    case = Outcome(
        name=slot.name,
        kind=slot.kind,
        amplitude=_visible_amplitude(slot, answer),
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
    judged = _JudgedNames.of(findings, answer)
    only = answer.effects[0] if len(answer.effects) == 1 else None
    if judged.counted:
        case = _with_first_name(case, judged.counted[0], only, answer)
    named = []
    for finding in findings:
        joints = tuple(finding["joints"])
        named.append((finding["effect"], joints, float(finding["probability"])))
    rivals: dict[str, tuple[tuple[str, str], ...]] = {}
    for method, names in result.get("rivals", {}).items():
        rivals[method] = tuple((effect, joint) for effect, joint in names)
    refused = False
    if record["verdict"] in REFUSING and only is not None:
        refused = _is_at(only, joints_told(record), answer)
    refusal_score = record.get("outside_score")
    return replace(
        case,
        verdict=record["verdict"],
        named=tuple(named),
        refused=refused,
        set_f1=judged.set_f1(),
        shrink_share=_shrink_share(case.truth, result.get("heldout"), record["joints"], answer),
        coverage=tuple(judged.coverage(starts)),
        right=tuple(match is not None for match in judged.matches),
        rivals=rivals,
        seconds=result.get("seconds"),
        world=answer.world,
        excused=tuple(judged.excused),
        refusal_score=None if refusal_score is None else float(refusal_score),
        joints=tuple(record["joints"]),
    )


def _visible_amplitude(slot: Slot, answer: Answer) -> float:
    """Visible amplitude of a case's effects [noise floors].

    Of single effects as it was asked for, of others as measured.
    """
    if slot.kind == "single":
        return slot.amplitude
    largest = [max(_shares(effect, answer).values(), default=0.0) for effect in answer.effects]
    return max([float(f"{amplitude:.2g}") for amplitude in largest], default=0.0)


def _with_first_name(
    case: Outcome, first: JsonTable, only: TrueEffect | None, answer: Answer
) -> Outcome:
    """The outcome with what the first name says of the only effect."""
    case = replace(case, class_size=len(first["class"]))
    if only is None:
        return case
    return replace(
        case,
        strict=first["effect"] == only.effect,
        class_aware=only.effect in first["class"],
        joint=_is_at(only, first["joints"], answer),
    )


def urdf_is_wrong(world: JsonTable) -> bool:
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


def is_true(true: TrueEffect, finding: JsonTable, answer: Answer) -> bool:
    """Whether a name is that of a true effect, at a joint where it may stand."""
    same = bool(true.effect == finding["effect"])
    return same and (not _joint_of(true) or _is_at(true, finding["joints"], answer))


def _is_at(true: TrueEffect, joints: Sequence[str], answer: Answer) -> bool:
    """Whether a name for an effect may stand there.

    At its joint, or where it shows; either of a coupled pair.
    """
    joint = _joint_of(true)
    allowed = [joint] if joint else shown_joints(true, answer)
    partner = KNOWN[true.effect].partner if true.effect in KNOWN else ""
    if joint and true.parameters.get(partner):
        allowed.append(str(true.parameters[partner]))
    return any(name in joints for name in allowed)


def joints_told(record: JsonTable) -> list[str]:
    """The joint of the largest gap, and those of the first name."""
    leftover = record.get("leftover", {})
    sizes = {}
    for joint, gap in record["gap"].items():
        sizes[joint] = _gap_size(gap, is_unexplained=leftover.get(joint, 0.0) > 1.0)
    where = [max(sizes, key=lambda joint: sizes[joint])] if sizes else []
    if record["findings"]:
        where += record["findings"][0]["joints"]
    return where


def _gap_size(gap: JsonTable, is_unexplained: bool) -> float:
    """Size of a joint's gap [noise floors].

    A gap is what exceeds the noise, by much or significantly, or what had to be tuned away.
    """
    left = gap["rms_Nm"] if is_unexplained or above_noise(gap) else 0.0
    tuned_away = gap.get("tuned_away_Nm") or 0.0
    floor = max(gap["noise_floor_Nm"] or 0.0, 1e-12)
    return float(max(left, tuned_away) / floor)


def _shrink_share(
    truth: Sequence[tuple[str, str]],
    heldout: JsonTable | None,
    joints: Sequence[str],
    answer: Answer,
) -> float | None:
    """Closing of the diagnosis over that of an oracle, in squared noise floors over all joints,
    between 0 and 1.
    """
    if heldout is None or len(truth) != 1:
        return None
    alone = heldout["alone"].get(":".join(truth[0]))
    if alone is None:
        return None
    floor = np.array([answer.noise_floor_Nm[joint] for joint in joints])
    view = heldout[alone["view"]]
    before = np.square(np.array(view["none"]) / floor)
    by_oracle = np.square(np.array(alone["rms"]) / floor)
    by_names = np.square(np.array(view["named"]) / floor)
    most = float(np.sum(before - by_oracle))
    if not most > 0.0:
        return None
    return float(np.clip(np.sum(before - by_names) / most, 0.0, 1.0))


def comparable(true: TrueEffect, starts: Sequence[float]) -> dict[str, float]:
    """True parameters in the conventions of the diagnosis."""
    if true.effect not in KNOWN:
        return {}
    return optional.simulated_answer(KNOWN[true.effect], true.parameters, starts)
