"""`ident watch` as a lab runs it: every session once, whatever happens, and a store that others read."""

import os
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from ident.api.daily import watch
from ident.cli.app import app
from ident.errors import InputError
from ident.monitor.store import FoundSession, Store, date_of, find_sessions
from ident.monitor.watch import Watch
from ident.recordings.load import load_session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_session
from tests.schemas import check_file

ROBOT = "tm5-900"


def record(folder: Path, arm: ArmModel, seed: int, viscous: float = 9.0, coulomb: float = 6.0) -> None:
    """Three short runs of an arm with friction."""
    rng = np.random.default_rng(seed)

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        friction = viscous * dq + coulomb * np.tanh(dq / 0.005)
        return arm.inverse_dynamics(q, dq, ddq) + friction + 0.3 * rng.standard_normal(q.shape)

    write_session(made_session(arm, law, [seed, seed + 1, seed + 2], duration=6.0, rate=50.0), folder)


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arms with two sessions each, and one session in which nothing moves."""
    folder, arm = tmp_path_factory.mktemp("arms"), ArmModel.load(ROBOT)
    for i, name in enumerate(("2026-05-03", "26_05_10")):
        record(folder / "left" / name, arm, 10 * i)
        record(folder / "right" / name, arm, 10 * i + 5, viscous=12.0)
    still = made_session(arm, lambda q, dq, ddq: q, [1], duration=6.0, rate=50.0)
    still = still.replace(runs=[run.replace(position=0.0 * run.position) for run in still.runs])
    write_session(still, folder / "right" / "still")
    return folder


def look(folder: Path, store: Path) -> Watch:
    return watch(folder, store, ROBOT, diagnosed=False, settle=0.0)


@pytest.fixture(scope="module")
def watched(arms: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Watch]:
    store = tmp_path_factory.mktemp("watched") / "store"
    return store, look(arms, store)


def test_every_session_is_looked_at_and_told(watched: tuple[Path, Watch]) -> None:
    """Figures of what can be used, the reason for what can't; dates by the folders' names, in their order."""
    store, found = watched
    assert len(found.fresh) == 5
    left, right = found.arms
    assert [row["date"] for row in left.sessions] == ["2026-05-03", "2026-05-10"]
    assert [row["status"] for row in right.sessions if row["session"] == "still"] == ["refused"]
    for arm, viscous in ((left, 9.0), (right, 12.0)):
        points = arm.figures["joint_2", "viscous"]
        assert [abs(point.value - viscous) < 0.5 for point in points] == [True, True]
    record = check_file(store / "watch.json")
    assert record["arms"][0]["figures"]["joint_2/viscous"][0]["session"] == "2026-05-03"


def test_others_read_the_store(watched: tuple[Path, Watch]) -> None:
    """The fleet's page leads to every arm's, which shows each figure; one table, by Arrow and, if there, by DuckDB."""
    store, _ = watched
    index = (store / "index.html").read_text()
    assert "None of 2 arms has changed" in index
    for arm in ("left", "right"):
        assert f'href="arm-{arm}.html"' in index
        assert (store / f"arm-{arm}.html").read_text().count("<svg") >= 20
    rows = Store(store).read("figures")
    assert {row["arm"] for row in rows} == {"left", "right"}
    assert pq.read_schema(store / "alarms.parquet").names[0] == "arm"
    duckdb = pytest.importorskip("duckdb")
    query = f"select count(*) from '{store}/figures/*/*.parquet' where figure = 'viscous' and unit = 'N m s/rad'"
    assert duckdb.sql(query).fetchall() == [(24,)]


def test_a_session_is_looked_at_once_unless_it_changes(watched: tuple[Path, Watch], arms: Path, tmp_path: Path) -> None:
    """A second look does nothing; a session whose last file of the store is missing, as after a kill, is done again."""
    store = tmp_path / "store"
    shutil.copytree(watched[0], store)
    assert look(arms, store).fresh == ()
    before = Store(store).place("figures", "left", "2026-05-03").read_bytes()
    Store(store).place("sessions", "left", "2026-05-03").unlink()
    assert look(arms, store).fresh == ("left/2026-05-03",)
    assert Store(store).place("figures", "left", "2026-05-03").stat().st_size == len(before)


def test_what_is_still_written_waits(arms: Path, tmp_path: Path) -> None:
    """A session that was touched a moment ago is left alone until it rests."""
    shutil.copytree(arms / "left" / "2026-05-03", tmp_path / "cell" / "today")
    os.utime(next((tmp_path / "cell" / "today").glob("*.parquet")))
    found = watch(tmp_path / "cell", tmp_path / "store", ROBOT, diagnosed=False, settle=3600.0)
    assert (found.fresh, found.waiting) == ((), ("cell/today",))
    assert "cell/today: waits" in found.summary()


def test_another_guess_of_a_gain_is_no_change_of_the_arm(arms: Path, tmp_path: Path) -> None:
    """Law: the same currents give the same figures, whatever each session's gains were guessed to be."""
    session = load_session(arms / "left" / "2026-05-03")
    for name, gain in (("2026-05-03", 10.0), ("2026-05-04", 12.5)):
        runs = [run.replace(current=run.effort / 10.0, effort=None) for run in session.runs]
        write_session(session.replace(runs=runs), tmp_path / "cell" / name)
        gains = "".join(f"{joint} = {gain}\n" for joint in session.joints)
        (tmp_path / "cell" / name / "session.toml").write_text(f"[drive_gain_Nm_per_A]\n{gains}guessed = true\n")
    (arm,) = look(tmp_path / "cell", tmp_path / "store").arms
    first, second = arm.figures["joint_2", "coulomb"]
    assert second.value == pytest.approx(first.value, rel=1e-6)


def test_the_command_looks_once(arms: Path, tmp_path: Path) -> None:
    """As cron runs it; a folder without sessions and a store of somebody else's are reported in one line."""
    shutil.copytree(arms / "right" / "still", tmp_path / "cell" / "still")
    given = ["--store", str(tmp_path / "store"), "--robot", ROBOT, "--once", "--settle", "0", "--no-diagnose"]
    done = CliRunner().invoke(app, ["watch", str(tmp_path / "cell"), *given, "--json", str(tmp_path / "watch.json")])
    assert done.exit_code == 0, done.output
    assert "1 arm, 1 session, 1 of them new" in done.output
    check_file(tmp_path / "watch.json")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="something else"):
        look(tmp_path / "cell", tmp_path / "mine")
    with pytest.raises(InputError, match="holds no session"):
        look(tmp_path / "mine", tmp_path / "store")
    with pytest.raises(InputError, match="not a model folder"):
        watch(tmp_path / "cell", tmp_path / "store", ROBOT, model=tmp_path / "mine")


DATES = {
    "by the name": ("ur-20_01_13-load", "", None, "2020-01-13"),
    "by the files": ("run_99_99_99", "", None, "1970-01-02T00:00:00"),
    "by the stamps": ("run_99_99_99", "", 1.7e9, "2023-11-14T22:13:20"),
    "as written": ("ur-20_01_13-load", "2024-02-01", None, "2024-02-01"),
    "no date": ("2020_01_13", '"soon"', None, "'soon'; write it as"),
    "beyond the calendar": ("s", "0001-01-01T00:00:00+14:00", None, "write it as"),
    "beyond its end": ("s", '"9999-12-31T23:59:59-14:00"', None, "write it as"),
    "a time of day": ("s", "12:00:00", None, "write it as"),
    "a number": ("s", "5", None, "write it as"),
    **{
        f"a zone, {written}": ("s", written, None, "2026-05-04T04:30:00")
        for date in ("2026-05-03T23:30:00-05:00", "2026-05-04T13:30:00+09:00")
        for written in (date, f'"{date}"')
    },
}


@pytest.mark.parametrize("case", DATES)
def test_dates_come_from_the_settings_the_name_or_the_stamps(case: str, tmp_path: Path) -> None:
    """What a person wrote goes first, in UTC so that all can be put in order, and must be a date."""
    name, written, first, expected = DATES[case]
    (tmp_path / "session.toml").write_text(f"date = {written}\n" if written else "")
    session = FoundSession("arm", name, tmp_path, None, "", 86400.0)
    if "write it as" not in expected:
        assert date_of(session, first) == expected
        return
    with pytest.raises(InputError, match=expected):
        date_of(session, first)


def test_arms_are_watched_whatever_they_are_called(arms: Path, tmp_path: Path) -> None:
    """Links with other letters, names that are no UTF-8, names too long for a file: each has its rows and its page."""
    folder = tmp_path / "arms"
    folder.mkdir()
    names = ("länk 関節", os.fsdecode(b"arm_\xff"), "関" * 80)
    for name in names:
        (folder / name).symlink_to(arms / "right")
    (folder / "broken").symlink_to(tmp_path / "nowhere")
    (folder / "loop").symlink_to(folder)
    look(folder, folder / "store")  # is no arm
    assert {one.arm for one in find_sessions(folder)} == {"länk 関節", "arm_\\xff", "関" * 80}
    found = look(folder, tmp_path / "store")
    assert sorted(arm.arm for arm in found.arms) == sorted(["länk 関節", "arm_\\xff", "関" * 80])
    assert all(Store(tmp_path / "store").page(arm.arm).is_file() for arm in found.arms)
    assert look(folder, tmp_path / "store").fresh == ()
