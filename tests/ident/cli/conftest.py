"""The `ident` command in this process: what it prints, writes and returns."""

import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from ident.cli import app as cli
from ident.robot.names import data_path
from tests.schemas import check_file

E1 = Path(data_path("logs/tm5_900")) / "E1"
ROBOT = ("--robot", "tm5-900")
ONE_RUN = E1 / "01_trajectory_1.parquet"


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit status, standard output and error."""

    status: int
    out: str
    err: str


Run = Callable[..., Ended]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `ident` with some arguments; a result file that it writes holds to its published schema."""

    def call(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["ident", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            cli.main()
        printed = capsys.readouterr()
        if "--json" in arguments and not end.value.code and "-" not in arguments:
            check_file(arguments[arguments.index("--json") + 1])  # type: ignore[arg-type]
        return Ended(int(end.value.code or 0), printed.out, printed.err)

    return call


@pytest.fixture(scope="session")
def text_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """E1 as CSV files."""
    folder = tmp_path_factory.mktemp("text") / "session"
    folder.mkdir()
    shutil.copy(E1 / "session.toml", folder)
    for file in sorted(E1.glob("*.parquet")):
        pacsv.write_csv(pq.read_table(file), folder / f"{file.stem}.csv")
    return folder


@pytest.fixture
def spoilt(text_session: Path, tmp_path: Path) -> Path:
    """A copy of it to be spoilt."""
    return Path(shutil.copytree(text_session, tmp_path / "session"))


@pytest.fixture(scope="session")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of E1 without a net."""
    out = tmp_path_factory.mktemp("model") / "m"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["ident", "fit", str(E1), *ROBOT, "--net", "none", "--out", str(out)])
        with pytest.raises(SystemExit) as end:
            cli.main()
    assert not end.value.code
    return out


def assert_refused(ended: Ended, *words: str) -> None:
    """Exit status 2; one line on standard error: place, what is wrong; remedy. No traceback."""
    assert ended.status == 2, ended
    line = ended.err.rstrip("\n")
    assert line.startswith("ident: ")
    assert "\n" not in line
    assert "Traceback" not in ended.err + ended.out
    for word in words:
        assert word in line, line


def assert_untouched(folder: Path, *names: str) -> None:
    """Only these lie in a folder: no output, no temporary file."""
    assert sorted(entry.name for entry in folder.iterdir()) == sorted(names)
