"""Commands as processes: signals, closed pipes, full disks, consoles of other alphabets. One line, no traceback."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from ident.cli import app as ident_app
from ident.errors import visible
from plan.cli import app as plan_app

APP = """
import sys, typer
from ident.show.console import make_console, styled
from ident.files import atomic_write
app = typer.Typer(rich_markup_mode=None, pretty_exceptions_enable=False)
console = make_console()

@app.command()
def work(name: str = "", out: str = "", wait: float = 0.0, lines: int = 1):
    import time
    print("begun", file=sys.stderr, flush=True)
    time.sleep(wait)
    for _ in range(lines):
        console.print(f"gap {name} ± 0.1 → closed")
    console.print(styled((name, "bold")))
    if out:
        with atomic_write(out) as part:
            part.write_text("whole" * 100000)
"""
RUN = "from ident.process import run_command; run_command('ident', 'made_up_app')"


def command(folder: Path, *arguments: str, app: str = APP) -> list[str]:
    (folder / "made_up_app.py").write_text(app)
    return [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder)!r}); {RUN}", *arguments]


def test_a_reader_who_leaves_does_not_end_the_work(tmp_path: Path) -> None:
    out = tmp_path / "result"
    line = command(tmp_path, "--lines", "20000", "--out", str(out))
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.readline()
    process.stdout.close()
    seen = process.stderr.read()
    assert (process.wait(), seen) == (0, "begun\n")
    assert out.exists()


def test_a_name_that_no_file_can_have_is_the_users_fault(tmp_path: Path) -> None:
    """Law: status 2 and a line that can be read, wherever the system stumbles over the name."""
    app = APP.replace("    import time", "    open(out)\n    import time")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    for out, reason in (("x" * 5000, "too long"), (str(tmp_path / "circle"), "symbolic links")):
        done = subprocess.run(command(tmp_path, "--out", out, app=app), capture_output=True, text=True)
        assert done.returncode == 2, done.stderr
        assert reason in done.stderr
        assert len(done.stderr) < 400


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_behind_the_screen_is_told_after_the_work(tmp_path: Path) -> None:
    out = tmp_path / "result"
    with open("/dev/full", "w") as full:
        ended = subprocess.run(
            command(tmp_path, "--out", str(out)), stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert ended.returncode == 74
    assert "Traceback" not in ended.stderr
    assert "No space left" in ended.stderr
    assert out.exists()


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    """Law: the system's own faults end with 74; the half-written file is gone."""
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000)); {RUN}"
    line = command(tmp_path, "--out", str(tmp_path / "result"))
    line[2] = line[2].replace(RUN, limited)
    ended = subprocess.run(line, capture_output=True, text=True, check=False)
    assert ended.returncode == 74
    assert len(ended.stderr.splitlines()) == 2
    assert "File too large" in ended.stderr
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix != ".py") in ([], ["__pycache__"])


def test_a_console_of_ascii_alone(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run(
        command(tmp_path, "--name", "épaule"), capture_output=True, text=True, check=False, env=environment
    )
    assert ended.returncode == 0, ended.stderr
    assert "+- 0.1 -> closed" in ended.stdout
    assert "\\xe9paule" in ended.stdout


def test_names_are_shown_as_they_are(tmp_path: Path) -> None:
    """Law: no text of a file is markup, or an order to the terminal."""
    name = "[bold]x[/] :smile: $(id) \x1b[31m \u202e ]"
    ended = subprocess.run(command(tmp_path, "--name", name), capture_output=True, text=True, check=False)
    assert ended.stdout.count("[bold]x[/] :smile: $(id) \\x1b[31m \\u202e ]") == 2


def test_there_is_one_console_and_it_knows_no_markup() -> None:
    """Law: whatever either command prints goes through `PlainConsole`; nothing else would have to escape names."""
    root = Path(__file__).parents[2]
    for path in [*(root / "ident").rglob("*.py"), *(root / "plan").rglob("*.py")]:
        text = path.read_text(encoding="utf-8")
        assert "rich.markup" not in text, path
        assert "TextColumn" not in text or text.count('TextColumn("{task.description}", markup=False)') == 1, path
        if path.name != "console.py" or path.parent.name != "ident":
            assert not re.search(r"(?<!Plain)\bConsole\(", text), path


def test_commands_that_run_python_say_so() -> None:
    """Law: every `--catalogue`, in its help; and the README."""
    commands = {**typer.main.get_command(ident_app.app).commands, **typer.main.get_command(plan_app.app).commands}  # type: ignore[attr-defined]
    helps = [one.help for command in commands.values() for one in command.params if one.name == "catalogue"]
    assert len(helps) >= 3
    assert all("is run" in text for text in helps)
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    assert re.search(r"--catalogue.*runs that file as Python", readme)


def test_bytes_that_are_not_utf8_are_shown_as_bytes() -> None:
    assert visible(os.fsdecode(b"a\xffb\x00\n")) == "a\\xffb\\x00\\x0a"
    assert visible("joint_1 ± 0.1 [N m], Gelenk ü, 関節") == "joint_1 ± 0.1 [N m], Gelenk ü, 関節"


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_amid_the_work_is_one_line(tmp_path: Path, number: signal.Signals, turned: bool) -> None:
    """Law: also where a library turns it into an error of its own."""
    work = "try:\n        time.sleep(wait)\n    except BaseException:\n        raise RuntimeError"
    line = command(tmp_path, "--wait", "20", app=APP.replace("time.sleep(wait)", work) if turned else APP)

    def unignored() -> None:  # as from a terminal: tests may run under `nohup`
        signal.signal(number, signal.SIG_DFL)

    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=unignored)
    process.stderr.readline()
    process.send_signal(number)
    assert process.stderr.read() == "ident: stopped\n"
    assert process.wait() == 128 + number


@pytest.mark.parametrize(
    "ending", ["time.sleep(20)", "try:\n    time.sleep(20)\nexcept BaseException:\n    raise ImportError"]
)
def test_a_signal_amid_the_imports_is_one_line(tmp_path: Path, ending: str) -> None:
    app = f"import os, time\nos.write(2, b'loading\\n')\n{ending}\n"
    process = subprocess.Popen(command(tmp_path, app=app), stderr=subprocess.PIPE, text=True)
    process.stderr.readline()
    process.send_signal(signal.SIGINT)
    assert process.stderr.read() == "ident: stopped\n"
    assert process.wait() == 130


AT_AN_IMPORT = """
import importlib, os, signal, sys
class Stop:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Stop())
sys.argv = [{package!r}, "--help"]
importlib.import_module({package!r} + ".cli.start").main()
"""


@pytest.mark.parametrize("package", ["ident", "plan"])
@pytest.mark.parametrize("module", ["ident.process", "ident.errors", "typing", "typer", "{package}.cli.app"])
def test_a_signal_at_any_import_of_a_command_is_one_line(package: str, module: str) -> None:
    """Law: of both commands, from their first module on; what Python itself does before it has read one is Python's."""
    script = AT_AN_IMPORT.format(package=package, module=module.format(package=package))
    ended = subprocess.run(
        [sys.executable, "-S", "-c", f"import sys; sys.path = {sys.path!r}\n{script}"], capture_output=True, text=True
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", f"{package}: stopped\n")


@pytest.mark.parametrize("package", ["ident", "plan"])
def test_next_to_nothing_is_loaded_before_a_signal_is_heard(package: str) -> None:
    script = f"import sys; before = set(sys.modules); import {package}.cli.start; print(*set(sys.modules) - before)"
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert len({name for name in ended.stdout.split() if name.split(".")[0] in ("ident", "plan")}) <= 7
    assert not {"typing", "logging", "numpy", "typer"} & set(ended.stdout.split())


def test_a_library_that_does_not_fit_in_memory_is_told_in_one_line(tmp_path: Path) -> None:
    """What the system's loader says where it can't map a library, as a command begins."""
    app = 'raise ImportError("_core.so: failed to map segment from shared object")'
    ended = subprocess.run(command(tmp_path, app=app), capture_output=True, text=True)
    assert ended.returncode == 74
    assert ended.stderr.splitlines() == ["ident: memory is full; give fewer or shorter sessions, or a larger machine"]
