"""The timeline of a diagnosis, read back: its curves and words are those of the diagnosis that was just made."""

import numpy as np
import pytest

from ident.diagnosis.diagnose import Analysis
from ident.show.results import draw_diagnosis
from ident.show.timeline.gap import gap_curves, gap_marks
from ident.show.timeline.writing import FOUND, write_timeline
from tests.ident.diagnosis.planted import analyse, load_arm, spring_on_3
from tests.ident.show.timeline.saved import Saved


@pytest.fixture(scope="module")
def sprung() -> Analysis:
    """What the diagnosis makes of a spring across joint 3."""
    return analyse(load_arm(), spring_on_3)


@pytest.fixture(scope="module")
def saved(sprung: Analysis, tmp_path_factory: pytest.TempPathFactory) -> Saved:
    path = tmp_path_factory.mktemp("timeline") / "diagnosis.rrd"
    motions = [item.run.motion for item in sprung.series]
    words = sprung.diagnosis.summary()
    write_timeline(
        path,
        sprung.baseline.nominal,
        motions,
        marks=gap_marks(sprung),
        further=gap_curves(sprung),
        words=words,
    )
    return Saved(path)


def test_curves_are_what_the_diagnosis_left(sprung: Analysis, saved: Saved) -> None:
    """Run after run, tuned and with the names; and the names leave less where they act."""
    for j, joint in enumerate(sprung.diagnosis.joints):
        before = np.concatenate([item.before[:, j] for item in sprung.series])
        after = np.concatenate([item.after[:, j] for item in sprung.series])
        np.testing.assert_array_equal(saved.curve(f"/joints/{joint}/residual/tuned")[1], before)
        np.testing.assert_array_equal(saved.curve(f"/joints/{joint}/residual/named")[1], after)
    named = sprung.diagnosis.findings[0].joints[0]
    tuned, with_names = (saved.curve(f"/joints/{named}/residual/{rung}")[1] for rung in ("tuned", "named"))
    assert np.std(with_names) < np.std(tuned)


def test_words_are_those_of_the_terminal(sprung: Analysis, saved: Saved) -> None:
    """The verdict, what to do, and the arm's numbers stand in the timeline as the command prints them."""
    ((words,),) = saved.static[FOUND]["TextDocument:text"]
    assert words == sprung.diagnosis.summary()
    assert "spring torque in joint_3" in words


def test_the_picture_shows_every_number_of_the_record(sprung: Analysis) -> None:
    """Law: each bar of `plot()` is a value of the record, and none of the kinds of bars is empty."""
    record = sprung.diagnosis.to_dict()
    (axes,) = draw_diagnosis(record).axes
    heights = {str(bars.get_label()): [bar.get_height() for bar in bars] for bars in axes.containers}
    gaps = record["gap"].values()
    assert heights["left by the tuned model"] == [gap["rms_Nm"] for gap in gaps]
    assert heights["left after the named effects"] == list(record["heldout"]["rms_after_Nm"].values())
    assert heights["left by a flexible function"] == [gap["ceiling_rms_Nm"] for gap in gaps]
    assert heights["counted as noise"] == [gap["noise_floor_Nm"] for gap in gaps]
    assert all(min(values) > 0.0 for values in heights.values())
