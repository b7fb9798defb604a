"""Inputs that ended in a traceback, took gigabytes, or told what nobody can read: each is told in a line now."""

import errno
import os
import re
import resource
import subprocess
import sys
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ident import workers
from ident.errors import InputError
from ident.files import atomic_write, require_plain_header
from ident.infer.guess import read_foreign
from ident.infer.new_session import guess_session, require_own_guess
from ident.monitor.store import Store, write_rows
from ident.process import TEMPORARY
from ident.recordings.load import load_session
from ident.recordings.parquet import load_columns
from ident.recordings.recording import Recording
from ident.recordings.save import write_recording
from ident.robot import meshes
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.servos.goal_runs import load_goals
from ident.show.report.page import Section, render_page
from ident.trajectories.files import read_commands
from plan.geometry.obstacle_files import read_mesh

SCALE = np.ones(3)
# A screen of 24 lines of 80 characters.
SCREEN = 24 * 80
MEMORY = 2_000_000_000
PLY = """ply
format ascii 1.0
element vertex {corners}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 1 2 3
3 2 0 3
"""
HUGE = 10**20


def within_memory(script: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Runs Python that may have no more than `MEMORY` beyond what it has loaded."""
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_DATA, ({MEMORY}, {MEMORY}))\n{script}"
    line = [sys.executable, "-c", limited, *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, check=False, timeout=120)


DAE = """<?xml version="1.0"?><COLLADA version="1.4.1"><library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="a" count="{count}">0 0 0 1 0 0 0 1 0 0 0 1</float_array></source></mesh></geometry>
</library_geometries></COLLADA>"""


@pytest.mark.parametrize("coding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("count", ["3999999999", " 3999999999\n", "0xF0000000", "&#51;999999999", "+3999999999", "3e9"])
def test_a_count_is_read_as_its_reader_reads_it(count: str, coding: str, tmp_path: Path) -> None:
    """Law: a .dae's counts are plain numbers, no larger than the file, however they and it are written."""
    path = tmp_path / "shape.dae"
    path.write_bytes(DAE.format(count=count).encode(coding))
    with pytest.raises(InputError, match=r"more than its .* bytes can hold|a count that is no plain number"):
        read_mesh(path, SCALE, hull=False)


@pytest.mark.parametrize(("corners", "faces"), [(HUGE, 4), (4, HUGE), (10**9, 4), (4, 2**31), (10**6, 4)])
@pytest.mark.parametrize("header", ["plain", "long"])
def test_a_mesh_does_not_claim_more_than_it_holds(corners: int, faces: int, header: str, tmp_path: Path) -> None:
    """Law: its reader would make room for it before it looks."""
    path = tmp_path / "shape.ply"
    text = PLY.format(corners=corners, faces=faces)
    path.write_text({"plain": text, "long": text.replace("element", f"comment {'x' * (1 << 17)}\nelement", 1)}[header])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match="more than its"):
        read_mesh(path, SCALE, hull=False)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000


def test_a_mesh_names_no_corner_that_is_not_there(tmp_path: Path) -> None:
    """Law: the reader below Python would read beyond its memory; of a scene and of a URDF."""
    path = tmp_path / "shape.ply"
    for text in (
        PLY.format(corners=1, faces=4),
        PLY.format(corners=4, faces=4).replace("3 2 0 3", "3 2 0 9"),
        PLY.format(corners=4, faces=4).replace("3 2 0 3", "3 2 0 -1"),
        PLY.format(corners=4, faces=4).replace("3 2 0 3", "3 2 0"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=r"not there|no whole"):
            read_mesh(path, SCALE, hull=False)


def test_a_mesh_that_is_named_a_thousand_times_is_not_read_as_often(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: an arm's meshes together, each as often as its URDF names it, are no larger than one may be."""
    path = tmp_path / "shape.ply"
    path.write_text(PLY.format(corners=4, faces=4))
    monkeypatch.setattr(meshes, "LARGEST", 3 * path.stat().st_size)
    shape = '<collision><geometry><mesh filename="shape.ply"/></geometry></collision>'
    plain = re.sub(r"(?s)<(collision|visual)\b.*?</\1>", "", Path(data_path("urdf/tm5_900.urdf")).read_text())
    arm = tmp_path / "arm.urdf"
    for times in (3, 4, 1000):
        arm.write_text(plain.replace("</link>", f"{shape * times}</link>", 1))
        loaded = ArmModel.load(str(arm))
        if times == 3:
            assert len(loaded.geometry.geometryObjects) == times
            continue
        with pytest.raises(InputError, match=r"its meshes up to .* have .* MB; give simplified meshes"):
            assert loaded.geometry


def test_an_honest_mesh_is_read(tmp_path: Path) -> None:
    path = tmp_path / "shape.ply"
    path.write_text(PLY.format(corners=4, faces=4))
    assert read_mesh(path, SCALE, hull=True)[0] is not None
    stl = tmp_path / "shape.stl"
    stl.write_bytes(b"\0" * 80 + (2**31).to_bytes(4, "little") + b"\0" * 50)
    dae = tmp_path / "shape.dae"
    dae.write_text('<COLLADA><float_array count="99999999999999999999">0</float_array></COLLADA>')
    for wrong in (stl, dae):
        with pytest.raises(InputError, match="more than its"):
            read_mesh(wrong, SCALE, hull=False)


def test_text_that_stands_in_a_million_cells_stands_once_in_memory(tmp_path: Path) -> None:
    """Law: a file of kilobytes whose text columns come to gigabytes is read for its numbers."""
    rows = 1_000_000
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int32)), pa.array(["x" * 100_000]))
    table = pa.table({"time": np.arange(rows) * 1e-3, "note": text, "q": np.zeros(rows)})
    pq.write_table(table, tmp_path / "run.parquet", compression="zstd")
    script = """
import sys
from pathlib import Path
from ident.infer.guess import read_foreign
print(sorted(read_foreign(Path(sys.argv[1])).columns))
"""
    done = within_memory(script, tmp_path / "run.parquet")
    assert done.stdout.strip() == "['q', 'time']", done.stderr[-500:]


BYTES = b"x" * 50_000
# What is no number, by the kind that its column has.
NO_NUMBERS = {
    "fixed": pa.binary(len(BYTES)),
    "bytes": pa.binary(),
    "long bytes": pa.large_binary(),
    "a look at bytes": pa.binary_view(),
    "lists": pa.list_(pa.large_binary()),
    "structures": pa.struct({"picture": pa.large_binary()}),
}


def test_what_is_no_number_is_not_unpacked(tmp_path: Path) -> None:
    """Law: pictures, bytes and structures that stand once in a file and in all of its rows take no memory."""
    rows = 200
    table = pa.table({"time": np.arange(rows) * 1e-3, "q": np.zeros(rows)})
    for name, kind in NO_NUMBERS.items():
        cell = {"structures": {"picture": BYTES}, "lists": [BYTES]}.get(name, BYTES)
        table = table.append_column(name, pa.array([cell] * rows, kind))
    pq.write_table(table, tmp_path / "run.parquet", compression="zstd")
    script = """
import sys
from pathlib import Path
import pyarrow as pa
from ident.infer.guess import read_foreign
print(sorted(read_foreign(Path(sys.argv[1])).columns), pa.default_memory_pool().max_memory() < 5_000_000)
"""
    done = within_memory(script, tmp_path / "run.parquet")
    assert done.stdout.strip() == "['q', 'time'] True", done.stderr[-500:]
    assert sorted(load_columns(tmp_path / "run.parquet")) == ["q", "time"]


@pytest.mark.parametrize("name", NO_NUMBERS)
def test_a_column_that_is_asked_for_and_is_no_number_is_told(name: str, tmp_path: Path) -> None:
    cell = {"structures": {"picture": BYTES}, "lists": [BYTES]}.get(name, BYTES)
    column = pa.array([cell] * 5, NO_NUMBERS[name])
    table = pa.table({"time": np.arange(5) * 1e-3, "joint_1/position": np.zeros(5), "joint_1/effort": column})
    pq.write_table(table, tmp_path / "run.parquet")
    with pytest.raises(InputError, match=r"column joint_1/effort: holds no numbers \("):
        load_session(tmp_path / "run.parquet")


def test_a_watch_takes_no_table_whose_texts_come_to_more_than_any_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: a text that stands once in a table of the store, and in all of its rows, is not unpacked."""
    monkeypatch.setenv("ARMGAP_MOST_UNPACKED_MB", "1")
    store = Store(tmp_path)
    row = {"arm": "left", "session": "one", "date": "2026-05-03", "status": "done", "stamp": "0"}
    write_rows(store.place("sessions", "left", "one"), "sessions", [row])
    assert len(store.read("sessions")) == 1
    write_rows(store.place("sessions", "left", "two"), "sessions", [{**row, "reason": "x" * 100_000}] * 100)
    assert len(store.read("sessions")) == 1


def test_stamps_in_a_dictionary_are_numbers(tmp_path: Path) -> None:
    """Law: text of times, each value once in the file, is read as it was."""
    stamps = [f"2026-01-01T00:00:{second:02d}" for second in (0, 1, 2, 3, 3, 2)]
    table = pa.table({"time": pa.array(stamps).dictionary_encode(), "a/position": np.zeros(6), "a/effort": np.zeros(6)})
    pq.write_table(table, tmp_path / "run.parquet")
    time = load_session(tmp_path / "run.parquet").runs[0].time
    np.testing.assert_allclose(time - time[0], [0, 1, 2, 3, 3, 2])


def test_a_table_without_rows_is_told(tmp_path: Path, tm5: ArmModel) -> None:
    pq.write_table(pa.table({"a": pa.array([], pa.float64())}), tmp_path / "run.parquet")
    with pytest.raises(InputError, match="no row with a number"):
        guess_session(tmp_path / "run.parquet", tm5, None)
    with pytest.raises(InputError, match="no row with a number"):
        read_foreign(tmp_path / "run.parquet")
    assert len(load_columns(tmp_path / "run.parquet")["a"]) == 0


@pytest.mark.parametrize("cell", [np.inf, -np.inf, np.nan, None])
def test_goals_without_a_number_are_told(cell: float | None, tmp_path: Path) -> None:
    time = np.arange(3000) * 0.01
    goals = pa.array([cell] * len(time), pa.float64())
    table = pa.table({"time": time, "a/position": np.sin(time), "a/position_command": goals})
    pq.write_table(table, tmp_path / "run.parquet")
    with pytest.raises(InputError, match=r"no number in most rows|logs no goal"):
        load_goals(tmp_path / "run.parquet")


@pytest.mark.parametrize("step", [2e-10, 1e-300, 1e-5])
def test_commands_of_no_time_are_told(step: float, tm5: ArmModel, tmp_path: Path) -> None:
    names = [f"{name}/position_command" for name in tm5.joint_names]
    columns = {"time": np.arange(20) * step, **dict.fromkeys(names, np.full(20, 0.1))}
    pq.write_table(pa.table(columns), tmp_path / "run.parquet")
    with pytest.raises(InputError, match="its motion takes"):
        read_commands(tmp_path / "run.parquet", tm5)


class GoneClient:
    """A client of a scheduler that goes away while the tasks run."""

    def __init__(self, error: Exception, status: str) -> None:
        self.error, self.status = error, status

    def __call__(self, *_: Any, **__: Any) -> "GoneClient":
        return self

    def __enter__(self) -> "GoneClient":
        return self

    def __exit__(self, *_: object) -> None: ...

    def as_current(self) -> "GoneClient":
        return self

    def map(self, *_: Any, **__: Any) -> list[Any]:
        raise self.error


@pytest.mark.parametrize("error", [TypeError("no"), CancelledError("gone"), OSError("closed")])
def test_a_scheduler_that_goes_away_is_told(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", GoneClient(error, "closed"))
    with pytest.raises(InputError, match="the scheduler is gone; 0 of 2"):
        workers.run_tasks(str, [1, 2], scheduler="tcp://nowhere:1")


def test_an_own_fault_in_a_task_is_no_lost_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", GoneClient(TypeError("our own"), "running"))
    with pytest.raises(TypeError, match="our own"):
        workers.run_tasks(str, [1, 2], scheduler="tcp://nowhere:1")


@pytest.mark.parametrize("length", [10, 10_000, 300_000])
def test_a_message_fits_on_a_screen(length: int) -> None:
    """Law: with its beginning and its end, whatever names stand in it; its parts are whole in the error."""
    error = InputError("a" * length, "b" * length, "c" * length)
    assert len(str(error)) < SCREEN
    assert (len(error.where), error.what[-1]) == (length, "b")
    assert str(error).endswith("c")
    assert len(str(InputError("\x1b" * length, "\x00" * length, "\u202e" * length))) < SCREEN


def test_names_of_temporary_files_are_not_told(tmp_path: Path) -> None:
    """Law: an error names the file that was to be written."""
    with atomic_write(tmp_path / "plan.json") as part:
        assert TEMPORARY.sub(r"\1\2", str(part)) == str(tmp_path / "plan.json")
        part.write_text("")
    app = f"""
import typer
from ident.files import atomic_write
app = typer.Typer()
@app.command()
def work():
    with atomic_write({str(tmp_path / "result.json")!r}) as part:
        raise OSError({errno.ENOSPC}, "No space left on device", str(part))
"""
    (tmp_path / "failing_app.py").write_text(app)
    run = "from ident.process import run_command; run_command('ident', 'failing_app')"
    line = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {run}"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert "result.json: No space left" in done.stderr
    assert "armgap-" not in done.stderr


@pytest.mark.parametrize("arm", ["plain", "a b", "50%", "é?#", "../up", "=1+1", "x" * 300])
def test_links_of_the_index_lead_to_the_pages(arm: str, tmp_path: Path) -> None:
    """Law: a browser that unquotes the link asks for the file that is there."""
    from urllib.parse import unquote

    store = Store(tmp_path)
    rows = {"effect": {arm: "joint_1"}}.items()
    section = Section("effects", "Effects", "watch_effects.html", {"rows": rows, "count": 1, "store": store})
    (link,) = re.findall(r'href="(arm-[^"]*)"', render_page("Arms", [section], ""))
    store.page(arm).write_text("")
    assert (tmp_path / unquote(link)).is_file()


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@sum", "\tx"])
def test_no_cell_of_a_text_table_is_a_formula(name: str, tmp_path: Path) -> None:
    """Law: it is refused by name, and nothing is written; Parquet takes it."""
    run = Recording("run", (name,), np.arange(5) * 0.1, np.zeros((5, 1)), np.zeros((5, 1)))
    with pytest.raises(InputError, match="formula"):
        write_recording(run, tmp_path / "run.csv")
    assert not (tmp_path / "run.csv").exists()
    write_recording(run, tmp_path / "run.parquet")
    require_plain_header(["a=1", "joint_1"], tmp_path)


def test_settings_without_an_end_are_told(tmp_path: Path) -> None:
    """Law: a session.toml of a terabyte is nobody's; it is neither read nor written over."""
    path = tmp_path / "session.toml"
    path.touch()
    os.truncate(path, 1 << 40)
    with pytest.raises(InputError, match="which no file of its kind is"):
        require_own_guess(path)
