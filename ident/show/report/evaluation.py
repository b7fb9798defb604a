"""The page of an evaluation: verdict, the ladder in the shape of the paper's table 1, and which sections follow."""

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
from ident.show.report.words import MINUS, fixed, glue, percent, places_for, table_places

# Share of the URDF's torque error that may be left for "follows", and for "follows in part".
FOLLOWS, IN_PART = 0.25, 0.7
# A rung that leaves more than this share of both errors isn't worth a word in the lead.
UNTOLD = 0.9
# From here on a joint is called worse: less is within the scatter of the runs.
WORSE = 1.02
SUBJECTS = {"inertia": "fitting the inertias", "loss": "friction", "named": "named laws", "net": "the net"}
MOST_NAMES = 8


@dataclass(frozen=True, eq=False)
class ReportInput:
    """Models and their scores on the same sessions."""

    models: tuple[HybridModel, ...]  # fitted models
    evaluations: tuple[Evaluation, ...]  # the evaluation of each model, in the same order
    issues: tuple[TelemetryIssue, ...] = ()  # what the telemetry check of the evaluated sessions found

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
        """The model that the page speaks of first."""
        return self.models[self.main]

    @property
    def evaluation(self) -> Evaluation:
        """Its evaluation."""
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


def evaluation_sections(source: ReportInput) -> list[Section | None]:
    """All sections of an evaluation, the verdict first."""
    from ident.show.report import evaluation_figures as figures

    names = [evaluation.model for evaluation in source.evaluations]
    return [
        verdict_section(source),
        ladder_section(source),
        figures.payload_section(source),
        figures.comparison_section(source),
        figures.fits_section(source),
        figures.residuals_section(source),
        figures.parameters_section(source),
        telemetry_section([one.to_dict() for one in source.issues]),
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
    names = ", ".join(score.name for score in scores) if len(scores) <= MOST_NAMES else f"{len(scores)} sessions"
    subtitle = f"{source.model.robot.name} · {names} · {plural(runs, 'run')}"
    return write_report(path, "Does the model follow the arm?", evaluation_sections(source), subtitle)


def verdict_section(source: ReportInput) -> Section:
    """One sentence, the ladder at a glance, and the facts that a reader must know."""
    score = source.evaluation.pooled
    values = {
        "headline": glue(headline(score)),
        "lead": glue(describe_steps(score)),
        "seen": source.seen_runs(),
        "runs": sum(len(one.runs) for one in source.evaluation.sessions),
        "facts": [(kind, glue(text)) for kind, text in describe_facts(source, score)],
        "score": score,
        "session": pool_name(score),
    }
    return Section("verdict", "Verdict", "verdict.html", values)


def describe_facts(source: ReportInput, score: SessionScore) -> Iterator[tuple[str, str]]:
    """Kind and words: the largest error left, joints that became worse, payloads, unseen runs, telemetry."""
    rest = score.rmse_mean[-1, :-1]
    if not np.all(np.isnan(rest)):
        worst = int(np.nanargmax(rest))
        torque = np.concatenate([trace.motion.tau_filtered[:, worst] for trace in source.evaluation.traces])
        size = np.sqrt(np.mean(torque**2))
        share = f", {percent(rest[worst] / size)} of its rms torque" if size > 0 else ""
        text = f"Largest torque error left: {score.joints[worst]}, {fixed(rest[worst], 2)} N m{share}."
        if np.any(np.isfinite(score.r2[-1])):
            low = int(np.nanargmin(score.r2[-1]))
            text += f" Least explained: {score.joints[low]}, R² {fixed(score.r2[-1][low], 3)}."
        yield "", text
    yield from worse_joints(score)
    loaded = [one for one in source.evaluation.sessions if one.payload_kg > 0]
    if loaded and len(loaded) < len(source.evaluation.sessions):
        errors = np.array([one.rmse_mean[:, -1] for one in loaded])
        ordered = bool(np.all(np.diff(errors, axis=1) < 0))
        order = "every rung still helps" if ordered else "not every rung helps any more"
        heaviest, most = max(one.payload_kg for one in loaded), fixed(errors[:, -1].max(), 2)
        text = f"With up to {1000 * heaviest:.0f} g at the flange {order}; torque error at most {most} N m."
        yield "good" if ordered else "warning", text
    if not source.seen_runs():
        known = bool(source.model.provenance.get("data"))
        unseen = "that the fit never saw" if known else "(which runs the model was fitted on is not recorded)"
        text = f"Judged on {pool_name(score)}: {plural(len(score.runs), 'run')} {unseen}."
        yield "good" if known else "warning", text
    for severity, noun in (("fatal", "fatal issue"), ("warning", "warning")):
        if count := sum(one.severity == severity for one in source.issues):
            yield "warning", f"Telemetry: {plural(count, noun)}. See the table below."
            return


def urdf_rung(score: SessionScore) -> int:
    """Row of the URDF as a simulator loads it: its rigid body where it states no friction."""
    return score.rungs.index("urdf") if "urdf" in score.rungs else 0


def headline(score: SessionScore) -> str:
    """Whether the last rung follows the arm, in one sentence with numbers."""
    first, last = score.rmse_mean[urdf_rung(score), -1], score.rmse_mean[-1, -1]
    share = last / first if first > 0 else 1.0
    place = places_for([first, last])
    numbers = f"torque error {fixed(last, place)} N m; the URDF alone {fixed(first, place)} N m"
    if len(score.rungs) == 1:
        return f"Only the URDF was judged: torque error {fixed(first, place)} N m."
    below, with_last = np.sqrt(np.mean(score.energy_error[-2:].sum(axis=2) ** 2, axis=1))
    energy = ""
    if with_last > WORSE * below:
        off, before = (fixed(value, table_places([value])) for value in (with_last, below))
        last_rung = SUBJECTS.get(score.rungs[-1], score.rungs[-1])
        energy = f" Not in energy: with {last_rung} a run is off by {off} J, without by {before} J."
    words = "follows the arm" if share <= FOLLOWS else "follows the arm in part" if share <= IN_PART else ""
    return f"{f'The fitted model {words}' if words else 'The fit helps little'}: {numbers}.{energy}"


def describe_steps(score: SessionScore) -> str:
    """What each rung that matters does to the energy error of a run and to the torque error."""
    energy, torque = score.energy_mean[:, -1], score.rmse_mean[:, -1]
    urdf = urdf_rung(score)
    shown = [urdf]
    for k in range(urdf + 1, len(score.rungs)):
        if torque[k] <= UNTOLD * torque[shown[-1]] or abs(energy[k]) <= UNTOLD * abs(energy[shown[-1]]):
            shown.append(k)
    joule = [fixed(value, table_places([value])) for value in energy]
    start = joule[urdf]
    if len(shown) == 1:
        return f"The energy error of a run is {start} J, and no rung changes that much."
    first = SUBJECTS.get(score.rungs[shown[1]], score.rungs[shown[1]])
    steps = [f"{first[0].upper()}{first[1:]} brings the energy error of a run from {start} to {joule[shown[1]]} J"]
    steps += [f"{SUBJECTS.get(score.rungs[k], score.rungs[k])} to {joule[k]} J" for k in shown[2:]]
    return f"{', '.join(steps)}; torque error {' → '.join(fixed(torque[k], 2) for k in shown)} N m."


def worse_joints(score: SessionScore) -> list[tuple[str, str]]:
    """Joints on which the last rung makes the torque error larger than the rung before it."""
    if len(score.rungs) < 2:
        return []
    before, after = score.rmse_mean[-2, :-1], score.rmse_mean[-1, :-1]
    worse = [
        f"{joint} ({fixed(a)} → {fixed(b)} N m)"
        for joint, a, b in zip(score.joints, before, after, strict=True)
        if b > WORSE * a
    ]
    subject = SUBJECTS.get(score.rungs[-1], score.rungs[-1])
    return [("warning", f"Worse with {subject} than without: {', '.join(worse)}.")] if worse else []


def ladder_section(source: ReportInput) -> Section:
    """The main model on all runs without payload, then each session and each other model, folded."""
    main = source.evaluation
    sessions = [(None, score) for score in main.sessions] if len(main.sessions) > 1 else []
    others = [(one.model, one.pooled) for k, one in enumerate(source.evaluations) if k != source.main]
    values = {"main": main, "reductions": reductions(main.pooled), "sessions": sessions, "others": others}
    return Section("ladder", "The ladder, joint by joint", "ladder.html", {**values, "pool_name": pool_name})


def reductions(score: SessionScore) -> list[str]:
    """How much of the energy and torque error each rung takes away from the one below it."""
    energy, torque = np.abs(score.energy_mean[:, -1]), score.rmse_mean[:, -1]
    lines = []
    for k in range(1, len(score.rungs)):
        reported = []
        for word, before, after in (("energy", *energy[k - 1 : k + 1]), ("torque", *torque[k - 1 : k + 1])):
            share = 1.0 - after / before if before > 0 else 0.0
            sign = MINUS if share >= 0 else "+"
            change = "as before" if not before > 0 else "unchanged" if abs(share) < 0.0005 else ""
            reported.append(f"{word} error {change or sign + percent(abs(share))}")
        lines.append(glue(f"{rung_name(score.rungs[k])}: {', '.join(reported)}"))
    return lines
