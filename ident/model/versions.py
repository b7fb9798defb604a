"""Versions of the libraries behind a fitted model, kept with it."""

from __future__ import annotations

import importlib.metadata
import platform

LIBRARIES = ("armgap", "numpy", "scipy", "torch", "pin", "cvxpy")


def read_versions() -> dict[str, str]:
    """Version of each library, and of Python; `unknown` where one is not installed as a package."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found
