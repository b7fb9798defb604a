"""What the libraries that a command loads would read by themselves, and what keeps them from it.

`docs/security.md` lists each library, what it reads and from where.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from ident.errors import InputError
from ident.user_cache import user_cache

# Settings of numba's, which it takes from the folder where it is loaded.
NUMBA_FILE = ".numba_config.yaml"
# Matplotlib's name of a file of parameters, which it takes from that folder before any other.
MATPLOTLIB_FILE = "matplotlibrc"
# Variables of the environment that a module reads while it is loaded, and what it reads there
# instead: matplotlib its file of parameters, a module that it imports for its windows, and whether
# it starts a program that lists fonts; MuJoCo whether it starts a process that loads GLFW.
READ_AT_LOADING = {
    "matplotlib": {
        "MATPLOTLIBRC": str(Path(__file__).parent / "show" / MATPLOTLIB_FILE),
        "MPLBACKEND": "agg",
    },
    "matplotlib.font_manager": {"MPL_IGNORE_SYSTEM_FONTS": "1"},
    "mujoco": {"MUJOCO_GL": "disable"},
}
# Without it ONNX Runtime makes an identifier in the user's home, and reports its use to its makers;
# it asks once.
WITHOUT_REPORTS = {"ORT_DISABLE_TELEMETRY": "1"}
# Folder of styles and lists of fonts, in this package's cache: those of the user stay as they are.
MATPLOTLIB_FOLDER = "matplotlib"


def keep_own_settings() -> None:
    """Lets this process and those that it starts take nothing from the folder where they are
    started.

    Raises:
        InputError: A file lies there that a library would read, whatever we do.
    """
    os.environ.setdefault("PYTHONSAFEPATH", "1")
    if os.path.lexists(NUMBA_FILE):
        raise InputError(
            NUMBA_FILE,
            "numba would take its settings from this file",
            "start the command elsewhere",
        )
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


def load_onnxruntime() -> ModuleType:
    """ONNX Runtime, which reports nothing to anybody.

    Raises:
        ImportError: It is not installed.
    """
    with _variables(WITHOUT_REPORTS):
        return import_module("onnxruntime")


class _Finder(MetaPathFinder):
    """Finds modules where Python does, and has some of them loaded without a look at the folder."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of a module of `READ_AT_LOADING`; None for every other."""
        if fullname not in READ_AT_LOADING:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    """Loads a module that reads settings while it is loaded: those of this package."""

    def exec_module(self, module: ModuleType) -> None:
        """Runs the module."""
        with _no_file(MATPLOTLIB_FILE), _variables(READ_AT_LOADING[self.name]):
            super().exec_module(module)
        if self.name == "matplotlib":
            _choose_folders(module)


def _choose_folders(matplotlib: Any) -> None:
    """Settles where matplotlib's styles and its list of fonts are; it asks once."""
    cache = user_cache()
    if cache is None:
        return
    with _variables({"MPLCONFIGDIR": str(cache / MATPLOTLIB_FOLDER)}):
        matplotlib.get_configdir()
        matplotlib.get_cachedir()


@contextmanager
def _no_file(name: str) -> Iterator[None]:
    """For a block, nothing of a name is there in the folder; files of that name elsewhere are as
    before.
    """
    exists = os.path.exists

    def exists_elsewhere(path: str | bytes | os.PathLike[str] | int) -> bool:
        return path != name and exists(path)

    os.path.exists = exists_elsewhere  # type: ignore[assignment]
    try:
        yield
    finally:
        os.path.exists = exists


@contextmanager
def _variables(values: Mapping[str, str]) -> Iterator[None]:
    """For a block, some variables of the environment have other values; what this process starts
    has the user's.
    """
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            del os.environ[name]
            if value is not None:
                os.environ[name] = value
