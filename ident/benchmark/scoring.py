"""Third step of a case: what was reported against what was true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.benchmark.cases import Slot
from ident.benchmark.scores import is_inside
from ident.benchmark.truth import (
    EXCUSED_BY_URDF,
    comparable,
    match_truth,
    may_stand_at,
    name_joint,
    urdf_is_wrong,
    visible_amplitude,
)
from ident.diagnosis.verdict import above_noise
from ident.inference.conclusion import EVEN_ODDS
from ident.records import JsonRecord, JsonTable
from ident.simulation.request import Answer, TrueEffect

REFUSING = ("none_of_catalogue", "partial")
# A name at this probability or above is confident.
CONFIDENT = 0.8


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
        matches = [match_truth(finding, answer) for finding in findings]
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
        amplitude=visible_amplitude(slot, answer),
        rich=slot.rich,
        truth=tuple((effect.effect, name_joint(effect)) for effect in answer.effects),
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
        refused = may_stand_at(only, joints_told(record), answer)
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


def _with_first_name(
    case: Outcome, first: JsonTable, only: TrueEffect | None, answer: Answer
) -> Outcome:
    """The outcome with the size of the first name's class and, where one effect was hidden alone,
    whether that name is it, whether its class holds it, and whether its joints are right.

    Args:
        case: The outcome so far.
        first: The first name, a finding of the diagnosis.
        only: The effect that was hidden alone; None where it was none or several.
        answer: The truth of the case.
    """
    case = replace(case, class_size=len(first["class"]))
    if only is None:
        return case
    return replace(
        case,
        strict=first["effect"] == only.effect,
        class_aware=only.effect in first["class"],
        joint=may_stand_at(only, first["joints"], answer),
    )


def joints_told(record: JsonTable) -> list[str]:
    """The joint of the largest gap, and those of the first name."""
    leftover = record.get("leftover", {})
    sizes = {}
    for joint, gap in record["gap"].items():
        sizes[joint] = _gap_size(gap, is_unexplained=leftover.get(joint, 0.0) >= EVEN_ODDS)
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
