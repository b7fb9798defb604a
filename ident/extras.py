"""Packages beyond the core: which extra of armgap brings each, and the line for one that is missing."""

from __future__ import annotations

from ident.errors import InputError

# Importable name -> extra of pyproject.toml. The core checks, fits without a net, diagnoses and writes pages.
EXTRA_OF = {
    **dict.fromkeys(("torch", "safetensors", "filterpy"), "net"),
    **dict.fromkeys(("mujoco", "example_robot_data"), "sim"),
    "rerun": "view",
    **dict.fromkeys(("rosbags", "xacro", "yaml", "lz4", "backports"), "bags"),
    **dict.fromkeys(("coal", "casadi", "cma", "daqp", "toppra", "plyfile", "pypcd4", "ruckig"), "plan"),
    **dict.fromkeys(("joblib", "distributed", "pydantic", "typing_extensions"), "monitor"),
}


def missing_extra(error: BaseException | None) -> InputError | None:
    """What to tell the user where a package of an extra is not installed; None where something else is wrong.

    Args:
        error: What an import raised, or what was raised from that.
    """
    while error is not None:
        package = (getattr(error, "name", None) or "").partition(".")[0] if isinstance(error, ImportError) else ""
        if package in EXTRA_OF:
            extra = EXTRA_OF[package]
            return InputError(
                package, "this package is not installed", f'pip install "armgap[{extra}]", or armgap[all]'
            )
        error = error.__cause__ or error.__context__
    return None
