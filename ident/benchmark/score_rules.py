"""Rules of the scores of `ident.blind/1`: of which cases, of what in them, how it is summed up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ident.benchmark.scores import Score, mean, share
from ident.benchmark.scoring import Outcome

Choice = Callable[[Outcome], bool]
"""Whether a score is of a case."""

Rules = Mapping[str, tuple[Choice, Callable[[Sequence[Any]], Score], Callable[[Outcome], Any]]]
"""By a score's name its cases, what sums their values up, and a case's value; None is left out."""

# An edit test is passed where the error is at most this multiple of the oracle's.
EDIT_WITHIN = 1.1


def is_single(case: Outcome) -> bool:
    """Cases of one effect."""
    return case.kind == "single"


def is_visible(case: Outcome) -> bool:
    """Single effects of one noise floor or more, in rich motion: the cases of the headline."""
    return is_single(case) and case.rich and case.amplitude >= 1.0


def is_small(case: Outcome) -> bool:
    """Single effects of less than one noise floor, in rich motion."""
    return is_single(case) and case.rich and case.amplitude < 1.0


def is_set(case: Outcome) -> bool:
    """Cases of several effects."""
    return case.kind in ("pair", "triple")


def is_refusable(case: Outcome) -> bool:
    """Cases whose cause no catalogue holds."""
    return case.kind in ("excluded", "outside")


def is_healthy(case: Outcome) -> bool:
    """Arms with nothing wrong."""
    return case.kind == "healthy"


def is_decoy(case: Outcome) -> bool:
    """Arms that differ from their URDF as every arm does."""
    return case.kind == "decoy"


def is_without(case: Outcome) -> bool:
    """Cases without an effect."""
    return is_healthy(case) or is_decoy(case)


def every(case: Outcome) -> bool:
    """All cases."""
    return True


def extra_names(case: Outcome) -> int | None:
    """Names beside the first; None without a name."""
    return len(case.named) - 1 if case.named else None


def holds_truth(case: Outcome) -> bool | None:
    """Whether the true effect is in the first name's class; None without a name."""
    return None if case.class_size is None else case.class_aware


def told_gap(case: Outcome) -> bool | None:
    """Whether an arm is told to have a gap; None where its links' masses are as good as one."""
    return None if case.urdf_wrong else case.verdict != "no_gap"


def is_edited_well(case: Outcome) -> bool:
    """Whether the edited model is as good as an oracle's, or nearly."""
    return (case.edit or {})["edited"] <= EDIT_WITHIN


def name_rules(chosen: Choice) -> Rules:
    """Scores of the names of single effects.

    Args:
        chosen: Which of these cases.
    """
    return {
        "strict": (chosen, share, lambda case: case.strict),
        "class_aware": (chosen, share, lambda case: case.class_aware),
        "joint": (chosen, share, lambda case: case.joint),
        "mean_class_size": (chosen, mean, lambda case: case.class_size),
        "extra_names": (chosen, mean, extra_names),
        "unnamed": (chosen, share, lambda case: not case.named),
    }


def headline_rules() -> Rules:
    """Scores of a check."""
    return {
        **name_rules(is_visible),
        "class_aware_small": (is_small, share, lambda case: case.class_aware),
        "class_holds": (is_single, share, holds_truth),
        "class_size": (is_single, mean, lambda case: case.class_size),
        "companion": (is_visible, share, lambda case: case.has_companion),
        "false_alarm": (is_healthy, share, lambda case: case.has_false_name),
        "false_alarm_decoy": (is_decoy, share, lambda case: case.has_false_name),
        "told_gap": (is_healthy, share, told_gap),
        "refusal": (is_refusable, share, lambda case: case.refused),
        "wrongly_named": (is_refusable, share, lambda case: case.verdict == "named"),
        "set_f1": (is_set, mean, lambda case: case.set_f1),
        "shrink_vs_oracle": (is_visible, mean, lambda case: case.shrink_share),
        "seconds_per_case": (every, mean, lambda case: case.seconds),
    }


def world_rules() -> Rules:
    """What is counted of simulated arms: names of single effects, and false alarms of healthy ones.

    Returns:
        By the score's name: whether a case counts, how cases are averaged, and a case's value.
    """
    headline = headline_rules()
    names = ("strict", "class_aware", "joint", "companion")
    return {
        **{name: headline[name] for name in names},
        "false_alarm": (is_without, share, lambda case: case.has_false_name),
        "told_gap": (is_without, share, told_gap),
    }


def edit_rules() -> Rules:
    """The score of models from which a named cause was taken out."""
    return {"edit": (lambda case: case.edit is not None, share, is_edited_well)}


def method_rules(method: str) -> Rules:
    """Scores of a plain method, which has neither probabilities nor verdicts."""

    def names(case: Outcome) -> Sequence[tuple[str, str]]:
        return case.rivals.get(method, ())

    def first(case: Outcome) -> tuple[str, str]:
        return next(iter(names(case)), ("", ""))

    def f1(case: Outcome) -> float:
        hits = set(names(case)) & set(case.truth)
        return 2.0 * len(hits) / (len(names(case)) + len(case.truth))

    return {
        "strict": (is_visible, share, lambda case: first(case)[0] == case.truth[0][0]),
        "joint": (is_visible, share, lambda case: case.truth[0][1] in ("", first(case)[1])),
        "false_alarm": (is_healthy, share, lambda case: bool(names(case))),
        "false_alarm_decoy": (is_decoy, share, lambda case: bool(names(case))),
        "refusal": (is_refusable, share, lambda case: not names(case)),
        "set_f1": (is_set, mean, f1),
    }


def measure(cases: Iterable[Outcome], rules: Rules) -> dict[str, Score]:
    """The scores of a table of rules.

    A case of which a score says nothing (None) is left out of it.
    """
    every_case = list(cases)
    scores = {}
    for name, (chosen, summarise, value) in rules.items():
        values = [value(case) for case in every_case if chosen(case)]
        scores[name] = summarise([figure for figure in values if figure is not None])
    return scores
