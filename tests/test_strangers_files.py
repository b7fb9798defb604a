"""Files of a stranger, used as the commands use them: nothing of them is run, nothing elsewhere is read or written.

An audit hook of Python's own hears every file that is opened and every program that is started.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from ident.api.inspecting import inspect
from ident.command_options import FitOptions
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.write import write_export, write_patch
from ident.fitting.fit import fit_hybrid
from ident.model.hybrid import HybridModel
from ident.process import USER
from ident.robot.arm import ArmModel
from ident.robot.names import data_path
from ident.sessions import open_sessions
from plan.api.planning import open_task
from plan.geometry.arm_shapes import arm_shapes
from plan.geometry.obstacle_files import read_mesh
from plan.problem.task_file import load_surroundings
from tests import traps
from tests.fuzz.guard import Guard
from tests.fuzz.samples import CUBE, obj, shaped
from tests.ident.export.diagnoses import write_diagnosis
from tests.ident.export.test_patch_hostile import hostile_arm

ROOT = Path(__file__).parents[1]
# Runs as Python, in a shell, in a template, in a macro, in a page; leaves a text of its language.
TEXT = (
    "\"\"\"'''{__import__('os').system('touch RUN')}$(touch RUN)`touch RUN`${().__class__}{{ 7 * 7 }}<script>[/x] %s \\"
)
SECRET = "secret.txt"
Folder = Path


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """What a stranger gave: a robot, its session, model, diagnosis and scene, all called after hostile text."""
    folder = tmp_path_factory.mktemp("given")
    arm = hostile_arm(folder, TEXT)
    names = dict(zip(ArmModel.load("tm5-900").joint_names, arm.joint_names, strict=True))
    (folder / "session").mkdir()
    for file in sorted((Path(data_path("logs/tm5_900")) / "E1").glob("*.parquet")):
        table = pq.read_table(file)
        columns = [
            names[head] + "/" + tail if tail else head
            for head, _, tail in (c.partition("/") for c in table.column_names)
        ]
        pq.write_table(table.rename_columns(columns), folder / "session" / file.name)
    opened = open_sessions([folder / "session"], arm)
    fit_hybrid(opened.motions, opened.arm, FitOptions(net="none"), opened.data_records()).model.save(folder / "model")
    write_diagnosis(folder / "diagnosis.json", arm, "stribeck_friction", "payload")
    (folder / "scene.toml").write_text(
        f"""robot = {json.dumps(str(folder / "robot.urdf"))}
[task]
start_deg = [50, 0, -120]
goal_deg = [80, 30, -90]
duration_s = 0.65
[[obstacle]]
name = {json.dumps(TEXT)}
size_m = [0.1, 0.1, 0.1]
xyz_m = [0.04, -0.9, 0.56]
""",
        encoding="utf-8",
    )
    return folder


def use_urdf(given: Folder, out: Folder) -> None:
    arm_shapes(ArmModel.load(given / "robot.urdf"))


def use_session(given: Folder, out: Folder) -> None:
    inspect(given / "session", given / "robot.urdf").reports[0].mend(out / "mended")


def use_model(given: Folder, out: Folder) -> None:
    write_export(HybridModel.load(given / "model"), out / "export")


def use_diagnosis(given: Folder, out: Folder) -> None:
    write_patch(Diagnosed.load(given / "diagnosis.json"), ArmModel.load(given / "robot.urdf"), out / "patch")


def use_scene(given: Folder, out: Folder) -> None:
    open_task(given / "scene.toml", given / "model")


USES: dict[str, Callable[[Folder, Folder], None]] = {
    "URDF": use_urdf,
    "session": use_session,
    "model": use_model,
    "diagnosis": use_diagnosis,
    "scene": use_scene,
}


def foreign(guard: Guard, *homes: Path) -> list[str]:
    """What was read that is neither given nor installed, and no figure of the system's own."""
    own = [ROOT, *(Path(one).resolve() for one in (*sys.path, sys.prefix, sys.base_prefix) if one)]
    resolved = {one: Path(one).resolve() for one in guard.read if not one.startswith(("/proc", "/sys"))}
    return [one for one, path in resolved.items() if not any(path.is_relative_to(home) for home in (*own, *homes))]


@pytest.mark.parametrize("kind", USES)
def test_hostile_names_are_text_all_the_way(
    kind: str, given: Folder, guard: Guard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: what a command makes of each kind of file runs nothing; its output and temporary folders alone change."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "own"))
    USES[kind](given, tmp_path / "warm")  # what is loaded lazily is loaded here
    with guard.watching(tmp_path / "out", tmp_path / "own"):
        USES[kind](given, tmp_path / "out")
    assert guard.done == []
    assert foreign(guard, given.resolve(), tmp_path.resolve()) == []
    assert not [*tmp_path.rglob("RUN"), *given.rglob("RUN"), *(tmp_path / "own").iterdir()]


URDF = """<robot name="r"><link name="a"><collision><geometry><mesh filename="shape.obj"/></geometry></collision></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
REACHING = {
    "entity of a URDF": ("robot.urdf", '<!DOCTYPE r [<!ENTITY x SYSTEM "{secret}">]><robot name="&x;"/>'),
    "parameter entity of a URDF": ("robot.urdf", '<!DOCTYPE r [<!ENTITY % x SYSTEM "{secret}"> %x;]><robot name="r"/>'),
    "include of a xacro file": (
        "robot.xacro",
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="r"><xacro:include filename="{secret}"/></robot>',
    ),
    "expression of a xacro file": (
        "robot.xacro",
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="$(eval open(\'{secret}\').read())"/>',
    ),
    "mesh of a scene": ("scene.toml", '[[obstacle]]\nfile = "{secret}"\nxyz_m = [0, 0, 0]\n'),
}


@pytest.mark.parametrize("way", REACHING)
def test_no_file_names_another_to_be_read(way: str, guard: Guard, tmp_path: Path) -> None:
    """Law: a file elsewhere that a stranger's file names is not even opened."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "given").mkdir()
    secret = tmp_path / "elsewhere" / SECRET
    secret.write_text("mine")
    name, text = REACHING[way]
    path = tmp_path / "given" / name
    path.write_text(text.format(secret=secret))
    with guard.watching(), pytest.raises(InputError) as caught:
        load_surroundings(path, 6) if path.suffix == ".toml" else arm_shapes(ArmModel.load(path))
    assert guard.done == []
    assert str(secret) not in guard.read
    assert "mine" not in str(caught.value)


# How an .obj can name its materials so that its reader finds them; that ends lines otherwise than Python does.
NAMING = {
    "plainly": b"mtllib secret.mtl\n",
    "behind a carriage return": b"# a\rmtllib secret.mtl\r\n",
    "behind a form feed": b"# a\x0cmtllib secret.mtl\n",
    "behind a zero": b"# a\x00mtllib secret.mtl\n",
    "on the next line": b"mtllib \\\nsecret.mtl\n",
    "in two parts": b"mtl\\\r\nlib sec\\\nret.mtl\n",
    "in parts with words between": b"mtl\\\x0c of nobody\nlib secret.mtl\n",
    "by backslashes": b"mtllib sub\\..\\secret.mtl\n",
    "from above": b"mtllib ../given/secret.mtl\n",
    "by its own name": b"mtllib nothing.mtl\n",
}


@pytest.mark.parametrize("reader", ["scene", "URDF"])
@pytest.mark.parametrize("way", NAMING)
def test_no_material_of_a_mesh_is_opened(way: str, reader: str, tmp_path: Path) -> None:
    """Law: however an .obj names its materials, its reader below Python opens none, and the shape is read."""
    given = tmp_path / "given"
    given.mkdir()
    for name in ("secret.mtl", "shape.mtl"):
        (given / name).write_text("newmtl mine\n")
    (given / "shape.obj").write_bytes(NAMING[way] + obj().encode())
    (given / "arm.urdf").write_text(shaped((Path(data_path("urdf/tm5_900.urdf"))).read_text(), "shape.obj"))
    seen = traps.Seen()
    with traps.watching(given, seen):
        if reader == "URDF":
            assert len(ArmModel.load(str(given / "arm.urdf")).geometry.geometryObjects) == 1
        else:
            solid, _ = read_mesh(given / "shape.obj", np.ones(3), False)
            assert len(solid.points) == len(CUBE)
    assert "shape.obj" in seen.touched
    assert not {"secret.mtl", "shape.mtl"} & set(seen.touched)


CALL = 'subprocess.run([sys.executable, "-c", "import joblib, struct"]).returncode'


def test_nothing_is_imported_from_the_folder_where_the_user_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: what a command and its libraries start is as safe in a stranger's folder as itself; numba reads nothing."""
    for folder in ("own", "strange"):
        (tmp_path / folder).mkdir()
    (tmp_path / "own/started.py").write_text(f"import subprocess, sys\napp = lambda **given: {CALL}")
    for name in ("joblib", "numpy", "struct"):
        (tmp_path / f"strange/{name}.py").write_text("open('RUN', 'w')")
    monkeypatch.chdir(tmp_path / "strange")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(tmp_path / "own")]))
    line = [sys.executable, "-P", "-c", "from ident.process import run_command; run_command('ident', 'started')"]
    assert subprocess.run(line, check=False).returncode == 0
    assert not Path("RUN").exists()
    Path(".numba_config.yaml").write_text("DISABLE_JIT: 1")
    assert subprocess.run(line, check=False).returncode == USER
