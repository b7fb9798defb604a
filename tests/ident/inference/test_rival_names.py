"""Which of rival effects, chosen in different sets, are names."""

from types import SimpleNamespace
from typing import Any

from ident.inference.conclusion import _consistent


def effect(name: str, rivals: list[str]) -> Any:
    """An effect that another set chose, with those that explain the same."""
    group = SimpleNamespace(effect=SimpleNamespace(id=name), joint=0)
    return SimpleNamespace(solution=object(), coarse=SimpleNamespace(key=name), rivals=rivals, group=group)


def estimate(name: str, probability: float, odds: dict[str, float]) -> Any:
    """Its probability, and its odds against others that one set weighed beside it."""
    group = SimpleNamespace(effect=SimpleNamespace(id=name), joint=0)
    return SimpleNamespace(class_probability=probability, group=group, odds=odds, places={})


def test_what_explains_more_than_every_rival_stands_alone() -> None:
    """Law: an effect takes its rivals' place if it is likelier than each; who they hid, it hides."""
    described = [effect("a", []), effect("b", []), effect("c", ["a", "b"]), effect("d", ["a"])]
    estimates = [
        estimate("a", 0.99, {}),
        estimate("b", 0.98, {}),
        estimate("c", 0.97, {"a": 3.0, "b": 2.0}),
        estimate("d", 0.975, {"a": 0.5}),
    ]
    names, hidden = _consistent(described, estimates)
    assert names == [2]
    assert hidden == {0: 2, 1: 2, 3: 2}


def test_what_one_rival_beats_is_no_name() -> None:
    """Law: an effect that explains less than any of its rivals among the names is hidden by that
    one, however much more than another it explains.
    """
    described = [effect("a", []), effect("b", []), effect("c", ["a", "b"])]
    estimates = [
        estimate("a", 0.99, {}),
        estimate("b", 0.98, {}),
        estimate("c", 0.97, {"a": 3.0, "b": 0.5}),
    ]
    names, hidden = _consistent(described, estimates)
    assert names == [0, 1]
    assert hidden == {2: 1}
