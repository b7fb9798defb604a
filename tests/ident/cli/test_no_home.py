"""A container's user may have neither a home nor a name."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ident.robot.names import data_path

# Nobody knows the user, as in a container that was started with a number of its own.
NAMELESS = """
import os, pwd, sys
def unknown(number):
    raise KeyError(f"getpwuid(): uid not found: {number}")
pwd.getpwuid = unknown
os.getuid = lambda: 54321
"""
TRAINING = """
import numpy as np
from ident.model.residual_net import fit_residual_net
states = np.random.default_rng(0).normal(size=(4, 60, 2))
fit_residual_net([tuple(states)], [0.1 * states[3]])
"""
COMMAND = "from ident.cli.start import main\nmain()\n"
RUN = "logs/tm5_900/E1/01_trajectory_1.parquet"


@pytest.mark.parametrize("code", [TRAINING, COMMAND])
def test_who_has_no_home_and_no_name_is_served(code: str, tmp_path: Path) -> None:
    """Reading, compiling, a page and the training of a net: exit 0, no traceback, no word of the home."""
    gone = {"HOME", "USER", "LOGNAME", "LNAME", "USERNAME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"}
    kept = {name: value for name, value in os.environ.items() if name not in gone}
    paths = {"PYTHONPATH": str(Path(__file__).parents[3])}
    arguments = ["view", str(data_path(RUN)), "--robot", "tm5-900", "--rrd", str(tmp_path / "view.rrd")]
    done = subprocess.run(
        [sys.executable, "-c", NAMELESS + code, *arguments],
        cwd=tmp_path,
        env={**kept, **paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, "Traceback" in done.stderr, "HOME" in done.stderr) == (0, False, False), done.stderr
