"""Starts over processes: the same starts, the best of all, every second counted."""

from pathlib import Path

import pytest

from ident.errors import InputError
from plan.api.planning import solve
from plan.planners.sequential import Sequential

TASK = Path(__file__).parents[1] / "data" / "table3.toml"


def test_two_processes_find_what_one_does() -> None:
    """The starts are shared out, so the best is as good; evaluations and processor time of all are told."""
    planner = Sequential(starts=4, more=0, levels=(1, 1))
    alone = solve(TASK, planner=planner, gap=False)
    shared = solve(TASK, planner=planner, gap=False, workers=2)
    assert shared.cost == pytest.approx(alone.cost, rel=0.01)
    assert {record["label"] for record in shared.starts} == {record["label"] for record in alone.starts}
    assert shared.evaluations > alone.evaluations / 2
    assert shared.cpu_seconds > 0.05
    again = solve(TASK, planner=planner, gap=False, workers=2)
    assert again.cost == shared.cost


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"workers": 0}, "give 1 to 64"),
        ({"workers": 2, "method": "cma"}, "use --method sqp"),
        ({"workers": 2, "resume": Path("none.npz")}, "keeps no checkpoint"),
    ],
)
def test_what_can_not_be_shared_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        solve(TASK, **options)
