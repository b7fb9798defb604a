"""Laws of the layouts: every joint of a log has its curve, by the name or place that the viewer knows it by."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from examples.layouts.write_layouts import QUANTITIES, write_layouts
from ident import InputError

JOINTS = ["wrist", "elbow"]  # as messages of ROS have them: in any order
TOPIC = "/arm/joint_states"


def curves(path: Path) -> list[str]:
    """Names of all curves of a layout of PlotJuggler."""
    return [str(curve.get("name")) for curve in ET.parse(path).iter("curve")]


def test_columns_of_a_session_are_curves(tmp_path: Path) -> None:
    """Law: the curves of a table are its own columns."""
    columns = [f"{joint}/{quantity}" for quantity in QUANTITIES for joint in JOINTS]
    rows = [",".join(["time", *columns])]
    rows += [",".join(f"{value:.3f}" for value in [0.01 * k] + [0.1 * k] * 6) for k in range(40)]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (written,) = write_layouts(tmp_path, TOPIC, tmp_path / "layouts")
    assert sorted(curves(written)) == sorted(columns)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag of one message."""
    writer = pytest.importorskip("rosbags.rosbag2")
    stores = pytest.importorskip("rosbags.typesys")
    store = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    kinds = store.types
    kind = "sensor_msgs/msg/JointState"
    stamp = kinds["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    values = {quantity: np.zeros(len(JOINTS)) for quantity in QUANTITIES}
    message = kinds[kind](header=header, name=JOINTS, **values)
    path = tmp_path / "bag"
    plugin = writer.StoragePlugin.MCAP
    with writer.Writer(path, version=writer.Writer.VERSION_LATEST, storage_plugin=plugin) as file:
        stream = file.add_connection(TOPIC, kind, typestore=store)
        file.write(stream, 1, store.serialize_cdr(message, kind))
    (found,) = path.glob("*.mcap")
    return found


def test_a_bag_is_shown_in_the_order_of_its_messages(bag: Path, tmp_path: Path) -> None:
    """Law: a place in the message has the label of the joint that stands there."""
    juggler, foxglove = write_layouts(bag, TOPIC, tmp_path / "layouts")
    assert f"{TOPIC}/wrist/effort" in curves(juggler)
    layout = json.loads(foxglove.read_text(encoding="utf-8"))
    (effort,) = [panel for name, panel in layout["configById"].items() if name.endswith("effort")]
    places = {path["value"]: path["label"] for path in effort["paths"]}
    assert places == {f"{TOPIC}.effort[0]": "wrist", f"{TOPIC}.effort[1]": "elbow"}
    beneath = layout["layout"]["second"]
    assert {layout["layout"]["first"], beneath["first"], beneath["second"]} == {*layout["configById"]}


def test_another_topic_is_refused(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="give --topic"):
        write_layouts(bag, "/other", tmp_path / "layouts")
