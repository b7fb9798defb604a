"""The page of an evaluation: verdict, the ladder in the shape of the paper's table 1, and which
sections follow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.errors import plural
from ident.model.evaluation import Evaluation, SessionScore
from ident.model.hybrid import HybridModel
from ident.recordings.recording import TelemetryIssue
from ident.show.palette import rung_name
from ident.show.report.page import Section, models_section, telemetry_section, write_report
from ident.show.report.words import MINUS, fixed, glue, percent, places_for, sentence, table_places

# Share of the URDF's torque error that may be left for "follows", and for "follows in part".
FOLLOWS = 0.25
IN_PART = 0.7
# A rung that leaves more than this share of both errors isn't worth a word in the lead.
UNTOLD = 0.9
# From here on a joint is called worse: less is within the scatter of the runs.
WORSE = 1.02
# A share of an error by which a rung changes nothing.
UNCHANGED = 0.0005
SUBJECTS = {
    "inertia": "fitting the inertias",
    "loss": "friction",
    "named": "named laws",
    "net": "the net",
}
MOST_NAMES = 8


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Models and their scores on the same sessions."""

    models: tuple[HybridModel, ...]  # fitted models
    evaluations: tuple[Evaluation, ...]  # the evaluation of each model, in the same order
    # What the telemetry check of the evaluated sessions says.
    issues: tuple[TelemetryIssue, ...] = ()

    def __post_init__(self) -> None:
        for name in ("models", "evaluations", "issues"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.models or len(self.models) != len(self.evaluations):
            raise ValueError(f"{len(self.models)} models and {len(self.evaluations)} evaluations")

    @property
    def main(self) -> int:
        """Which model the page speaks of first: that of most training samples, of equals the
        first.
        """
        samples = [model.provenance.get("samples", 0) for model in self.models]
        return samples.index(max(samples))

    @property
    def model(self) -> HybridModel:
        """The model that the page speaks of first."""
        return self.models[self.main]

    @property
    def evaluation(self) -> Evaluation:
        """Its evaluation."""
        return self.evaluations[self.main]

    def seen_runs(self) -> int:
        """How many evaluated runs the main model was fitted on: they flatter it."""
        trained = set()
        for entry in self.model.provenance.get("data", []):
            stem = str(entry.get("file", "")).rsplit(".", 1)[0]
            trained.add((entry.get("session"), stem))
        seen = 0
        for score in self.evaluation.sessions:
            seen += sum((score.name, run) in trained for run in score.runs)
        return seen


def pool_name(score: SessionScore, longest: int = 70) -> str:
    """Name of a group of runs; a count of its sessions where their names would fill the line."""
    sessions = score.name.split(" + ")
    if len(sessions) == 1 or len(score.name) <= longest:
        return score.name
    return f"all {len(sessions)} sessions"


def evaluation_sections(source: ReportInput) -> list[Section | None]:
    """All sections of an evaluation, the verdict first."""
    from ident.show.report import evaluation_figures, parameter_figures, residual_figures

    names = [evaluation.model for evaluation in source.evaluations]
    return [
        verdict_section(source),
        ladder_section(source),
        evaluation_figures.payload_section(source),
        evaluation_figures.comparison_section(source),
        evaluation_figures.fits_section(source),
        residual_figures.residuals_section(source),
        parameter_figures.parameters_section(source),
        telemetry_section([issue.to_dict() for issue in source.issues]),
        models_section(list(zip(names, source.models, strict=True))),
    ]


def write_evaluation_report(
    path: str | Path,
    models: Sequence[HybridModel],
    evaluations: Sequence[Evaluation],
    issues: Sequence[TelemetryIssue] = (),
) -> Path:
    """Writes the page of an evaluation.

    Raises:
        InputError: The folder can't be written to.
    """
    source = ReportInput(tuple(models), tuple(evaluations), tuple(issues))
    scores = source.evaluation.sessions
    runs = sum(len(score.runs) for score in scores)
    names = f"{len(scores)} sessions"
    if len(scores) <= MOST_NAMES:
        names = ", ".join(score.name for score in scores)
    subtitle = f"{source.model.robot.name} · {names} · {plural(runs, 'run')}"
    sections = evaluation_sections(source)
    return write_report(path, "Does the model follow the arm?", sections, subtitle)


def verdict_section(source: ReportInput) -> Section:
    """One sentence, the ladder at a glance, and the facts that a reader must know."""
    score = source.evaluation.pooled
    values = {
        "headline": glue(headline(score)),
        "lead": glue(describe_steps(score)),
        "seen": source.seen_runs(),
        "runs": sum(len(session.runs) for session in source.evaluation.sessions),
        "facts": [(kind, glue(text)) for kind, text in describe_facts(source, score)],
        "score": score,
        "session": pool_name(score),
    }
    return Section("verdict", "Verdict", "verdict.html", values)


def describe_facts(source: ReportInput, score: SessionScore) -> Iterator[tuple[str, str]]:
    """Kind and words: the largest error left, joints that became worse, payloads, unseen runs,
    telemetry.
    """
    rest = score.rmse_mean[-1, :-1]
    if not np.all(np.isnan(rest)):
        yield "", _describe_worst(source, score, int(np.nanargmax(rest)))
    yield from worse_joints(score)
    sessions = source.evaluation.sessions
    loaded = [session for session in sessions if session.payload_kg > 0]
    if loaded and len(loaded) < len(sessions):
        yield _describe_payloads(loaded)
    if not source.seen_runs():
        known = bool(source.model.provenance.get("data"))
        unseen = "(which runs the model was fitted on is not recorded)"
        if known:
            unseen = "that the fit never saw"
        text = f"Judged on {pool_name(score)}: {plural(len(score.runs), 'run')} {unseen}."
        yield "good" if known else "warning", text
    for severity, noun in (("fatal", "fatal issue"), ("warning", "warning")):
        count = sum(issue.severity == severity for issue in source.issues)
        if count:
            yield "warning", f"Telemetry: {plural(count, noun)}. See the table below."
            return


def _describe_worst(source: ReportInput, score: SessionScore, worst: int) -> str:
    """The largest torque error left, and the joint of which least is explained.

    Args:
        source, score: Models and their scores, and all runs together.
        worst: The joint of the largest error.
    """
    rest = score.rmse_mean[-1, worst]
    traces = source.evaluation.traces
    torque = np.concatenate([trace.motion.tau_filtered[:, worst] for trace in traces])
    size = np.sqrt(np.mean(torque**2))
    share = f", {percent(rest / size)} of its rms torque" if size > 0 else ""
    text = f"Largest torque error left: {score.joints[worst]}, {fixed(rest, 2)} N m{share}."
    explained = score.r2[-1]
    if np.any(np.isfinite(explained)):
        low = int(np.nanargmin(explained))
        text += f" Least explained: {score.joints[low]}, R² {fixed(explained[low], 3)}."
    return text


def _describe_payloads(loaded: Sequence[SessionScore]) -> tuple[str, str]:
    """Kind and words: whether every rung helps with payload, too."""
    errors = np.array([session.rmse_mean[:, -1] for session in loaded])
    ordered = bool(np.all(np.diff(errors, axis=1) < 0))
    order = "every rung still helps" if ordered else "not every rung helps any more"
    heaviest = max(session.payload_kg for session in loaded)
    most = fixed(errors[:, -1].max(), 2)
    what = f"With up to {1000 * heaviest:.0f} g at the flange {order}"
    return "good" if ordered else "warning", f"{what}; torque error at most {most} N m."


def urdf_rung(score: SessionScore) -> int:
    """Row of the URDF as a simulator loads it: its rigid body where it states no friction."""
    return score.rungs.index("urdf") if "urdf" in score.rungs else 0


def headline(score: SessionScore) -> str:
    """Whether the last rung follows the arm, in one sentence with numbers."""
    first = score.rmse_mean[urdf_rung(score), -1]
    last = score.rmse_mean[-1, -1]
    share = last / first if first > 0 else 1.0
    place = places_for([first, last])
    if len(score.rungs) == 1:
        return f"Only the URDF was judged: torque error {fixed(first, place)} N m."
    errors = score.energy_error[-2:].sum(axis=2)
    below, with_last = np.sqrt(np.mean(errors**2, axis=1))
    energy = ""
    if with_last > WORSE * below:
        last_rung = SUBJECTS.get(score.rungs[-1], score.rungs[-1])
        off = f"with {last_rung} a run is off by {_joule(with_last)} J"
        energy = f" Not in energy: {off}, without by {_joule(below)} J."
    words = "The fit helps little"
    if share <= FOLLOWS:
        words = "The fitted model follows the arm"
    elif share <= IN_PART:
        words = "The fitted model follows the arm in part"
    urdf = f"the URDF alone {fixed(first, place)} N m"
    return f"{words}: torque error {fixed(last, place)} N m; {urdf}.{energy}"


def _joule(value: float) -> str:
    """An energy with as many decimals as a table gives it."""
    return fixed(value, table_places([value]))


def describe_steps(score: SessionScore) -> str:
    """What each rung that matters does to the energy error of a run and to the torque error."""
    energy = score.energy_mean[:, -1]
    torque = score.rmse_mean[:, -1]
    urdf = urdf_rung(score)
    subjects = SUBJECTS
    later = list(range(urdf + 1, len(score.rungs)))
    if "urdf" in score.rungs:
        # Without any friction fitted inertias are no step from a URDF that states some.
        later = [k for k in later if score.rungs[k] != "inertia"]
        if "inertia" in score.rungs:
            subjects = {**SUBJECTS, "loss": "fitted inertias and friction"}
    shown = [urdf]
    for k in later:
        last = shown[-1]
        less_torque = torque[k] <= UNTOLD * torque[last]
        if less_torque or abs(energy[k]) <= UNTOLD * abs(energy[last]):
            shown.append(k)
    start = _joule(energy[urdf])
    if len(shown) == 1:
        return f"The energy error of a run is {start} J, and no rung changes that much."
    steps: list[str] = []
    for k in shown[1:]:
        subject = subjects.get(score.rungs[k], score.rungs[k])
        words = f"{subject} to {_joule(energy[k])} J"
        if not steps:
            verb = "bring" if " and " in subject else "brings"
            brings = f"{sentence(subject)} {verb} the energy error of a run from {start}"
            words = f"{brings} to {_joule(energy[k])} J"
        steps.append(words)
    errors = " → ".join(fixed(torque[k], 2) for k in shown)
    return f"{', '.join(steps)}; torque error {errors} N m."


def worse_joints(score: SessionScore) -> list[tuple[str, str]]:
    """Joints on which the last rung makes the torque error larger than the rung before it."""
    if len(score.rungs) < 2:
        return []
    errors = zip(score.joints, *score.rmse_mean[-2:, :-1], strict=True)
    worse = []
    for joint, before, after in errors:
        if after > WORSE * before:
            worse.append(f"{joint} ({fixed(before)} → {fixed(after)} N m)")
    if not worse:
        return []
    subject = SUBJECTS.get(score.rungs[-1], score.rungs[-1])
    return [("warning", f"Worse with {subject} than without: {', '.join(worse)}.")]


def ladder_section(source: ReportInput) -> Section:
    """The main model on all runs without payload, then each session and other model, folded."""
    main = source.evaluation
    sessions = main.sessions if len(main.sessions) > 1 else ()
    others = list(source.evaluations)
    del others[source.main]
    values = {
        "main": main,
        "reductions": reductions(main.pooled),
        "states_friction": "urdf" in main.pooled.rungs,
        "sessions": [(None, score) for score in sessions],
        "others": [(evaluation.model, evaluation.pooled) for evaluation in others],
        "pool_name": pool_name,
    }
    return Section("ladder", "The ladder, joint by joint", "ladder.html", values)


def reductions(score: SessionScore) -> list[str]:
    """How much of the energy and torque error each rung takes away from the one below it.

    The friction that a URDF states is in no rung above it: fitted inertias stand on the rigid body.
    """
    energy = np.abs(score.energy_mean[:, -1])
    torque = score.rmse_mean[:, -1]
    lines = []
    for k in range(1, len(score.rungs)):
        below = k - 1
        if score.rungs[below] == "urdf":
            below = 0
        less_energy = f"energy error {_describe_change(energy[below], energy[k])}"
        less_torque = f"torque error {_describe_change(torque[below], torque[k])}"
        lines.append(glue(f"{rung_name(score.rungs[k])}: {less_energy}, {less_torque}"))
    return lines


def _describe_change(before: float, after: float) -> str:
    """By what share an error falls or rises."""
    if not before > 0:
        return "as before"
    share = 1.0 - after / before
    if abs(share) < UNCHANGED:
        return "unchanged"
    sign = MINUS if share >= 0 else "+"
    return f"{sign}{percent(abs(share))}"
