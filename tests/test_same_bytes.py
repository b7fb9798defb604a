"""Same recordings, same bytes: whatever the threads, the locale, the order of files and Python's own hashes."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from ident.robot.names import data_path

ROOT = Path(__file__).parents[1]
E1 = Path(data_path("logs/tm5_900")) / "E1"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def result(folder: Path, reverse: bool, **environment: str) -> dict[str, Any]:
    """What a fit says of a copy of a session, without its origin and the paths in it."""
    session = folder / "session"
    session.mkdir(parents=True)
    for file in sorted(E1.iterdir(), reverse=reverse):
        shutil.copyfile(file, session / file.name)
    start = "import sys; sys.argv[0] = 'ident'; from ident.cli.start import main; main()"
    out = folder / "fit.json"
    words = ["fit", session, "--net", "none", "--out", folder / "model", "--json", out]
    given = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    subprocess.run([sys.executable, "-P", "-c", start, *map(str, words)], env=given, check=True, capture_output=True)
    record = json.loads(out.read_text())
    del record["provenance"]
    text = json.dumps(record).replace(str(folder), "")
    return dict(json.loads(text))


def test_a_fit_is_the_same_on_other_threads_and_in_another_order(tmp_path: Path) -> None:
    one = result(tmp_path / "one", False, **dict.fromkeys(THREADS, "1"), PYTHONHASHSEED="1", LC_ALL="C")
    other = result(tmp_path / "other", True, **dict.fromkeys(THREADS, "4"), PYTHONHASHSEED="2", LC_ALL="C.UTF-8")
    assert one == other
