"""A patched model from which names are taken out again, all else left as it was fitted."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.law_model import LawModel, log_error
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class EditedModel:
    """Tuned links, losses and laws, as a patch's module holds them.

    Attributes:
        identified: The arm with the laws that are left in.
    """

    identified: IdentifiedArm

    @classmethod
    def of(cls, record: Mapping[str, Any], arm: ArmModel, taken_out: Collection[int] = ()) -> EditedModel:
        """The patch of a diagnosis less some of its names; nothing is fitted again.

        Args:
            record: `ident.diagnosis/1`.
            arm: The robot that it was made with, with the joints that were diagnosed.
            taken_out: Places of the findings that are taken out.
        """
        diagnosed = Diagnosed.of_record(dict(record), needed=False)
        whole = diagnosed.candidates(arm)["after"]
        kept = tuple(change for k, change in enumerate(diagnosed.changes) if k not in taken_out)
        return cls(replace(whole, changes=kept))

    @classmethod
    def tuned_alone(cls, record: Mapping[str, Any], arm: ArmModel) -> EditedModel:
        """What the same recordings give where nothing is named: the best tuning of links and losses."""
        return cls(Diagnosed.of_record(dict(record), needed=False).candidates(arm)["tuned"])

    def rms(self, motions: Sequence[Motion]) -> Float[Array, " n"]:
        """Error of the filtered torque where joints move steadily, by joint [N m]."""
        squares, counts = np.zeros(motions[0].n), np.zeros(motions[0].n)
        for motion in motions:
            model = LawModel.of(self.identified, motion.payload)
            squares += np.sum(log_error(model, motion) ** 2, axis=0)
            counts += motion.settled.sum(axis=0)
        return np.sqrt(squares / np.maximum(counts, 1.0))
