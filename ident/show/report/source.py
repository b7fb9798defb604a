"""What a report is made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ident.model.evaluation import Evaluation, SessionScore
from ident.model.hybrid import HybridModel
from ident.recordings.recording import TelemetryIssue

if TYPE_CHECKING:
    from ident.show.report.laws import LawPicture


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Models and their scores on the same sessions.

    Attributes:
        models: Fitted models.
        evaluations: The evaluation of each model, in the same order.
        issues: What the telemetry check of the evaluated sessions found.
    """

    models: tuple[HybridModel, ...]
    evaluations: tuple[Evaluation, ...]
    issues: tuple[TelemetryIssue, ...] = ()

    def __post_init__(self) -> None:
        for name in ("models", "evaluations", "issues"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.models or len(self.models) != len(self.evaluations):
            raise ValueError(f"{len(self.models)} models and {len(self.evaluations)} evaluations")

    @property
    def main(self) -> int:
        """Which model the page speaks of first: that of most training samples, of equals the first."""
        samples = [model.provenance.get("samples", 0) for model in self.models]
        return samples.index(max(samples))

    @property
    def model(self) -> HybridModel:
        return self.models[self.main]

    @property
    def evaluation(self) -> Evaluation:
        return self.evaluations[self.main]

    def seen_runs(self) -> int:
        """How many evaluated runs the main model was fitted on: they flatter it."""
        trained = [(d.get("session"), str(d.get("file", ""))) for d in self.model.provenance.get("data", [])]
        stems = {(session, file.rsplit(".", 1)[0]) for session, file in trained}
        return sum((score.name, run) in stems for score in self.evaluation.sessions for run in score.runs)


def pool_name(score: SessionScore, longest: int = 70) -> str:
    """Name of a group of runs; a count of its sessions where their names would fill the line."""
    parts = score.name.split(" + ")
    return score.name if len(parts) == 1 or len(score.name) <= longest else f"all {len(parts)} sessions"


@dataclass(frozen=True, eq=False)
class DiagnosisInput:
    """A diagnosis as the contract writes it, and what stands beside it.

    Attributes:
        record: `ident.diagnosis/1`.
        confusion: How often the check on withheld effects took one effect (row) for another, as in `ident.blind/1`.
        provenance: Versions, options and data hashes; those of the record if none are given.
        pictures: One of each finding's law, in their order; None where there is none.
    """

    record: Mapping[str, Any]
    confusion: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    pictures: Sequence[LawPicture | None] = ()
