"""The picture of the diagnosis holds its files, each below all that it uses, and fits a phone."""

import xml.etree.ElementTree as ElementTree
from importlib.util import module_from_spec, spec_from_file_location
from itertools import combinations

from tests.house.sources import ROOT

SPEC = spec_from_file_location("draw_flow", ROOT / "docs" / "draw_flow.py")
assert SPEC is not None
assert SPEC.loader is not None
draw_flow = module_from_spec(SPEC)
SPEC.loader.exec_module(draw_flow)
SVG = "{http://www.w3.org/2000/svg}"


def test_every_file_stands_once_below_all_that_it_uses() -> None:
    flow = draw_flow.read_flow()
    order = draw_flow.in_order(flow)
    assert sorted(order) == sorted(flow)
    assert order[-1] == draw_flow.DOOR
    for user, needs in flow.items():
        assert all(order.index(needed) < order.index(user) for needed in needs)


def test_an_arrow_is_left_out_where_a_longer_way_leads() -> None:
    flow = {"a": set(), "b": {"a"}, "c": {"a", "b"}}
    assert sorted(draw_flow.direct_arrows(flow)) == [("a", "b"), ("b", "c")]


def test_arrows_that_pass_one_another_have_lanes_of_their_own() -> None:
    spans = [(0.0, 1.0), (2.0, 3.0), (0.5, 2.5)]
    lanes = draw_flow.choose_lanes(spans)
    for (first, lane), (second, other) in combinations(zip(spans, lanes, strict=True), 2):
        apart = first[1] <= second[0] or second[1] <= first[0]
        assert apart or lane != other


def test_the_picture_names_every_file_and_is_no_wider_than_a_phone() -> None:
    picture = ElementTree.fromstring(draw_flow.draw())
    texts = {text.text for text in picture.iter(f"{SVG}text")}
    for module in draw_flow.read_flow():
        assert f"{module.removeprefix('ident.').replace('.', '/')}.py" in texts
    assert float(picture.attrib["width"]) <= 390
    for box in picture.iter(f"{SVG}rect"):
        assert float(box.get("x", "0")) + float(box.attrib["width"]) <= 390
