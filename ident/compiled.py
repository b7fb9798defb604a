"""Compiled loops whose machine code is kept: only the process that compiles one loads the compiler.

numba takes a second of processor time to load, with every kernel cached; most commands spend less on their work. A
kernel is compiled by numba once for a machine, its object code is written beside the module, and from then on LLVM's
linker loads it in milliseconds. Kernels write into arrays that are handed to them: they allocate nothing and return
nothing, so that their code needs no runtime of numba's.

Source: numba's developer manual, "Numba architecture" (a native function takes the addresses of its result and of its
error, then every array as meminfo, parent, size, item size, data, shape and strides, and returns a status).
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

# Layout of the kept files; another one makes all of them anew.
LAYOUT = "1"
Function = Callable[..., Any]
ADDRESS, COUNT = ctypes.c_void_p, ctypes.c_ssize_t
# Functions outside that a kernel's code may call: those of the mathematical library, and what copies and fills memory.
OUTSIDE = frozenset(("sqrt", "exp", "log", "pow", "sin", "cos", "tanh", "memcpy", "memmove", "memset"))
_linking = threading.Lock()


class Kernel:
    """A function of double arrays (C order) and numbers, compiled when it is first called.

    Attributes:
        python: The function itself.
        arguments: Kinds of its arguments, see `compiled`.
        helpers: Functions of the same module that it calls, each after those that it calls itself.
    """

    def __init__(self, python: Callable[..., None], arguments: str, helpers: tuple[Function, ...] = ()) -> None:
        self.python = python
        self.arguments = tuple(arguments.split())
        self.helpers = helpers
        self._native: Callable[..., int] | None = None
        self._engine: Any = None  # owns the machine code

    def __call__(self, *values: Any) -> None:
        """Runs it.

        Raises:
            TypeError: An argument is not of the kind that it was compiled for.
        """
        if self._native is None:
            with _linking:
                if self._native is None:
                    self._link()
        assert self._native is not None
        if len(values) != len(self.arguments):
            raise TypeError(f"{self.python.__name__} takes {len(self.arguments)} arguments, not {len(values)}")
        none = ctypes.c_void_p()
        flat: list[Any] = [ctypes.byref(none), ctypes.byref(none)]
        for kind, value in zip(self.arguments, values, strict=True):
            flat += _flatten(kind, value)
        status = self._native(*flat)
        assert status == 0, f"{self.python.__name__} ended with status {status}"

    def _link(self) -> None:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        name, code = self._machine_code(llvm)
        machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        types = [one for kind in self.arguments for one in _types(kind)]
        prototype = ctypes.CFUNCTYPE(ctypes.c_int32, ADDRESS, ADDRESS, *types)
        self._engine, self._native = engine, prototype(engine.get_function_address(name))

    def _machine_code(self, llvm: Any) -> tuple[str, bytes]:
        """Name of the entry and object code, kept ones or new ones."""
        source = Path(self.python.__code__.co_filename)
        traits = (LAYOUT, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(), sys.platform)
        version = f"{'.'.join(map(str, llvm.llvm_version_info))} {sys.version_info[:2]}"
        content = source.read_bytes() + repr((self.arguments, traits, version)).encode()
        file = f"{source.stem}.{self.python.__name__}-{hashlib.sha256(content).hexdigest()[:20]}.kernel"
        # Beside the module, or, where nobody may write there, in the user's cache.
        folders = [one for one in (source.parent / "__pycache__", user_cache()) if one]
        for folder in folders:
            if (kept := _read(folder / file)) is not None:
                return kept
        name, code = _compile(self.python, self.arguments, self.helpers, llvm)
        any(_write(folder / file, name, code) for folder in folders)
        return name, code


def compiled(arguments: str, *helpers: Function) -> Callable[[Callable[..., None]], Kernel]:
    """Makes a function a kernel.

    Args:
        arguments: Kind of each argument: `f` a number, `i` a count, `f1`, `f2`, `f3` arrays of so many dimensions.
        helpers: Plain functions of the same module that it calls, each after those that it calls itself.
    """
    return lambda python: Kernel(python, arguments, helpers)


def _flatten(kind: str, value: Any) -> tuple[Any, ...]:
    if kind == "f":
        return (float(value),)
    if kind == "i":
        return (int(value),)
    right = isinstance(value, np.ndarray) and value.dtype == np.float64 and value.ndim == int(kind[1:])
    if not right or not value.flags.c_contiguous or not value.flags.aligned:
        raise TypeError(f"a kernel's {kind} is a C-contiguous array of doubles with {kind[1:]} dimensions")
    return (None, None, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)


def _types(kind: str) -> list[Any]:
    if kind in "fi":
        return [ctypes.c_double if kind == "f" else COUNT]
    return [ADDRESS, ADDRESS, COUNT, COUNT, ADDRESS] + [COUNT] * (2 * int(kind[1:]))


def _compile(
    python: Callable[..., None], arguments: Iterable[str], helpers: tuple[Function, ...], llvm: Any
) -> tuple[str, bytes]:
    """Object code of a function, without numba's ways in from Python."""
    from numba import njit, types

    names = dict(python.__globals__)
    for helper in helpers:
        names[helper.__name__] = njit(error_model="numpy")(FunctionType(helper.__code__, dict(names)))

    kinds = {"f": types.float64, "i": types.intp}
    signature = tuple(kinds.get(kind) or types.Array(types.float64, int(kind[1:]), "C") for kind in arguments)
    function = njit(error_model="numpy")(FunctionType(python.__code__, names, python.__name__))
    function.compile(signature)
    entry: Any = function.overloads[signature]
    name = entry.fndesc.llvm_func_name
    module = llvm.parse_assembly(function.inspect_llvm(signature))
    for one in module.functions:
        if not one.is_declaration and one.name != name:
            one.linkage = "internal"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    target = llvm.Target.from_default_triple()
    machine = target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3, jit=True
    )
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    missing = {one.name for one in (*module.functions, *module.global_variables) if one.is_declaration}
    missing = {one for one in missing if not one.startswith("llvm.") and one not in OUTSIDE}
    if missing:
        raise RuntimeError(f"{python.__name__} needs {', '.join(sorted(missing))}: a kernel may not allocate or raise")
    return name, machine.emit_object(module)


def user_cache() -> Path | None:
    """The folder of what can be made anew; None where others may write: what lies there is run, or believed."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    # A container's user may have no home.
    folder = Path(home if os.path.isabs(home) else tempfile.gettempdir()) / "armgap"
    try:
        if not os.path.lexists(folder):
            folder.mkdir(mode=0o700, parents=True)
        found = folder.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022
    return folder if private else None


def _read(path: Path) -> tuple[str, bytes] | None:
    """A kept kernel: a digest of the rest, the entry's name and the code; None where there is no whole one."""
    try:
        digest, name, code = path.read_bytes().split(b"\n", 2)
    except (OSError, ValueError):
        return None
    return (name.decode(), code) if hashlib.sha256(name + code).hexdigest().encode() == digest else None


def _write(path: Path, name: str, code: bytes) -> bool:
    """Keeps a kernel for the processes to come; False where it can't."""
    whole = hashlib.sha256(name.encode() + code).hexdigest().encode() + b"\n" + name.encode() + b"\n" + code
    part = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(whole)
        part.replace(path)
    except OSError:
        return False
    return True
