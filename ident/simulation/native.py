"""MuJoCo's step as a C call from compiled loops: a Python call a step would cost more than the dynamics."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@cache
def step_address() -> int:
    """Address of `mj_step(const mjModel*, mjData*)` in the library that the mujoco package has loaded."""
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    library = next(path for name in names for path in sorted(folder.glob(name)))
    address = ctypes.cast(ctypes.CDLL(str(library)).mj_step, ctypes.c_void_p).value
    assert address is not None
    return address


@intrinsic
def call_step(_context: Any, function: Any, model: Any, data: Any) -> Any:
    """Calls the function at an address with two pointers.

    Addresses are arguments, not constants, so that compiled code may be cached from process to process.
    """
    signature = types.void(types.intp, types.intp, types.intp)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer, pointer])
        target = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(target, [builder.inttoptr(argument, pointer) for argument in arguments[1:]])
        return context.get_dummy_value()

    return signature, generate
