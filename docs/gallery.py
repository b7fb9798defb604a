"""A page for each of some real arms, from recordings that their authors published under licences that allow it.

    python docs/gallery.py REAL [OUT]

REAL holds the recordings as `SOURCES` names them; fetch them from where they were published. Writes the pages below
OUT, the arms of docs/gallery.md, and a picture of each page's first screen beside that.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path

from write import take_picture

from ident import InputError
from ident.api.daily import servo
from ident.api.diagnosing import examine
from ident.command_options import DiagnoseOptions
from ident.show.report.diagnosis_actions import first_action
from ident.show.report.diagnosis_pages import write_diagnosis_report
from ident.show.report.diagnosis_verdict import diagnosis_headline
from ident.show.report.laws import draw_laws
from ident.show.report.servo_page import verdict_values, write_servo_report
from ident.show.report.traces import gather_traces

TABLE = Path(__file__).with_name("gallery.md")
BLOCK = re.compile(r"(<!-- arms -->\n).*?(<!-- end of arms -->)", re.DOTALL)


@dataclass(frozen=True)
class RealArm:
    """Recordings of one arm.

    Attributes:
        title: What arm it is.
        file: Its recording, below REAL.
        robot: What `--robot` takes; a path is below REAL.
        origin: Where it was published, and under which licence.
        is_servo: Whether goals and positions alone were logged.
    """

    title: str
    file: str
    robot: str
    origin: str
    is_servo: bool = False


SOURCES = (
    RealArm(
        title="Franka Panda, torque sensors",
        file="panda/unisa_fer/panda_exciting_trajectory.db3",
        robot="panda",
        origin="github.com/unisa-acg/inverse-dynamics-solver at 41e196d, BSD-3-Clause",
    ),
    RealArm(
        title="KUKA KR300 with 151 kg and a counterbalance, neither in the URDF",
        file="kr300/session",
        robot="kr300/robot_0.urdf",
        origin="github.com/JonasWeigand/Robot_Identification at 9e403c0, MIT",
    ),
    RealArm(
        title="Dynamixel XL330 with 0.49 kg at 0.1 m",
        file="xl330/servo_kp400",
        robot="xl330/robot.urdf",
        origin="github.com/Rhoban/bam at af22604, Apache-2.0",
        is_servo=True,
    ),
)


def show(arm: RealArm, real: Path, out: Path) -> str:
    """Writes the page of one arm, and returns its part of the gallery."""
    file = out / f"{arm.file.split('/')[0]}.html"
    robot = str(real / arm.robot) if arm.robot.endswith(".urdf") else arm.robot
    if arm.is_servo:
        headline, action = show_servo(real / arm.file, robot, file)
    else:
        headline, action = show_diagnosis(real / arm.file, robot, file)
    picture = f"gallery_{file.stem}.png"
    take_picture(file, TABLE.with_name(picture))
    said = f"{headline}\n\nWhat to do first: {action}" if action else headline
    return f"## {arm.title}\n\n{said}\n\n![The page's first screen]({picture})\n\nRecordings: {arm.origin}.\n"


def show_diagnosis(recording: Path, robot: str, file: Path) -> tuple[str, str]:
    """The page of a diagnosis; its first sentence, and what to do first."""
    found = examine(recording, robot, DiagnoseOptions())
    record = found.diagnosis.to_dict()
    pictures = () if found.analysis is None else draw_laws(found.analysis)
    traces = None if found.analysis is None else gather_traces(found.analysis)
    write_diagnosis_report(file, record, None, pictures, traces)
    return diagnosis_headline(record), first_action(record)


def show_servo(recording: Path, robot: str, file: Path) -> tuple[str, str]:
    """The page of a servo; its first sentence, and what to do first."""
    found = servo(recording, robot)
    write_servo_report(file, found)
    values = verdict_values(found.to_dict())
    return str(values["headline"]), str(values["first"])


def main(real: str, out: str = "out/gallery") -> None:
    """Writes all pages and the gallery; what is not there is left out, and it says so."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    parts = []
    for arm in SOURCES:
        try:
            parts.append(show(arm, Path(real), folder))
        except InputError as error:
            print(f"left out {arm.title}: {error}", file=sys.stderr)
    if len(parts) == len(SOURCES):
        text = TABLE.read_text(encoding="utf-8")
        arms = "\n".join(parts)
        TABLE.write_text(BLOCK.sub(lambda block: f"{block[1]}{arms}{block[2]}", text), encoding="utf-8")
    print(f"written to {folder}")


if __name__ == "__main__":
    main(*sys.argv[1:])
