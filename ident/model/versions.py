"""Versions of the libraries behind a fitted model, kept with it."""

from __future__ import annotations

import importlib.metadata
import platform

LIBRARIES = ("armgap", "numpy", "scipy", "torch", "pin", "cvxpy")


def read_versions() -> dict[str, str]:
    """Version of each library, and of Python; `unknown` where one is not installed as a package."""
    return {name: _version(name) for name in LIBRARIES} | {"python": platform.python_version()}


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "unknown"
