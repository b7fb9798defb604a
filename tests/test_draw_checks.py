"""The page with the order of the checks is that of the code, and names every check once."""

from importlib.util import module_from_spec, spec_from_file_location

from tests.house.sources import ROOT

SPEC = spec_from_file_location("draw_checks", ROOT / "docs" / "draw_checks.py")
assert SPEC is not None
assert SPEC.loader is not None
draw_checks = module_from_spec(SPEC)
SPEC.loader.exec_module(draw_checks)


def test_the_page_is_what_the_code_says() -> None:
    assert draw_checks.OUT.read_text(encoding="utf-8") == draw_checks.draw()


def test_every_check_that_is_asked_of_a_session_stands_on_it_once() -> None:
    names = [name for _, name in draw_checks.read_order()]
    assert len(names) == len(set(names))
    asked = {name for name in draw_checks.imported_checks() if name.startswith(("check_", "mend_", "drop_", "split_"))}
    assert asked <= set(names)


def test_rows_are_left_out_before_conventions_and_conventions_before_the_model() -> None:
    names = [name for _, name in draw_checks.read_order()]
    conventions = names.index("read_conventions")
    assert all(names.index(name) < conventions for name in names if name.startswith(("drop_", "split_")))
    against_the_model = ("check_rating", "check_effort", "check_scales", "check_clock")
    assert all(names.index(name) > conventions for name in against_the_model)
