"""HybridModel: the arm as it is identified, and its folder.

    τ = analytic + loss + named laws + net

Source: paper, eq. 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from ident.arrays import Array, Float
from ident.errors import InputError, ModelError
from ident.files import atomic_folder
from ident.laws.carried import NamedLaw, named_torque
from ident.model.carried import CarriedEffect, as_logged, carried_torque, moving_arm
from ident.model.loss import NAMES, InertiaFigure, LossFigure, LossParameters
from ident.model.sampling import sampling_interval
from ident.model.training_range import TrainingRange
from ident.recordings.recording import Payload
from ident.records import JsonRecord
from ident.robot.arm import STANDARD_GRAVITY, ArmModel
from ident.safe_read import read_text, read_toml

if TYPE_CHECKING:
    from ident.model.memory import JointMemory
    from ident.model.residual_net import ResidualNet

SCHEMA = "ident.model/1"
# What a model's folder is marked as.
MODEL_KIND = "model"
# What a model's folder is known by.
MODEL_FILE = "model.toml"
# What to do where it can't be read.
REMEDY = "fit the model again"
# Least width of a speed's sign, where a model's friction turns round at once [rad/s].
SHARPEST = 1e-6


def split_models(paths: Sequence[Path], given: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Folders of models, and sessions.

    Models may stand before the sessions, or be given by themselves.

    Raises:
        InputError: No model, or no session.
    """
    first = 0
    while not given and first < len(paths) and (paths[first] / MODEL_FILE).is_file():
        first += 1
    models = [*given, *paths[:first]]
    sessions = list(paths[first:])
    if not models:
        what = f"{paths[0]} is no folder of a fitted model"
        remedy = "give MODEL SESSION …, or SESSION … --model MODEL; `ident fit` writes one"
        raise InputError("evaluate", what, remedy)
    if not sessions:
        raise InputError("evaluate", "no session is given", "give sessions after the models")
    return models, sessions


@dataclass(frozen=True, eq=False)
class HybridModel:
    """A fitted arm."""

    robot: ArmModel  # the whole arm as its URDF describes it; geometry comes from here
    # The rigid arm before identification: the robot, or its lumped three-joint model.
    nominal: ArmModel
    # The rigid arm with identified inertias; its joints are those that the model speaks of.
    arm: ArmModel
    loss: LossParameters  # loss parameters
    net: ResidualNet | None = None  # residual net, or None
    # What stands in for the net at some joints along a motion, where the last second counts.
    memory: JointMemory | None = None
    links: int = 6  # 6 for the full arm, 3 for the lumped one
    inertia: str = "nominal"  # how the inertias were found
    figures: tuple[LossFigure, ...] = ()  # loss parameters with intervals
    # Base parameters with intervals; none where the URDF's inertias were kept.
    inertias: tuple[InertiaFigure, ...] = ()
    # Where the training runs went; None where that is not known.
    trained: TrainingRange | None = None
    named: tuple[NamedLaw, ...] = ()  # laws of joints that a diagnosis named
    # What else a diagnosis named, with its parameters as they were found.
    carried: tuple[CarriedEffect, ...] = ()
    # Where there are such laws, the arm and its losses as the same runs have them without.
    alone: tuple[ArmModel, LossParameters] | None = None
    # Data hashes, versions, options, scores of the fit.
    provenance: JsonRecord = field(default_factory=dict)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all arrays."""
        return self.arm.joint_names

    @property
    def rungs(self) -> tuple[str, ...]:
        """Names of the ladder's rungs, from the URDF's rigid body up.

        `urdf` where its `<dynamics>` state friction.
        """
        present = {
            "analytic": True,
            "urdf": self.states_friction,
            "inertia": self.inertia != "nominal",
            "loss": True,
            "named": bool(self.named or self.carried),
            "net": self.net is not None,
        }
        return tuple(name for name, is_there in present.items() if is_there)

    @property
    def states_friction(self) -> bool:
        """Whether the URDF's `<dynamics>` state any damping or friction."""
        model = self.nominal.model
        return bool(np.any(model.damping) or np.any(model.friction))

    def torque(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        payload: Payload | None = None,
    ) -> Float[Array, "T n"]:
        """Joint torque that the motion needs [N m]. Source: paper, eq. 1.

        States that follow one another evenly are a motion: its joints remember the last second.
        """
        return sum(self.torque_terms(q, dq, ddq, payload).values(), np.zeros_like(q, dtype=float))

    def torque_terms(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        payload: Payload | None = None,
    ) -> dict[str, Float[Array, "T n"]]:
        """The parts of the torque by name [N m].

        Analytic, loss, and named laws and net where there are any.
        """
        rigid = self.arm.with_payload(payload).inverse_dynamics(q, dq, ddq)
        terms = {"analytic": rigid, "loss": self.loss.torque(dq, ddq)}
        if self.named:
            terms["named"] = named_torque(self.named, q, dq, rigid, self.loss.transition_speed)
        if self.carried:
            moving = moving_arm(self.arm.with_payload(payload), self.loss, q, dq, ddq)
            terms["named"] = terms.get("named", 0.0) + carried_torque(self.carried, moving)
        if self.net is not None:
            terms["net"] = self._learned(q, dq, ddq, rigid)
        if self.carried:
            # What the log makes of the torque that acts is said with the names.
            total = sum(terms.values(), np.zeros_like(rigid))
            logged = as_logged(self.carried, total, moving.interval)
            terms["named"] = terms["named"] + logged - total
        return terms

    def _learned(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        rigid: Float[Array, "T n"],
    ) -> Float[Array, "T n"]:
        """The net's torque; along a motion that of a joint's memory where it has one [N m]."""
        assert self.net is not None
        said = self.net.predict(q, dq, ddq, rigid)
        if self.memory is None or not self.memory.kept.any():
            return said
        interval = sampling_interval(q, dq)
        if interval is None:
            return said
        remembered = self.memory.predict(q, dq, ddq, rigid, interval)
        return np.where(self.memory.kept, remembered, said)

    def ladder(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        payload: Payload | None = None,
    ) -> dict[str, Float[Array, "T n"]]:
        """Torque by rungs: analytic (the URDF's rigid body), urdf, inertia, loss, named, net [N m].

        Each has all that is below it, but for `urdf`: the URDF as a simulator loads it, with the
        friction that its `<dynamics>` state, which the loss takes the place of.
        """
        terms = self.torque_terms(q, dq, ddq, payload)
        rungs = {"analytic": self.nominal.with_payload(payload).inverse_dynamics(q, dq, ddq)}
        if self.states_friction:
            model = self.nominal.model
            width = np.maximum(self.loss.transition_speed, SHARPEST)
            stated = model.damping * dq + model.friction * np.tanh(dq / width)
            rungs["urdf"] = rungs["analytic"] + stated
        total = terms["analytic"]
        if self.inertia != "nominal":
            rungs["inertia"] = total
        for name in ("loss", "named", "net"):
            if name in terms:
                total = total + terms[name]
                rungs[name] = total
        return rungs

    def save(self, folder: str | Path) -> Path:
        """Writes the model as a folder of readable text plus weights, whole or not at all."""
        target = Path(folder)
        with atomic_folder(target, MODEL_KIND) as place:
            (place / "robot.urdf").write_text(self.robot.urdf, encoding="utf-8")
            (place / "arm.urdf").write_text(self.nominal.urdf, encoding="utf-8")
            (place / MODEL_FILE).write_text(tomli_w.dumps(self.record()), encoding="utf-8")
            if self.net is not None:
                self.net.save(place)
            if self.memory is not None:
                self.memory.save(place)
        return target

    @classmethod
    def given(cls, model: HybridModel | str | Path) -> HybridModel:
        """A model, or the one in a folder.

        Raises:
            ModelError: It is none, or can't be read.
        """
        if isinstance(model, HybridModel):
            return model
        if not isinstance(model, str | Path):
            what = f"a {type(model).__name__} is no model"
            raise ModelError("model", what, "give a HybridModel or its folder")
        return cls.load(model)

    @classmethod
    def load(cls, folder: str | Path) -> HybridModel:
        """Reads a saved model.

        Raises:
            ModelError: Not a model folder, or damaged.
        """
        path = Path(folder)
        file = path / MODEL_FILE
        if not file.is_file():
            remedy = "make one with `ident fit … --out MODEL`"
            raise ModelError(path, "not a model folder: it has no model.toml", remedy)
        record = read_toml(file, REMEDY, ModelError)
        if record.get("schema") != SCHEMA:
            what = f"schema is {record.get('schema')!r}, not {SCHEMA!r}"
            raise ModelError(file, what, REMEDY)
        try:
            model = cls._read(path, record)
            model._check()
        except ModelError:
            raise
        except InputError as error:
            raise ModelError(path, f"its URDF is damaged ({error.what})", REMEDY) from None
        except (
            AttributeError,
            IndexError,
            KeyError,
            OSError,
            OverflowError,
            TypeError,
            ValueError,
        ) as error:
            raise ModelError(file, f"damaged ({error!r})", REMEDY) from None
        return model

    @classmethod
    def _read(cls, folder: Path, record: JsonRecord) -> HybridModel:
        """The model of a record and of the files beside it; any error where it is damaged."""
        robot = _read_arm(folder / "robot.urdf", record["robot"])
        nominal = _read_arm(folder / "arm.urdf", record["robot"])
        n = nominal.n
        arm, loss = _read_fit(nominal, record["inertia"]["links"], record["loss"])
        alone = None
        if "alone" in record:
            alone = _read_fit(nominal, record["alone"]["links"], record["alone"])
        net = None
        if record.get("net", {}).get("preset", "none") != "none":
            from ident.model.residual_net import ResidualNet

            net = ResidualNet.load(folder)
        memory = None
        if record.get("net", {}).get("memory"):
            from ident.model.memory import JointMemory

            memory = JointMemory.load(folder, n)
        trained = None
        if "trained" in record:
            trained = TrainingRange.from_dict(record["trained"])
        losses = record["loss"].get("figures", [])
        inertias = record["inertia"].get("figures", [])
        carried = record.get("carried", [])
        named = record.get("named", [])
        return cls(
            robot=robot,
            nominal=nominal,
            arm=arm,
            loss=loss,
            alone=alone,
            net=net,
            memory=memory,
            links=record["robot"]["links"],
            inertia=record["inertia"]["mode"],
            figures=tuple(LossFigure(**entry) for entry in losses),
            inertias=tuple(InertiaFigure(**entry) for entry in inertias),
            carried=tuple(CarriedEffect.from_dict(entry, n) for entry in carried),
            named=tuple(NamedLaw.from_dict(entry, n) for entry in named),
            trained=trained,
            provenance=record.get("provenance", {}),
        )

    def _check(self) -> None:
        """Raises ValueError unless the parts speak of the same joints, in finite numbers."""
        n = self.arm.n
        fits = [(self.arm, self.loss)]
        if self.alone is not None:
            fits.append(self.alone)
        for arm, loss in fits:
            for name in (*NAMES, "transition_speed"):
                values = getattr(loss, name)
                if values.shape != (n,) or not np.all(np.isfinite(values)):
                    raise ValueError(f"{name} of the loss is {values.tolist()}, not {n} numbers")
            if not np.all(np.isfinite(arm.inertial_parameters)):
                raise ValueError("an inertia is not finite")
        if self.net is not None and self.net.n != n:
            raise ValueError(f"the net has {self.net.n} joints, the arm {n}")
        if self.trained is not None and self.trained.joints != self.joint_names:
            raise ValueError(f"the training range is of {self.trained.joints}")

    def record(self) -> JsonRecord:
        """All of the model but its URDFs and weights, as it stands in model.toml."""
        fit = _fit_record(self.arm, self.loss)
        record: JsonRecord = {
            "schema": SCHEMA,
            "robot": {
                "name": self.robot.name,
                "source": str(self.robot.source.absolute() if self.robot.source else ""),
                "tip": self.robot.tip,
                "gravity_mps2": self.robot.model.gravity.linear.tolist(),
                "joints": list(self.joint_names),
                "locked": dict(self.nominal.locked_joints),
                "links": self.links,
                "urdf_sha256": self.robot.digest,
            },
            "inertia": {
                "mode": self.inertia,
                "order": "m mx my mz Ixx Ixy Iyy Ixz Iyz Izz, about the joint frame, SI",
                "links": fit.pop("links"),
                "figures": [vars(figure) for figure in self.inertias],
            },
            "loss": {**fit, "figures": [vars(figure) for figure in self.figures]},
        }
        if self.alone is not None:
            record["alone"] = _fit_record(*self.alone)
        record["net"] = self._net_record()
        if self.trained is not None:
            record["trained"] = self.trained.to_dict()
        if self.named:
            record["named"] = [law.to_dict() for law in self.named]
        if self.carried:
            record["carried"] = [effect.to_dict() for effect in self.carried]
        return {**record, "provenance": self.provenance}

    def _net_record(self) -> JsonRecord:
        """Which net there is, and the joints that have a memory."""
        preset = self.net.options.preset if self.net is not None else "none"
        record: JsonRecord = {"preset": preset}
        if self.memory is not None:
            pairs = zip(self.joint_names, self.memory.kept, strict=True)
            record["memory"] = [name for name, has_memory in pairs if has_memory]
        return record

    def require_robot(self, arm: ArmModel, where: str | Path) -> None:
        """Raises ModelError unless the model was fitted for this robot.

        The same joints, lengths and inertias.
        """
        if set(self.joint_names) <= set(arm.joint_names) and self.robot.is_same(arm):
            return
        joints = ", ".join(self.joint_names)
        what = f"the model is of {self.robot.name!r} ({joints}), not of {arm.name!r}"
        if arm.name == self.robot.name:
            what += ": lengths or inertias differ"
        raise ModelError(where, what, "fit a model for this robot")


def _fit_record(arm: ArmModel, loss: LossParameters) -> JsonRecord:
    """Ten numbers a link, and losses."""
    numbers = arm.inertial_parameters.reshape(arm.n, 10).tolist()
    losses = {name: getattr(loss, name).tolist() for name in NAMES}
    return {
        "links": dict(zip(arm.links, numbers, strict=True)),
        **losses,
        "transition_speed_rad_s": loss.transition_speed.tolist(),
    }


def _read_arm(path: Path, robot: JsonRecord) -> ArmModel:
    """An arm of a URDF, with gravity, the place and the locked joints that the record names."""
    # A name in a file is one from where that file is, not from where a command is started.
    source = (path.parent / robot["source"]).absolute() if robot["source"] else None
    gravity = np.array(robot.get("gravity_mps2", STANDARD_GRAVITY))
    urdf = read_text(path, REMEDY, ModelError)
    arm = ArmModel.from_urdf(urdf, source, tip=robot.get("tip", "")).with_gravity(gravity)
    # In its URDF they are fixed, in the file that it came from they move.
    locked = {
        name: float(position)
        for name, position in robot.get("locked", {}).items()
        if name not in arm.joint_names
    }
    return replace(arm, locked_joints={**arm.locked_joints, **locked})


def _read_fit(
    nominal: ArmModel, links: dict[str, list[float]], losses: JsonRecord
) -> tuple[ArmModel, LossParameters]:
    """An arm and its losses from their record.

    KeyError or ValueError where they are not ten numbers a link.
    """
    numbers = np.array([links[name] for name in nominal.links], dtype=float)
    if numbers.shape != (nominal.n, 10):
        raise ValueError(f"link inertias have shape {numbers.shape}, not {(nominal.n, 10)}")
    arm = nominal
    if not np.array_equal(numbers.ravel(), nominal.inertial_parameters):
        arm = nominal.with_inertial_parameters(numbers.ravel())
    return arm, LossParameters(*(losses[name] for name in (*NAMES, "transition_speed_rad_s")))
