"""The published schemas: one for each kind of file, and they refuse what does not hold to them."""

import pytest

from ident.errors import InputError
from ident.schemas.publish import list_kinds, make_schema
from tests.schemas import check_record

EMPTY = {"command": "ident view", "version": "0", "commit": None, "engines": {}, "units": "SI"}
EMPTY |= {"settings": {}, "sessions": []}
# The bytes of a board hang on its seed alone, and an answer is anybody's: neither says by what it was made.
WITHOUT_ORIGIN = ("board", "board_answer", "board_effects", "board_kept", "board_truths")


@pytest.mark.parametrize(("package", "name"), [(one, name) for one in ("ident", "plan") for name in list_kinds(one)])
def test_every_kind_is_published_with_its_origin_and_its_name(package: str, name: str) -> None:
    schema = make_schema(name, package)
    assert schema["properties"]["schema"]["const"] == f"{package}.{name}/1"
    needed = {"schema"} if name in WITHOUT_ORIGIN else {"schema", "provenance"}
    assert needed <= set(schema["required"])
    assert make_schema(f"{package}.{name}/1", package) == schema


def test_an_unknown_kind_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"give one of: blind, board, board_answer, .*, close, "):
        make_schema("nothing")


def test_a_missing_key_and_a_wrong_type_are_found() -> None:
    good = {"schema": "ident.view/1", "robot": "arm", "joints": ["a"], "runs": ["a"], "provenance": EMPTY}
    assert check_record(good) == good
    with pytest.raises(AssertionError, match="provenance"):
        check_record({"schema": "ident.view/1", "runs": ["a"]})
    with pytest.raises(AssertionError, match="runs"):
        check_record({**good, "runs": "a"})
