"""A page for each of some real arms, from recordings that their authors published under licences that allow it.

    python docs/gallery.py REAL [OUT]

REAL holds the recordings as `SOURCES` names them; fetch them from where they were published.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from ident import InputError
from ident.api.diagnosing import examine
from ident.command_options import DiagnoseOptions
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.laws import draw_laws
from ident.show.report.traces import gather_traces


@dataclass(frozen=True)
class RealArm:
    """Recordings of one arm.

    Attributes:
        title: What arm it is.
        file: Its recording, below REAL.
        robot: What `--robot` takes.
        origin: Where it was published, and under which licence.
    """

    title: str
    file: str
    robot: str
    origin: str


UNISA = "github.com/unisa-acg/inverse-dynamics-solver at 41e196d, BSD-3-Clause"
SOURCES = (
    RealArm("UR10 CB", "ur10_cb/ur10_exciting_trajectory.db3", "ur10", UNISA),
    RealArm("Franka Panda", "panda/unisa_fer/panda_exciting_trajectory.db3", "panda", UNISA),
)


def show(arm: RealArm, real: Path, out: Path) -> str:
    """Diagnoses one arm, writes its page, and returns its row of the table."""
    found = examine(real / arm.file, arm.robot, DiagnoseOptions())
    record = found.diagnosis.to_dict()
    pictures = () if found.analysis is None else draw_laws(found.analysis)
    traces = None if found.analysis is None else gather_traces(found.analysis)
    file = out / f"{arm.title.lower().replace(' ', '_')}.html"
    page = write_diagnosis_report(file, record, None, pictures, traces)
    return f"| [{arm.title}]({page.name}) | {diagnosis_headline(record)} | {arm.origin} |"


def main(real: str, out: str = "out/gallery") -> None:
    """Writes all pages and a table of them; what is not there is left out, and it says so."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    rows = ["| arm | what was found | recordings |", "| --- | --- | --- |"]
    for arm in SOURCES:
        try:
            rows.append(show(arm, Path(real), folder))
        except InputError as error:
            print(f"left out {arm.title}: {error}", file=sys.stderr)
    (folder / "index.md").write_text("\n".join(rows) + "\n", encoding="utf-8")
    print(f"written to {folder / 'index.md'}")


if __name__ == "__main__":
    main(*sys.argv[1:])
