"""The main job on the shipped recordings, from the files to the page: what `make run` shows."""

from __future__ import annotations

import shlex
from pathlib import Path

from rich.console import Console

from ident.api.diagnosing import diagnose
from ident.command_options import FitOptions
from ident.files import write_record
from ident.fitting.fit import fit_hybrid
from ident.model.evaluation import evaluate
from ident.model.hybrid import MODEL_KIND, HybridModel
from ident.outputs import check_outputs
from ident.progress import step
from ident.results import Provenance
from ident.robot.names import data_path
from ident.sessions import Opened, open_sessions
from ident.show.console import ladder_table, print_issues, progress_line
from ident.show.diagnosis_lines import print_diagnosis
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.evaluation import write_evaluation_report
from ident.show.timeline.writing import write_timeline

TRAINING = ("T1", "T2")
EVALUATION = ("E1", "E2", "payload_516g", "payload_1029g", "payload_1544g")
# Recordings of arms with one effect each whose cause is withheld.
SEALED = ("sealed_1", "sealed_2", "sealed_3")
# The paper's figure 9: the same model trained on one group of trajectories, on the other, and on
# both.
GROUPS = {"T1": ("T1",), "T2": ("T2",), "T1 + T2": ("T1", "T2")}


def run_demo(out: Path, logs: Path | None, json_file: Path | None, console: Console) -> None:
    """Fits, evaluates, diagnoses and reports into a folder; of the shipped recordings where no
    others are given.

    Raises:
        InputError: Something of the user's stands where the demo writes.
    """
    pages = ["report.html", "timeline.rrd", *(f"diagnosis_{name}.html" for name in SEALED)]
    files: dict[str, Path | None] = {f"--out {out}: {name}": out / name for name in pages}
    check_outputs([logs], {**files, "--json": json_file}, {"--out": (out / "model", MODEL_KIND)})
    folder = logs or data_path("logs/tm5_900")
    training = open_sessions([folder / name for name in TRAINING], "tm5-900")
    held_out = open_sessions([folder / name for name in EVALUATION], "tm5-900", learning=False)
    print_issues(console, [issue.to_dict() for issue in (*training.issues, *held_out.issues)])
    models = {name: _fit(training, sessions, name, console) for name, sessions in GROUPS.items()}
    models["three-joint, T1 + T2"] = _fit(training, TRAINING, "three-joint model", console, links=3)
    results = [evaluate(model, held_out.groups, name) for name, model in models.items()]
    # The full model's ladder without and with payload, and one line a compared model.
    main = next(result for result in results if result.model == "T1 + T2")
    for score in (main.pooled, *(score for score in main.sessions if score.payload_kg)):
        console.print(ladder_table(score))
    console.print("Trained on, total energy error and torque RMSE of the last rung, on E1 + E2:")
    for result in results:
        energy = result.pooled.energy_mean[-1, -1]
        spread = result.pooled.energy_std[-1, -1]
        rmse = result.pooled.rmse_mean[-1, -1]
        console.print(f"  {result.model:<22}{energy:>7.2f} ± {spread:.2f} J   {rmse:.2f} N m")
    model = models["T1 + T2"]
    timeline = out / "timeline.rrd"
    model.save(out / "model")
    write_evaluation_report(out / "report.html", list(models.values()), results, held_out.issues)
    write_timeline(timeline, held_out.arm, held_out.motions, model, held_out.issues)
    console.print(f"report: {out / 'report.html'}")
    console.print(f"timeline: {timeline} (open it with `rerun {shlex.quote(str(timeline))}`)")
    console.print(f"model: {out / 'model'}")
    diagnoses = []
    for name in SEALED:  # the cause is withheld, in an envelope beside each
        page = out / f"diagnosis_{name}.html"
        with progress_line(console, f"diagnose {name}"):
            diagnoses.append(diagnose(folder / name, "tm5-900").to_dict())
        console.print(f"\nWhat is wrong with the arm of {name}?")
        print_diagnosis(console, diagnoses[-1])
        write_diagnosis_report(page, diagnoses[-1])
        console.print(f"diagnosis: {page}")
    record = {
        "schema": "ident.demo/1",
        "robot": training.arm.name,
        "joints": list(training.arm.joint_names),
        "models": [result.to_dict() for result in results],
        "diagnoses": diagnoses,
        "provenance": Provenance(
            "ident demo", sessions=(*training.stamps, *held_out.stamps)
        ).to_dict(),
    }
    write_record(json_file, record)


def _fit(
    opened: Opened, sessions: tuple[str, ...], name: str, console: Console, links: int = 6
) -> HybridModel:
    motions = [
        motion for session, group in opened.groups if session in sessions for motion in group
    ]
    records = [record for record in opened.data_records() if record["session"] in sessions]
    options = FitOptions(links=links, inertia="consistent" if links == 6 else "nominal")
    with progress_line(console, f"fit on {name}"):
        return fit_hybrid(motions, opened.arm, options, records, step).model
