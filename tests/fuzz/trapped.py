"""Session folders in which something lies beside the runs: pipes, links, folders named as files, names that mislead."""

import os
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

# How something is put where a file would be.
PUT: tuple[Callable[[Path], object], ...] = (
    os.mkfifo,
    Path.mkdir,
    Path.touch,
    lambda path: path.symlink_to("/etc/passwd"),
    lambda path: path.symlink_to("/dev/zero"),
    lambda path: path.symlink_to(path.name),
    lambda path: path.symlink_to(".."),
    lambda path: path.write_bytes(b"\x00" * 64),
    lambda path: path.write_text("{"),
)
# Names that some reader takes notice of, or that should not pass for anything else.
NAMES = ("session.toml", "metadata.yaml", "run.parquet", "02.csv", "03.npz", "meta", "data", "a.mcap", "a.db3", "a.bag")
NAMES += (
    ".armgap.json",
    ".hidden.parquet",
    "cma_signals.in",
    "ipopt.opt",
    "matplotlibrc",
    "conftest.py",
    "meta/info.json",
)
NAMES += ("=1+1.csv", "\x1b[31m.csv", "two\nlines.parquet", "é\u202e.csv", "-rf.csv", "%2e%2e.parquet", "x" * 250)
NAMES += ("settings.toml", ".numba_config.yaml", "sitecustomize.py", "file.parquet.part", "..csv", "a.parquet.zip")


def lay_traps(seed: bytes, run: Path, folder: Path) -> Path:
    """Makes a session folder of one sound run and some traps, all of which follow from some bytes.

    Args:
        seed: The bytes.
        run: The sound run.
        folder: What is made; what was there goes.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "01.parquet").write_bytes(run.read_bytes())
    rng = np.random.default_rng(zlib.crc32(seed))
    for _ in range(int(rng.integers(1, 5))):
        path = folder / NAMES[int(rng.integers(len(NAMES)))]
        if not os.path.lexists(path.parent):
            path.parent.mkdir()
        if path.parent.is_dir() and not os.path.lexists(path):
            PUT[int(rng.integers(len(PUT)))](path)
    return folder
