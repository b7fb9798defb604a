"""Commands in a folder full of files that libraries would obey: nothing is read there, nothing is started.

`docs/security.md` lists what each library reads by itself.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from plan.planners.reference import Reference
from tests.plan.worlds import ledger, problem

ROOT = Path(__file__).parents[1]
PRECIOUS = "what is precious"
IPOPT_OPTIONS = "output_file victim.txt\nfile_print_level 12\nhsllib ./evil.so\nlinear_solver ma27\n"
MATPLOTLIB_PARAMETERS = "text.usetex: True\ntext.latex.preamble: \\input{evil}\nbackend: module://evil\n"
DRAWING = """
from pathlib import Path

def app(**given):
    from ident.show.report.figures import make_panel, to_svg
    figure, axes = make_panel("x", "y")
    axes.plot([0, 1], [0, 1])
    Path("page.svg").write_text(to_svg(figure, "a line"))
    from plan.show.pictures import plt, save_figure
    figure, axes = plt.subplots()
    axes.plot([0, 1], [0, 1])
    save_figure(figure, Path("plan.svg").absolute())
"""
PROGRAM = "#!/bin/sh\necho started >> {log}\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in which the test stands."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_gradient_reference_reads_no_options_of_the_folder(folder: Path) -> None:
    """Law: an `ipopt.opt` empties no file, loads no library and changes no plan."""
    task = problem(vias=2, duration=0.9, grows=False)
    before = Reference(starts=1).run([task], ledger(), np.random.default_rng(0)).best
    (folder / "ipopt.opt").write_text(IPOPT_OPTIONS)
    (folder / "victim.txt").write_text(PRECIOUS)
    after = Reference(starts=1).run([task], ledger(), np.random.default_rng(0)).best
    assert (folder / "victim.txt").read_text() == PRECIOUS
    assert after.cost == before.cost


def test_pictures_obey_no_parameters_of_the_folder_nor_of_the_user(folder: Path) -> None:
    """Law: a `matplotlibrc` starts no LaTeX, imports nothing and changes no picture."""
    for name in ("before", "after", "apps", "programs", "home/.config/matplotlib"):
        (folder / name).mkdir(parents=True)
    (folder / "apps/drawing.py").write_text(DRAWING)
    started = folder / "started"
    for name in ("latex", "dvipng", "dvisvgm", "kpsewhich"):
        program = folder / "programs" / name
        program.write_text(PROGRAM.format(log=started))
        program.chmod(0o755)
    environment = {
        **os.environ,
        "HOME": str(folder / "home"),
        "PATH": f"{folder / 'programs'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder / "apps")]),
    }
    line = [sys.executable, "-P", "-c", "from ident.process import run_command; run_command('ident', 'drawing')"]
    subprocess.run(line, check=True, cwd=folder / "before", env=environment)
    (folder / "after/matplotlibrc").write_text(MATPLOTLIB_PARAMETERS)
    (folder / "after/evil.py").write_text(f"open({str(started)!r}, 'w')")
    (folder / "home/.config/matplotlib/matplotlibrc").write_text("text.usetex: True\nlines.linewidth: 9\n")
    subprocess.run(line, check=True, cwd=folder / "after", env={**environment, "MPLBACKEND": "module://evil"})
    assert not started.exists()
    for name in ("page.svg", "plan.svg"):
        assert (folder / "after" / name).read_bytes() == (folder / "before" / name).read_bytes()
