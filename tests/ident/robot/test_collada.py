"""Laws of COLLADA files: their shapes are read as they are placed, and nothing else of them is believed."""

import resource
from pathlib import Path

import coal
import numpy as np
import pytest

from ident.errors import InputError
from ident.robot.arm import ArmModel
from ident.robot.collada import plain_collada
from ident.robot.names import data_path
from ident.robot.pinocchio_model import read_geometry
from plan.geometry.obstacle_files import read_mesh
from tests.fuzz.samples import CUBE, FACES, POLYLIST, TRIANGLES, dae, shaped

SCALE = np.ones(3)
# What its node does to the cube: a quarter of a turn about z, and half a metre along x.
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SHIFT = np.array([0.5, 0.0, 0.0])
SKIN = """<library_controllers><controller id="bent"><skin source="#cube">
<vertex_weights count="1"><vcount>{count}</vcount><v>0 0</v></vertex_weights></skin></controller></library_controllers>
<library_nodes>"""


def corners(path: Path, text: str) -> np.ndarray:
    """Corners of what is read of a text, in its own axes, sorted."""
    path.write_text(text)
    solid, middle = read_mesh(path, SCALE, hull=False)
    return np.unique(np.round(solid.points + middle, 6), axis=0)


def placed() -> np.ndarray:
    """The cube's corners as its node places them, sorted."""
    return np.unique(np.round(np.array(CUBE) @ TURN.T + SHIFT, 6), axis=0)


def read_itself(path: Path, text: str) -> np.ndarray:
    """Corners that Coal reads of a text of its own, sorted."""
    path.write_text(text)
    model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), SCALE)
    return np.unique(np.round(model.vertices(), 6), axis=0)


@pytest.mark.parametrize("faces", [TRIANGLES, POLYLIST])
def test_a_shape_is_read_where_it_is_placed(faces: str, tmp_path: Path) -> None:
    """Law: nodes that are named, transformations, units count as to Coal itself; what bends a shape does not."""
    path = tmp_path / "cube.dae"
    text = dae(faces)
    assert np.array_equal(corners(path, text), placed())
    for other in (text.replace('meter="1"', 'meter="0.001"'), text.replace("Z_UP", "Y_UP")):
        assert np.array_equal(corners(path, other), read_itself(path, other))
    bent = text.replace("<library_nodes>", SKIN.format(count="1"))
    bent = bent.replace('<instance_geometry url="#cube"/>', '<instance_controller url="#bent"/>')
    assert np.array_equal(corners(path, bent), placed())
    assert len(read_mesh(path, SCALE, hull=False)[0].triangles) == len(FACES)


def test_what_a_corner_has_beside_its_place_is_left_out(tmp_path: Path) -> None:
    """Law: normals, colours, lights and pictures change no shape."""
    text = dae(TRIANGLES)
    places = " ".join(f"{place} 7" for face in FACES for place in face)
    normal = '<input semantic="NORMAL" source="#none" offset="1"/>'
    head, _, rest = text.partition("<p>")
    more = f"{head}{normal}<p>{places}{rest[rest.index('</p>') :]}"
    more = more.replace("<library_nodes>", '<library_images><image id="a"><init_from>/dev/zero</init_from></image>'
                        "</library_images><library_nodes>")  # fmt: skip
    assert np.array_equal(corners(tmp_path / "cube.dae", more), placed())
    assert b"/dev/zero" not in plain_collada(more.encode())


def laughing(text: str, levels: int) -> str:
    """Nodes of which each places ten of the next."""
    ten = [f'<node id="l{k}">' + f'<instance_node url="#l{k + 1}"/>' * 10 + "</node>" for k in range(levels)]
    last = f'<node id="l{levels}"><instance_geometry url="#cube"/></node>'
    placed = text.replace("<library_nodes>", f"<library_nodes>{''.join(ten)}{last}")
    return placed.replace('url="#part"', 'url="#l0"')


HOSTILE = {
    "a node in itself": lambda text: text.replace('url="#part"', 'url="#base"'),
    "nodes in each other": lambda text: text.replace(
        '<instance_geometry url="#cube"/>', '<instance_node url="#base"/>'
    ),
    "nodes without end": lambda text: laughing(text, 9),
    "very deep": lambda text: text.replace('<instance_node url="#part"/>', "<node>" * 20_000 + "</node>" * 20_000),
    "entities": lambda text: text.replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "1">]><COLLADA', 1),
    "another file": lambda text: text.replace('url="#cube"', 'url="other.dae#cube"'),
    "no corner": lambda text: text.replace("<p>0 ", "<p>8 "),
    "a corner before the first": lambda text: text.replace("<p>0 ", "<p>-1 "),
    "more corners than numbers": lambda text: text.replace('count="8" stride="3"', 'count="9" stride="3"'),
    "a longer corner": lambda text: text.replace('stride="3"', 'stride="300"'),
    "overflowing corners": lambda text: text.replace('stride="3"', f'stride="{2**63}"'),
    "a longer array": lambda text: text.replace('count="24"', 'count="25"'),
    "a polygon of many": lambda text: text.replace("<vcount>3 ", "<vcount>4000000000 "),
    "polygons that are not counted": lambda text: text.replace("<vcount>", "<extra>").replace("</vcount>", "</extra>"),
    "a strip of two": lambda text: (
        text[: text.index("<polylist")]
        + '<tristrips count="1"><input semantic="VERTEX" source="#vertices" offset="0"/><p>0 1</p></tristrips>'
        + text[text.index("</polylist>") + len("</polylist>") :]
    ),
    "no input": lambda text: text.replace('semantic="VERTEX"', 'semantic="NORMAL"'),
    "corners without axes": lambda text: text.replace('name="Y"', 'name="B"'),
    "no number": lambda text: text.replace("0.5 0 0", "nan 0 0"),
    "a longer transformation": lambda text: text.replace("0.5 0 0", "0.5 0 0 0"),
    "no scene": lambda text: text.replace('url="#scene"', 'url="#other"'),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_a_file_says_of_itself_is_not_believed(name: str, tmp_path: Path) -> None:
    """Law: it is told in a line, by a scene's reader and a URDF's; nothing ends the process or takes gigabytes."""
    path = tmp_path / "cube.dae"
    hostile = HOSTILE[name](dae())
    assert hostile != dae()
    path.write_text(hostile)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=r"is no \.dae that can be used \([^\n]*\); mend or replace"):
        read_mesh(path, SCALE, hull=False)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000


def test_a_urdfs_shapes_are_looked_through_as_well(tmp_path: Path) -> None:
    """Law: the reader below Pinocchio gets the same copy."""
    source = tmp_path / "arm.urdf"
    text = shaped(Path(data_path("urdf/tm5_900.urdf")).read_text(), "cube.dae")
    arm = ArmModel.from_urdf(text, source)
    path = tmp_path / "cube.dae"
    path.write_text(dae())
    read_geometry(arm.model, text, "collision", source, "arm")
    path.write_text(HOSTILE["a node in itself"](dae()))
    with pytest.raises(InputError, match="stands in itself"):
        read_geometry(arm.model, text, "collision", source, "arm")


@pytest.mark.parametrize("coding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le"])
def test_a_count_is_looked_at_in_every_coding(coding: str, tmp_path: Path) -> None:
    """Law: with and without the mark that says which it is."""
    path = tmp_path / "cube.dae"
    text = dae().replace('encoding="utf-8"', "")
    path.write_bytes(text.replace('count="24"', 'count="300000000"').encode(coding))
    with pytest.raises(InputError, match=r"is no \.dae that can be used"):
        read_mesh(path, SCALE, hull=False)
