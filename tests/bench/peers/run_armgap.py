"""armgap on a job: what `ident fit` and `ident evaluate` do, through the front door."""

import numpy as np
from job import Job, least_eigenvalue

from ident import fit_hybrid, open_sessions
from ident.command_options import FitOptions
from ident.recordings.recording import Recording, Session
from ident.robot.arm import ArmModel


def main() -> None:
    job = Job.given()

    def session(name: str) -> Session:
        rows = enumerate(job.runs(name))
        return Session(
            name, tuple(Recording(f"{name}_{k}", tuple(job.joints), *run) for k, run in rows), common_clock=False
        )

    robot = ArmModel.load(job.facts["urdf"])
    accepted = ("effort_is_model",)
    options = FitOptions(net=job.facts["net"], offset=job.friction, accept=accepted)
    model = fit_hybrid(open_sessions([session("train")], robot, accept=accepted), options=options).model
    predicted = []
    for motion in open_sessions([session("test")], model, learning=False).motions:
        own = motion.select(model.joint_names)
        predicted.append((own.time, model.torque(own.q, own.dq, own.ddq)))
    job.answer(predicted, least_eigenvalue(np.asarray(model.arm.inertial_parameters)))


if __name__ == "__main__":
    main()
