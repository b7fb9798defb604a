"""A folder full of files that libraries would obey, and a watch over it and over the processes that are started."""

from __future__ import annotations

import ctypes
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Settings, plugins, credentials and libraries that some library of ours, or its own libraries, looks for somewhere.
SETTINGS = {
    "ipopt.opt": "output_file victim.txt\nhsllib ./evil.so\n",
    "cma_signals.in": '{"timeout": 0, "maxiter": 1}\n',
    "je_arrow_malloc.conf": "narenas:1\n",
    "matplotlibrc": "text.usetex: True\nbackend: module://evil\n",
    "pyproject.toml": "[tool.numba]\n[tool.pytest.ini_options]\n",
    "setup.cfg": "[tool:pytest]\n",
    "mkdocs.yml": "hooks: [evil.py]\n",
    ".env": "PYTHONPATH=.\n",
    ".netrc": "machine localhost login evil password evil\n",
    "_netrc": "machine localhost login evil password evil\n",
    ".pythonrc.py": "open('RUN', 'w')\n",
    ".python-version": "2.7\n",
    "pyvenv.cfg": "home = .\n",
    "evil.pth": "import evil\n",
    "dask.yaml": "distributed: {worker: {preload: [evil]}}\n",
    ".dask.yaml": "distributed: {worker: {preload: [evil]}}\n",
    ".numba_config.yml": "disable_jit: 1\n",
    "plugInfo.json": '{"Includes": ["plugin/"]}\n',
    "ort_config.json": '{"session_options": {"enable_profiling": true}}\n',
    "mime.types": "text/evil html\n",
    "logging.conf": "[loggers]\nkeys=root\n",
    "tornado.conf": "logging = 'debug'\n",
    ".env.local": "BROWSER=evil\n",
    "distributed.yaml": "distributed: {scheduler: {preload: [evil]}}\n",
    "jupyter_config.py": "open('RUN', 'w')\n",
    "fonts.conf": "<fontconfig/>\n",
    "openssl.cnf": "openssl_conf = evil\n",
    "mosek.lic": "evil\n",
    "gurobi.lic": "evil\n",
    "gurobi.env": "LogFile victim.txt\n",
    "highs.options": "log_file = victim.txt\n",
    "scip.set": "evil\n",
    "rerun.toml": "evil = true\n",
    "package.xml": "<package/>\n",
    "arm.xacro": "<robot/>\n",
    "tm5-900": "<robot/>\n",
    "panda": "<robot/>\n",
    "torch_extensions.cpp": "evil\n",
    "MUJOCO_LOG.TXT": "precious\n",
    "mjkey.txt": "evil\n",
    "victim.txt": "precious\n",
    "session.toml": "robot = 1\n",
    "settings.toml": "evil = 1\n",
    "sitecustomize.pth": "import evil\n",
    ".sqliterc": ".load ./evil.so\n",
    ".pxrrc": "import evil\n",
    "assets.xml": "<mujoco/>\n",
    "robot.urdf": "<robot/>\n",
    "parameters.toml": "evil = 1\n",
    "unnamed.toml": "evil = 1\n",
    "records.toml": "evil = 1\n",
    "answers.json": "{}\n",
    "board.json": "{}\n",
}
LIBRARIES = ("evil", "libhsl", "libcoinhsl", "libpardiso", "libma27", "libipopt", "libglfw", "libmujoco", "libcoal")
LIBRARIES += ("libcasadi_nlpsol_ipopt", "libcasadi_linsol_ma27", "libopenblas", "libgomp", "libtbb", "libsvml")
LIBRARIES += ("libassimp", "libarrow", "libcuda", "libnuma", "libEGL", "libOSMesa")
LIBRARIES += ("libelasticity", "libactuator", "libobj_decoder", "libstl_decoder", "libsdf_plugin", "libsqlite3")
LIBRARIES += ("libusd_ms", "libonnxruntime_providers_cuda", "libonnxruntime_providers_shared")
FOLDERS = ("plugin", "plugins", "mujoco_plugin", "share", "lib", "etc", "__pycache__", ".dask", ".config", ".cache")
FOLDERS += ("outcmaes", ".mujoco", ".matplotlib", ".jupyter", "stylelib", "locale", "cmeel.prefix", "numba_cache")
FOLDERS += ("templates",)
MODULES = ("usercustomize", "evil", "_ops", "_classes")
MODULE = "open('RUN', 'a').write(__name__)\n"
# Notes what Python starts, in every Python process.
HOOK = """
import os, sys

def hear(event, arguments, log=os.environ["TRAP_LOG"]):
    if event in ("subprocess.Popen", "os.exec", "os.posix_spawn", "os.spawn", "os.system", "pty.spawn"):
        handle = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(handle, (repr(arguments[:2])[:300] + "\\n").encode())
        os.close(handle)

sys.addaudithook(hear)
"""
# Of inotify(7): what happens in a folder, and the head of what tells it (watch, mask, cookie, length of the name).
OPENED, CHANGED, IS_FOLDER = 0x21, 0xFCE, 0x40000000
# Of what strace writes: a call that names a file from where the process stands, or from the root.
NAMED = re.compile(r'\w+\((?:AT_FDCWD, )?"((?:[^"\\]|\\.)+)"')
STARTS = ("execve(", "execveat(")
OUR_CACHE = ".cache/armgap"
HEAD = struct.Struct("iIII")


@dataclass
class Seen:
    """What was seen of a command."""

    status: int = 0
    output: str = ""
    touched: list[str] = field(default_factory=list)  # names in the trap folder that were opened or changed
    started: list[str] = field(default_factory=list)  # processes
    # Names in the trap folder that were looked for, whether there is such a file or not; none without strace.
    looked: set[str] = field(default_factory=set)
    homed: list[str] = field(default_factory=list)  # files in the user's home that are not in this package's cache
    called: list[str] = field(default_factory=list)  # connections that were opened; none without strace


def set_traps(folder: Path) -> None:
    """Fills a folder."""
    folder.mkdir()
    for name, text in SETTINGS.items():
        (folder / name).write_text(text)
    for name in LIBRARIES:
        for ending in (".so", ".so.1", ".so.3"):
            (folder / f"{name}{ending}").write_bytes(b"\x7fELF evil")
    for name in FOLDERS:
        (folder / name).mkdir()
    for name in sorted({*sys.stdlib_module_names, *packages_distributions(), *MODULES}):
        if name.isidentifier():
            (folder / f"{name}.py").write_text(MODULE)


def run_among_traps(
    command: str,
    arguments: Sequence[object],
    traps: Path,
    place: Path,
    meanwhile: Callable[[str], None] | None = None,
) -> Seen:
    """Runs `ident` or `plan` in a folder of traps.

    Args:
        command: `ident` or `plan`.
        arguments: Its arguments.
        traps: The folder.
        place: An empty folder for what the watch needs, and for the user's home.
        meanwhile: Where the command goes on until it is interrupted: called with its first line,
            then it is interrupted.
    """
    place.mkdir()
    log, hook = place / "started", place / "hook"
    hook.mkdir()
    (place / "home").mkdir()
    (hook / "sitecustomize.py").write_text(HOOK)
    environment = {
        **os.environ,
        "HOME": str(place / "home"),
        "PYTHONPATH": os.pathsep.join([str(hook), str(ROOT)]),
        "TRAP_LOG": str(log),
        "NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR", ""),
    }
    start = f"import sys; sys.argv[0] = {command!r}; from {command}.cli.start import main; main()"
    line = [sys.executable, "-P", "-c", start, *map(str, arguments)]
    trace = place / "trace"
    seen = Seen()
    with watching(traps, seen):
        seen.status, seen.output = _run([*_tracer(trace), *line], traps, environment, meanwhile)
    seen.started = log.read_text().splitlines() if log.exists() else []
    if trace.exists():
        calls = trace.read_text(errors="replace").splitlines()
        programs = [call for call in calls if call.endswith("= 0") and any(name in call for name in STARTS)]
        seen.started += programs[1:]  # the first is the command itself
        seen.looked = names_within(calls, traps)
        seen.called = [call for call in calls if " connect(" in call and "AF_INET" in call]
    seen.homed = files_without_cache(place / "home")
    return seen


def files_without_cache(home: Path) -> list[str]:
    """Files in a home, but for those in the cache that is this package's own."""
    files = [path for path in sorted(home.rglob("*")) if path.is_file()]
    return [str(path.relative_to(home)) for path in files if not path.is_relative_to(home / OUR_CACHE)]


def names_within(calls: Sequence[str], folder: Path) -> set[str]:
    """First parts of the names in a folder, where the process stands, that calls to the system ask for.

    Args:
        calls: Lines of strace.
        folder: The folder.
    """
    names = set()
    for call in calls:
        named = NAMED.search(call)
        if named is None or any(start in call for start in STARTS):
            continue
        path = Path(os.path.normpath(folder / named[1]))
        if path != folder and path.is_relative_to(folder):
            names.add(path.relative_to(folder).parts[0])
    return names


def _run(
    line: Sequence[str],
    folder: Path,
    environment: dict[str, str],
    meanwhile: Callable[[str], None] | None,
) -> tuple[int, str]:
    """Status and output of a command line, which is interrupted after `meanwhile`, if that is given."""
    process = subprocess.Popen(
        line,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # Whoever runs these tests in the background may have them ignore interrupts, and so all that they start.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    first = ""
    if meanwhile is not None and process.stdout is not None:
        first = process.stdout.readline()
        try:
            meanwhile(first)
        finally:
            os.killpg(process.pid, signal.SIGINT)
    rest, _ = process.communicate()
    return process.returncode, first + rest


def _tracer(trace: Path) -> list[str]:
    """What sees the processes that libraries start below Python; nothing where it can't be had."""
    program = shutil.which("strace")
    if program is None:
        return []
    line = [program, "-f", "--seccomp-bpf", "-qq", "-e", "trace=%file,execve,execveat,connect", "-e", "signal=none"]
    line += ["-o", str(trace)]
    allowed = subprocess.run([*line, "true"], capture_output=True, check=False).returncode == 0
    trace.unlink(missing_ok=True)
    return line if allowed else []


@contextmanager
def watching(folder: Path, seen: Seen) -> Iterator[None]:
    """Notes what any process opens or changes in a folder, libraries below Python too."""
    library = ctypes.CDLL(None, use_errno=True)
    handle = library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
    if handle < 0 or library.inotify_add_watch(handle, os.fsencode(folder), OPENED | CHANGED) < 0:
        raise OSError(ctypes.get_errno(), "inotify")
    try:
        yield
        seen.touched += _names(handle)
    finally:
        os.close(handle)


def _names(handle: int) -> list[str]:
    names = []
    while True:
        try:
            events = os.read(handle, 1 << 16)
        except BlockingIOError:
            return names
        place = 0
        while place < len(events):
            _, mask, _, length = HEAD.unpack_from(events, place)
            name = os.fsdecode(events[place + HEAD.size : place + HEAD.size + length].rstrip(b"\0"))
            names.append(name or ("the folder" if mask & IS_FOLDER else "?"))
            place += HEAD.size + length


def told(seen: Seen) -> str:
    """What a failing test shows."""
    beyond = [sorted(seen.looked), seen.homed[:20], seen.called[:5]]
    return json.dumps([seen.status, seen.touched[:20], seen.started[:5], beyond, seen.output[-600:]], indent=1)
