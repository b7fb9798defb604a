"""The page that sets the paper's plans beside ours."""

from pathlib import Path

import pytest

from ident.progress import listening
from plan.command_options import PaperOptions, SolveOptions
from plan.paper import repeat as experiments
from plan.paper.progress import all_searches
from plan.paper.repeat import PAPER, Line, Repeat, _details, repeat_paper, write_page
from plan.planners.base import Planner
from plan.problem.certificate import certify
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.compare import Comparison
from plan.solving.solve import solve
from tests.plan.worlds import problem


def test_the_page_tells_both_and_what_is_missing(tmp_path: Path) -> None:
    """Paper's and our figures stand side by side, a failed trial says so, and every picture named is there."""
    task = problem()
    result = solve(task, SolveOptions(method="reference", gap=False))
    failed = Line("RL", "s", (1.25, 1.10), (0.5, float("inf")), 2.0)
    details = _details("ga", task.vias, 4.25, 0.125)
    searched, first = Line("sqp", "J", (), (3.0,), 1.0), Line("GA", "J", (), (3.0,), 1.0, details)
    tables = {"Table 6": [failed], "Fig. 10": [searched], "Table 3": [first]}
    compared = Comparison("fig. 10 of a$x^{$b", "energy", 100, 1.0, (result,))
    motions = {"figure_11": (task, result), "figure_13_6": (task, result)}
    repeat = Repeat(None, PaperOptions(epochs=7), tables, motions, compared)
    page = write_page(repeat, tmp_path)
    text = page.read_text()
    assert "1.25, 1.10 | 1.18 | 0.50, no plan | 0.50 | 2.0" in text
    assert "7 of 500 epochs" in text
    assert "## Table 6\n\n| | paper" in text
    assert "|\n\n| | paper | ours |\n" in text
    assert "\n\n\n" not in text
    assert "can't be repeated" in text
    assert "(72.4, 22.9, -98.6) deg; 417 s; gain 10.5 %" in text
    assert "deg; 4.25 s; gain 12.5 %" in text
    for name in ("figure_10.png", "figure_11.png", "figure_13_6.png"):
        assert f"({name})" in text
        assert (tmp_path / name).is_file()
    assert "figure_13_7" not in text


def test_what_is_told_of_progress_is_what_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: every search that is run was reckoned with, in its turn, and at the last one nothing is left."""
    effort = PaperOptions(epochs=10, generations=2, trials=1, levels=2)
    run: list[Planner] = []

    def stand_still(task: PlanningProblem, options: SolveOptions, planner: Planner, starts: object) -> PlanResult:
        """The initial motion, taken for a plan."""
        run.append(planner)
        splines = task.decode(task.initial)
        given = {"method": planner.name, "seed": options.seed, "objective": task.objective, "metric": task.metric}
        return PlanResult("solved", **given, splines=splines, certificate=certify(task, splines))

    monkeypatch.setattr(experiments, "solve", stand_still)
    heard: list[tuple[str, float]] = []
    with listening(lambda words, share, left: heard.append((words, share))):
        repeat_paper(None, effort)
    assert run == list(all_searches(effort))
    assert [words for words, _ in heard[:3]] == ["Table 3: brute", "Table 3: ga", "Table 3: ppo"]
    shares = [share for _, share in heard]
    assert shares == sorted(shares)
    assert len(set(shares)) == len(run)


@pytest.mark.slow
def test_every_table_is_run_again() -> None:
    """With little effort all of Tables 3 to 7 and Figs. 10 and 11 have rows, and brute force lies below the start."""
    found = repeat_paper(None, PaperOptions(epochs=25, generations=5, trials=1, levels=4))
    assert set(found.tables) == {"Table 3", "Table 4", "Table 5", "Table 6", "Table 7", "Fig. 10", "Fig. 11"}
    first = {line.name: line.ours[0] for line in found.tables["Table 3"]}
    assert first["brute force"] <= first["initial"] + 1e-9
    assert PAPER["brute"] == (45.46,)
