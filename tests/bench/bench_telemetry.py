"""What the telemetry check says of every recording at hand: a line a session, to be compared with an earlier table.

Nothing that was right may be lost: a session that was fit for use and is refused now, or the other way round, is
printed as changed, and so is every issue that came or went.

    python -m tests.bench.bench_telemetry REAL OTHERWORLD TABLE          # writes the table, compares with what it held
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from ident.checks.inspection import inspect_alone
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.robot.arm import ArmModel
from ident.simulation.real.sources import kept_back_arms, load_known, load_sources, recorded_causes

SEPARATOR = "\t"


def sessions(real: Path, otherworld: Path) -> Iterator[tuple[str, Session, ArmModel]]:
    """Name, session and arm of every recording: real arms', those with a measured cause, the other world's."""
    sources = {source.name: source for source in load_sources(real)}
    closed = kept_back_arms()
    for name, entry in recorded_causes().items():
        if entry["arm"] not in closed and (real / entry["folder"]).is_dir():
            sources[name] = load_known(name, entry, real)
    for name in sorted(sources):
        source = sources[name]
        yield f"real/{name}", Session(name, source.runs), ArmModel.from_urdf(source.urdf)
    arm = ArmModel.load(otherworld / "robot.urdf")
    for folder in sorted(otherworld.glob("session_*")):
        yield f"otherworld/{folder.name}", load_session(folder), arm


def verdict(session: Session, arm: ArmModel) -> str:
    """Whether a session is fit for use, and its issues but for notes."""
    report = inspect_alone(session, arm)
    told = sorted({f"{issue.severity} {issue.issue}" for issue in report.issues if issue.severity != "note"})
    return ", ".join(["fit" if report.is_fit else "refused", *told])


def main() -> None:
    """Writes the table, and prints what differs from the one that was there."""
    real, otherworld, table = (Path(argument) for argument in sys.argv[1:4])
    known: dict[str, str] = {}
    if table.exists():
        lines = table.read_text(encoding="utf-8").splitlines()[1:]
        known = {name: said for name, _, said in (line.partition(SEPARATOR) for line in lines)}
    lines = [f"session{SEPARATOR}verdict and issues"]
    changed = 0
    for name, session, arm in sessions(real, otherworld):
        said = verdict(session, arm)
        lines.append(f"{name}{SEPARATOR}{said}")
        if name in known and known[name] != said:
            changed += 1
            print(f"{name}: was {known[name]}; is {said}", flush=True)
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(lines) - 1} sessions, {changed} changed")


if __name__ == "__main__":
    main()
