"""Files that `ident diagnose` writes beside its result: the page, and the timeline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from ident.api.diagnosing import Examined
from ident.api.fitting import evaluate
from ident.command_options import DiagnoseOptions, FilterOptions
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.evaluation import ReportInput
from ident.show.report.laws import draw_laws
from ident.show.report.traces import gather_traces


def write_diagnosis_page(
    path: Path, examined: Examined, sessions: Sequence[Path], options: DiagnoseOptions
) -> None:
    """The page of a diagnosis; with a model, with how well that foretells the recordings.

    Args:
        path: The file.
        examined: The diagnosis, with all that pages need.
        sessions: The recordings.
        options: How they were read.
    """
    result = examined.diagnosis.to_dict()
    analysis = examined.analysis
    if analysis is None:
        write_diagnosis_report(path, result, None, (), None)
        return
    evaluation = None
    model = examined.model
    if model is not None:
        names = [option.name for option in fields(FilterOptions)]
        reading = {name: getattr(options, name) for name in names}
        scored = evaluate(sessions, model, **reading)
        evaluation = ReportInput((model,), (scored,), ())
    pictures = draw_laws(analysis)
    traces = gather_traces(analysis)
    write_diagnosis_report(path, result, evaluation, pictures, traces)


def write_gap_timeline(path: Path, examined: Examined) -> None:
    """The timeline of the recordings with the gap marked; none where nothing was analysed.

    Args:
        path: The file.
        examined: The diagnosis, with all that the timeline needs.
    """
    from ident.show.timeline.gap import gap_curves, gap_marks
    from ident.show.timeline.writing import write_timeline

    analysis = examined.analysis
    if analysis is None:
        return
    write_timeline(
        path,
        analysis.baseline.nominal,
        examined.motions,
        examined.model,
        examined.diagnosis.telemetry,
        gap_marks(analysis),
        gap_curves(analysis),
        examined.diagnosis.summary(),
    )
