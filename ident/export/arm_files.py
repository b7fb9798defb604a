"""The files of one identified arm while they are put together, loaded back and measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array
from ident.export.bodies import random_states
from ident.export.choose import MOST_WINDOWS, SAID, WINDOW, Chosen, Gap, choose, measure_gap, mix
from ident.export.controllers import InFile, write_module
from ident.export.formats import (
    LOADED,
    NEAR,
    Run,
    Shares,
    describe,
    is_of_the_log,
    measure_off,
    state_arm,
    stood_in,
    usual_run,
)
from ident.export.identified import Change, IdentifiedArm
from ident.export.loaded import Loading, WrittenFile, load_module
from ident.export.promotion import Contest, contest_of_model, measure_distance
from ident.laws.motion import Losses
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion

# More samples of all runs together say no more about a law's nearest losses.
MOST_SAMPLES = 5000
# Bodies whose inertial numbers differ by less are the same [kg, kg m, kg m²].
SAME_BODIES = 1e-12
UNMEASURED = (
    "measured on no recordings: with --on SESSION the best of the candidates is written, "
    "the URDF's arm among them"
)
IN_SAMPLE = "measured on recordings that it was made from: nothing is held out"
# What the candidates are, in a record.
CANDIDATES = SAID | {
    "after": "the written file",
    "after_with_module": (
        "the written file and the module's missing_torque; for the URDF also its log"
    ),
}

Owner = tuple[str, int]
"""An effect's id and the index of its joint."""


@dataclass(frozen=True)
class Measured:
    """What recordings say of the written files."""

    record: dict[str, object]  # errors of all candidates, and which was written; none unmeasured
    notes: list[str]  # what a user should know of it


class ArmFiles:
    """The files of an arm, in a folder that is still being written.

    Args:
        candidates: The arms that could be written, by name: `after` has all that was identified,
            `given` is the URDF's, `tuned` (where there is one) was fitted without the effects.
        motions: Recordings by which the files of simulators are chosen and measured; may be none.
        folder: Where the files are written.
        scratch: Folder for files of candidates, which are not kept.
    """

    def __init__(
        self,
        candidates: Mapping[str, IdentifiedArm],
        motions: Sequence[Motion],
        folder: Path,
        scratch: Path,
    ) -> None:
        self.candidates = candidates
        self.motions = motions
        self.folder = folder
        self.scratch = scratch
        self.identified = candidates["after"]
        self.nominal = self.identified.nominal
        self.runs = _states_of(motions) or [usual_run(self.nominal)]
        self.written: dict[str, WrittenFile] = {}
        self.chosen: dict[str, Chosen] = {}
        self._shares: dict[str, list[Shares]] = {}

    def stated(self, form: str) -> IdentifiedArm:
        """What the file of a format holds.

        Of a format that knows no effect: the losses that stand in for all of them.
        """
        if form in self.written:
            return self.written[form].stated
        stated = state_arm(self.identified, form, self.runs)
        if "tuned" not in self.candidates or self.motions:
            return stated
        # No recording says what is best. Where losses are no good for a law, those that were
        # fitted without it are better; and where the file has no effect at all, so are bodies.
        tuned = self.candidates["tuned"]
        near = self._near(form, stated)
        if not near:
            return tuned
        lacking = {change.joint for change in stood_in(self.identified.changes, form)}
        lacking -= {change.joint for change in near}
        names = ["tuned" if joint in lacking else "after" for joint in range(self.nominal.n)]
        return mix({"after": stated, "tuned": tuned}, "after", names)

    def _near(self, form: str, stated: IdentifiedArm) -> list[Change]:
        """Effects that a format's file holds, or comes near to by its losses.

        A file describes the arm: what is wrong with the log alone is none of its gaps.
        """
        changes = self.identified.changes
        shares: list[Shares] = [{} for _ in changes]
        if form in LOADED:
            shares = self.shares_off(form)
        held = {_owner(change) for change in stated.changes}
        near = []
        for change, share in zip(changes, shares, strict=True):
            if is_of_the_log(change) or _owner(change) in held or share.get(form, 1.0) <= NEAR:
                near.append(change)
        return near

    def write(self, name: str, text: str) -> None:
        """Writes a text file into the folder."""
        (self.folder / name).write_text(text, encoding="utf-8")

    def write_loaded(self, forms: Sequence[str]) -> None:
        """Writes the files of simulators; with recordings, the best of the candidates on them."""
        for form in forms:
            stated = self.stated(form)
            if self.motions:
                options = {}
                for name, candidate in self.candidates.items():
                    # Fitted without what is wrong with the log, an arm has it in its links.
                    if name == "tuned" and any(map(is_of_the_log, self.identified.changes)):
                        continue
                    options[name] = state_arm(candidate, form, self.runs)
                self.chosen[form] = choose(form, options, self.motions, self.scratch / form)
                stated = self.chosen[form].stated
            self.written[form] = WrittenFile.write(form, self.folder, stated)

    def contests(self, model: HybridModel, formats: Sequence[str], horizon: float) -> list[Contest]:
        """Each simulator's file against the URDF alone; of other formats the model behind them.

        Args:
            model: The fitted model.
            formats: All formats that are written.
            horizon: Length of the replays [s].
        """
        payload = self.motions[0].payload
        contests = []
        for form, file in self.written.items():
            scratch = self.scratch / f"{form}_nominal"
            urdf = WrittenFile.write(form, scratch, self.candidates["given"])
            nominal = measure_distance(urdf.load(payload), self.motions, self.nominal, horizon)
            written = measure_distance(file.load(payload), self.motions, self.nominal, horizon)
            contests.append(Contest(form, nominal, written, self.chosen[form].tried))
        if any(name not in LOADED for name in formats):
            contests.append(contest_of_model(model, self.motions, horizon))
        return contests

    def effects(self) -> list[dict[str, object]]:
        """Every effect, and how near each format comes to it."""
        by_form = [self.shares_off(form) for form in LOADED]
        records = []
        for change, *shares in zip(self.identified.changes, *by_form, strict=True):
            off: Shares = {}
            for share in shares:
                off |= share
            records.append(describe(change, off))
        return records

    def shares_off(self, form: str) -> list[Shares]:
        """How far each effect's torque in a file is from its law, as a share, by the format."""
        if form not in self._shares:
            scratch = self.scratch / form
            self._shares[form] = measure_off(self.identified, form, self.runs, scratch)
        return self._shares[form]

    def losses_of_urdf(self) -> Losses | None:
        """Losses of the URDF, with what it has no place for; None where they are the arm's own."""
        if "urdf" not in self.written:
            return None
        losses = self.written["urdf"].stated.losses
        return None if losses is self.identified.losses else losses

    def module(self) -> str:
        """The Python module, which says what the simulators' files lack."""
        owners = [_owner(change) for change in self.identified.changes if change.has_law]
        return write_module(self.identified, {form: self._in_file(form, owners) for form in LOADED})

    def _in_file(self, form: str, owners: Sequence[Owner]) -> InFile:
        """Which of some effects a simulator's file holds, its losses, and its bodies' numbers.

        The numbers, of shape (n, 10), are None where the bodies are the arm's own tuned ones.
        """
        stated = self.stated(form if form in self.written else "losses")
        held = {_owner(change) for change in stated.changes}
        indices = [index for index, owner in enumerate(owners) if owner in held]
        links = stated.links.total
        if any(change.part("urdf") == "inertial" for change in stated.changes):
            links = links - self.identified.links.named
        numbers: Array | None = None
        if not np.allclose(links, self.identified.links.tuned, atol=SAME_BODIES):
            numbers = self.nominal.inertial_parameters.reshape(-1, 10) + links
        return indices, stated.losses, numbers

    def loaded_back(self, module: str | None) -> dict[str, Loading]:
        """How near each loaded file is to what it should hold [N m].

        Args:
            module: Name of the Python module in the folder, if one is written.
        """
        checks = {form: file.check() for form, file in self.written.items()}
        if module is not None:
            checks["python"] = self._check_module(module)
        return checks

    def _check_module(self, name: str) -> Loading:
        """How near the module's torque is to bodies and losses at random states [N m]."""
        q, dq, ddq = random_states(self.nominal, np.random.default_rng(0))
        losses = self.identified.losses
        wanted = losses.torque(dq, ddq, np.tanh(dq / losses.transition))
        wanted += self.identified.tuned.inverse_dynamics(q, dq, ddq)
        modelled = load_module(self.folder / name).modelled_torque(q, dq, ddq)
        difference = float(np.max(np.abs(modelled - wanted)))
        return {"loads": True, "torque_difference_Nm": difference}

    def measured(self, module: str | None, in_sample: bool) -> Measured:
        """Errors of the candidates and of the written files on the recordings.

        Args:
            module: Name of the Python module in the folder, if one is written.
            in_sample: Whether the arm was made from one of the recordings.
        """
        if not self.chosen:
            return Measured({}, [UNMEASURED] if self.written else [])
        joints = self.nominal.joint_names
        gaps = {form: dict(chosen.gaps) for form, chosen in self.chosen.items()}
        if module is not None:
            for form, candidates in gaps.items():
                candidates["after_with_module"] = self._gap_with_module(form, module)
        notes = []
        for form, chosen in self.chosen.items():
            notes += chosen.in_words(form, joints)
        if in_sample:
            notes.append(IN_SAMPLE)
        heldout: dict[str, object] = {
            "best": {form: _nearest(candidates) for form, candidates in gaps.items()},
            "in_sample": in_sample,
            "runs": [motion.name for motion in self.motions],
            "window_s": WINDOW,
            "most_windows": MOST_WINDOWS,
            **CANDIDATES,
            "gaps": {form: _records(candidates, joints) for form, candidates in gaps.items()},
            "choice": {form: chosen.to_dict(joints) for form, chosen in self.chosen.items()},
        }
        written = {form: chosen.name for form, chosen in self.chosen.items()}
        return Measured({"heldout": heldout, "written": written}, notes)

    def _gap_with_module(self, form: str, module: str) -> Gap:
        """How far a file and the module together are from the recordings."""
        loaded = load_module(self.folder / module)
        helped = self.written[form].load(self.motions[0].payload, loaded)
        return measure_gap(helped, self.motions)


def _states_of(motions: Sequence[Motion]) -> list[Run]:
    """States of recordings, of long ones their first part: the torque is left out."""
    each = max(3, MOST_SAMPLES // max(len(motions), 1))
    runs: list[Run] = []
    for motion in motions:
        states = (motion.q[:each], motion.dq[:each], motion.ddq[:each])
        runs.append((*states, motion.interval))
    return runs


def _owner(change: Change) -> Owner:
    return change.effect, change.joint


def _nearest(candidates: Mapping[str, Gap]) -> str:
    """The candidate of the least RMS of the torque."""
    rms = {name: gap.rms for name, gap in candidates.items()}
    return min(rms, key=rms.__getitem__)


def _records(candidates: Mapping[str, Gap], joints: Sequence[str]) -> dict[str, object]:
    return {name: gap.to_dict(joints) for name, gap in candidates.items()}
