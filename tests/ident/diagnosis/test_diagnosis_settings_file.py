"""Numbers of a diagnosis from a file: what is given takes its place, what no setting is gets one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from ident.diagnosis.settings import USUAL
from ident.diagnosis.settings_file import read_settings
from ident.errors import InputError


def test_numbers_of_a_file_take_the_place_of_the_usual_ones(tmp_path: Path) -> None:
    """Those that are not given stay; where they are from is passed over."""
    path = tmp_path / "settings.toml"
    path.write_text("[calibration]\nseed = 3\n[verdict]\nstands_out = 1.3\n[selection]\nurdf_scales = [0.5, 1.0]\n")
    found = read_settings(path)
    assert (found.verdict.stands_out, found.selection.urdf_scales) == (1.3, (0.5, 1.0))
    assert found.verdict.much_left == USUAL.verdict.much_left
    assert found.regression == USUAL.regression


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[verdict]\nstand_out = 1.3\n", "there is no setting verdict.stand_out"),
        ("verdict = 3\n", "verdict is a group"),
        ('[verdict]\nstands_out = "much"\n', "verdict.stands_out is 'much'"),
        ("[verdict]\nstands_out = nan\n", "verdict.stands_out is nan"),
        ("[verdict]\nstands_out = true\n", "verdict.stands_out is True"),
        ("[selection]\nurdf_scales = 0.5\n", "selection.urdf_scales is 0.5"),
        ("[selection]\nmost_effects = 2.5\n", "selection.most_effects is 2.5"),
        ("stands_out 1.3", "not TOML"),
    ],
)
def test_what_no_setting_is_gets_one_line(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_settings(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
