"""Layouts of PlotJuggler and Foxglove for the joints of a log: position, velocity and effort below one another.

python examples/layouts/write_layouts.py my_session --out layouts
python examples/layouts/write_layouts.py my_bag.mcap --topic /joint_states --out layouts

PlotJuggler finds series by the names of joints. Foxglove finds them by their places in the message,
which are those of the bag's first message; without a bag no layout of Foxglove is written.
"""

from __future__ import annotations

import argparse
import json
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ident import InputError
from ident.files import atomic_write
from ident.recordings.load import load_session

QUANTITIES = ("position", "velocity", "effort")
BAGS = (".mcap", ".db3", ".bag")
# Colours that people tell apart with any colour vision.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")


def plotjuggler_layout(joints: Sequence[str], topic: str = "") -> str:
    """The layout as text; of a table of armgap's columns where there is no topic."""
    lead = f"{topic}/" if topic else ""
    root = ET.Element("root")
    window = ET.SubElement(root, "tabbed_widget", parent="main_window", name="Main Window")
    tab = ET.SubElement(window, "Tab", tab_name="joints", containers="1")
    container = ET.SubElement(tab, "Container")
    sizes = ";".join([f"{1.0 / len(QUANTITIES):.6f}"] * len(QUANTITIES))
    count = str(len(QUANTITIES))
    splitter = ET.SubElement(container, "DockSplitter", orientation="-", sizes=sizes, count=count)
    for quantity in QUANTITIES:
        area = ET.SubElement(splitter, "DockArea", name=quantity)
        plot = ET.SubElement(area, "plot", mode="TimeSeries", style="Lines")
        ET.SubElement(plot, "limitY")
        for number, joint in enumerate(joints):
            colour = COLOURS[number % len(COLOURS)]
            ET.SubElement(plot, "curve", name=f"{lead}{joint}/{quantity}", color=colour)
    ET.SubElement(root, "use_relative_time_offset", enabled="1")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def foxglove_layout(joints: Sequence[str], topic: str) -> dict[str, Any]:
    """The layout of a bag whose messages name the joints in this order."""
    panels: dict[str, Any] = {}
    for quantity in QUANTITIES:
        paths = []
        for number, joint in enumerate(joints):
            path = {
                "value": f"{topic}.{quantity}[{number}]",
                "label": joint,
                "enabled": True,
                "timestampMethod": "headerStamp",
                "color": COLOURS[number % len(COLOURS)],
            }
            paths.append(path)
        panels[f"Plot!{quantity}"] = {"foxglovePanelTitle": quantity, "paths": paths}
    first, second, third = panels
    below = {"first": second, "second": third, "direction": "column"}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "layout": {"first": first, "second": below, "direction": "column", "splitPercentage": 33},
    }


def names_in_message(bag: Path, topic: str) -> list[str]:
    """The joints of a bag's first message, in its order.

    Raises:
        InputError: The bag has no such topic.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    usual = get_typestore(Stores.ROS2_HUMBLE)
    place = bag.parent if bag.suffix == ".db3" else bag
    with AnyReader([place], default_typestore=usual) as reader:
        streams = [stream for stream in reader.connections if stream.topic == topic]
        for stream, _, data in reader.messages(connections=streams) if streams else ():
            return list(reader.deserialize(data, stream.msgtype).name)
    raise InputError(bag, f"no message of {topic}", "give --topic")


def write_layouts(log: Path, topic: str, out: Path) -> list[Path]:
    """Writes what suits a log: PlotJuggler's layout, and for a bag that of Foxglove, too."""
    out.mkdir(parents=True, exist_ok=True)
    if log.suffix in BAGS:
        joints = names_in_message(log, topic)
        foxglove = json.dumps(foxglove_layout(joints, topic), indent=1) + "\n"
        texts = {"plotjuggler.xml": plotjuggler_layout(joints, topic), "foxglove.json": foxglove}
    else:
        texts = {"plotjuggler.xml": plotjuggler_layout(load_session(log).joints)}
    for name, text in texts.items():
        with atomic_write(out / name) as part:
            part.write_text(text, encoding="utf-8")
    return [out / name for name in texts]


def main() -> None:
    """Reads the arguments, writes the layouts, says where."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path, help="session of armgap's columns, or a bag")
    parser.add_argument("--topic", default="/joint_states")
    parser.add_argument("--out", type=Path, default=Path("layouts"))
    given = parser.parse_args()
    try:
        written = write_layouts(given.log, given.topic, given.out)
    except InputError as error:
        parser.exit(2, f"{error}\n")
    print(*written, sep="\n")


if __name__ == "__main__":
    main()
