"""README is for people: few numbers, and those that stand there are in its figures' table."""

import re

from tests.house.sources import ROOT

MOST_NUMBERS = 40
NUMBER = re.compile(r"(?<![\w.])\d[\d,]*(?:\.\d+)*")
# What nobody reads as a figure: comments, code to be typed, links' targets.
NO_TEXT = re.compile(r"<!--.*?-->|```python.*?```|^ {4}.*?$|`[^`\n]*`|\]\([^)]*\)", re.DOTALL | re.MULTILINE)


def numbers_of(page: str) -> list[str]:
    """Numbers that a page shows, what its programs print among them."""
    return NUMBER.findall(NO_TEXT.sub("", page))


def test_a_number_of_code_or_of_a_link_is_none() -> None:
    page = "Of 29 causes [a page](2.md), joint_2\n\n    make 3\n\n`x 4` <!-- 5 -->\n```text\n6.5 ± 7\n```\n"
    assert numbers_of(page) == ["29", "6.5", "7"]


def test_the_front_page_shows_few_numbers() -> None:
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(numbers_of(page)) <= MOST_NUMBERS
