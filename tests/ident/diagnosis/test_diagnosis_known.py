"""An arm that was identified before: what is mounted on it since then is weighed, not tuned away."""

from __future__ import annotations

from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.regression.settings import USUAL_REGRESSION
from ident.effects.catalogue import find_effect
from ident.recordings.recording import Payload
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import healthy_torque
from tests.ident.made_up import made_motions

LOAD = Payload(1.2, (0.0, 0.05, 0.08))


def test_a_payload_is_weighed_on_a_known_arm(short_arm: ArmModel) -> None:
    """Law: with inertias known to 0.5 % a body of 1.2 kg is found within a tenth, and its interval holds it."""

    def law(q, dq, ddq):  # type: ignore[no-untyped-def]
        with_load = short_arm.with_payload(LOAD).inverse_dynamics(q, dq, ddq)
        return healthy_torque(short_arm, q, dq, ddq) + with_load - short_arm.inverse_dynamics(q, dq, ddq)

    motions = made_motions(short_arm, law, range(6), 8.0, 50.0, noise=0.3)
    catalogue = [find_effect(name) for name in ("payload", "torque_offset", "load_dependent_friction")]
    analysis = diagnose(motions, short_arm, catalogue, inertia_share=USUAL_REGRESSION.known_share)
    (finding,) = analysis.diagnosis.findings
    assert finding.estimate.group.effect.id == "payload"
    mass = finding.estimate.parameters["mass_kg"]
    assert abs(mass.value - 1.2) < 0.12
    assert mass.low <= 1.2 <= mass.high
