"""HybridModel: the arm as it is identified, τ = analytic + loss + named laws + net (eq. 1), batched; and its folder.

It knows where it was fitted: how far each joint went, how fast, how hard; and how well its torque is known there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomli_w

from ident.arrays import Array, Float, freeze
from ident.errors import InputError, ModelError
from ident.files import atomic_folder
from ident.laws.carried import NamedLaw, named_torque
from ident.model.carried import CarriedEffect, as_logged, carried_torque, moving_arm
from ident.model.loss import NAMES, InertiaFigure, LossFigure, LossParameters
from ident.model.sampling import sampling_interval
from ident.recordings.recording import Payload
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


# What is bounded, and its unit, which a sliding joint reads in metres.
QUANTITIES = ("position", "speed", "acceleration")
UNITS = ("rad", "rad/s", "rad/s2")
KEYS = tuple(f"{name}_{unit.replace('/', '_')}" for name, unit in zip(QUANTITIES, UNITS, strict=True))


# Least width of a speed's sign, where a model's friction turns round at once [rad/s].
SHARPEST = 1e-6


@dataclass(frozen=True, eq=False)
class TrainingRange:
    """The box of states that the training runs of n joints went through."""

    joints: tuple[str, ...]  # names of the joints
    # Least and largest position [rad], speed [rad/s] and acceleration [rad/s²], shape (3, n).
    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]
    # Half of the 95 % interval of each joint's torque inside that box, from the covariance of all parameters and from
    # friction that changes from run to run [N m]. Noise of the effort sensor is not in it.
    torque_half_width: Float[Array, " n"]

    def __post_init__(self) -> None:
        for name in ("low", "high", "torque_half_width"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        n = len(self.joints)
        parts = (self.low, self.high)
        if any(part.shape != (3, n) or not np.isfinite(part).all() for part in parts) or np.any(self.low > self.high):
            raise ValueError("the training range is not three pairs of bounds a joint")
        if self.torque_half_width.shape != (n,) or not np.all(self.torque_half_width >= 0.0):
            raise ValueError("a half width of the torque is missing or below zero")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def first(self, joints: int) -> TrainingRange:
        """The range of the first joints alone."""
        low, high = self.low[:, :joints], self.high[:, :joints]
        return TrainingRange(self.joints[:joints], low, high, self.torque_half_width[:joints])

    def beyond(self, low: Float[Array, "3 n"], high: Float[Array, "3 n"]) -> Float[Array, "3 n"]:
        """How far a motion's bounds lie outside, as a share of the range's width; zero inside."""
        width = np.maximum(self.high - self.low, 1e-9)
        return np.maximum(np.maximum(self.low - low, high - self.high), 0.0) / width

    def to_dict(self) -> dict[str, Any]:
        """The record of a model's folder."""
        bounds = {key: np.column_stack([self.low[k], self.high[k]]).tolist() for k, key in enumerate(KEYS)}
        return {"joints": list(self.joints), **bounds, "torque_half_width_Nm": self.torque_half_width.tolist()}

    @classmethod
    def from_dict(cls, record: dict[str, Any]) -> TrainingRange:
        """What `to_dict` wrote.

        Raises:
            KeyError, ValueError: It is damaged.
        """
        bounds = np.array([record[key] for key in KEYS], dtype=float)
        if bounds.ndim != 3 or bounds.shape[2] != 2:
            raise ValueError("the training range is not three pairs of bounds a joint")
        half = np.array(record["torque_half_width_Nm"], dtype=float)
        return cls(tuple(map(str, record["joints"])), bounds[:, :, 0], bounds[:, :, 1], half)


def split_models(paths: Sequence[Path], given: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Folders of models, and sessions: models may stand before the sessions, or be given by themselves.

    Raises:
        InputError: No model, or no session.
    """
    first = 0
    while not given and first < len(paths) and (paths[first] / MODEL_FILE).is_file():
        first += 1
    models, sessions = [*given, *paths[:first]], list(paths[first:])
    if not models:
        what = f"{paths[0]} is no folder of a fitted model"
        raise InputError("evaluate", what, "give MODEL SESSION …, or SESSION … --model MODEL; `ident fit` writes one")
    if not sessions:
        raise InputError("evaluate", "no session is given", "give sessions after the models")
    return models, sessions


@dataclass(frozen=True, eq=False)
class HybridModel:
    """A fitted arm."""

    robot: ArmModel  # the whole arm as its URDF describes it; geometry comes from here
    nominal: ArmModel  # the rigid arm before identification: the robot, or its lumped three-joint model
    arm: ArmModel  # the rigid arm with identified inertias; its joints are those that the model speaks of
    loss: LossParameters  # loss parameters
    net: ResidualNet | None = None  # residual net, or None
    # What stands in for the net at some joints along a motion, where the last second counts; or None.
    memory: JointMemory | None = None
    links: int = 6  # 6 for the full arm, 3 for the lumped one
    inertia: str = "nominal"  # how the inertias were found
    figures: tuple[LossFigure, ...] = ()  # loss parameters with intervals
    inertias: tuple[InertiaFigure, ...] = ()  # base parameters with intervals; none where the URDF's inertias were kept
    trained: TrainingRange | None = None  # where the training runs went; None where that is not known
    named: tuple[NamedLaw, ...] = ()  # laws of joints that a diagnosis named
    # What else a diagnosis named, with its parameters as they were found.
    carried: tuple[CarriedEffect, ...] = ()
    # Where there are such laws, the arm and its losses as the same runs have them without.
    alone: tuple[ArmModel, LossParameters] | None = None
    provenance: dict[str, Any] = field(default_factory=dict)  # data hashes, versions, options, scores of the fit

    @property
    def joint_names(self) -> tuple[str, ...]:
        return self.arm.joint_names

    @property
    def rungs(self) -> tuple[str, ...]:
        """Names of the ladder's rungs, from the URDF's rigid body up; `urdf` where its `<dynamics>` state friction."""
        urdf = ("urdf",) if self.states_friction else ()
        inertia = ("inertia",) if self.inertia != "nominal" else ()
        named = ("named",) if self.named or self.carried else ()
        return ("analytic", *urdf, *inertia, "loss", *named, *(("net",) if self.net is not None else ()))

    @property
    def states_friction(self) -> bool:
        """Whether the URDF's `<dynamics>` state any damping or friction."""
        model = self.nominal.model
        return bool(np.any(model.damping) or np.any(model.friction))

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], payload: Payload | None = None
    ) -> Float[Array, "T n"]:
        """Joint torque that the motion needs [N m]. Source: paper, eq. 1.

        States that follow one another evenly are a motion, in which joints remember the last second.
        """
        return sum(self.torque_terms(q, dq, ddq, payload).values(), np.zeros_like(q, dtype=float))

    def torque_terms(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], payload: Payload | None = None
    ) -> dict[str, Float[Array, "T n"]]:
        """The parts of the torque by name: analytic, loss, and named laws and net where there are any [N m]."""
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
            terms["named"] = terms["named"] + as_logged(self.carried, total, moving.interval) - total
        return terms

    def _learned(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """The net's torque, or at joints that have one and along a motion that of their memory [N m]."""
        assert self.net is not None
        said = self.net.predict(q, dq, ddq, rigid)
        if self.memory is None or not self.memory.kept.any():
            return said
        interval = sampling_interval(q, dq)
        if interval is None:
            return said
        return np.where(self.memory.kept, self.memory.predict(q, dq, ddq, rigid, interval), said)

    def ladder(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], payload: Payload | None = None
    ) -> dict[str, Float[Array, "T n"]]:
        """Torque by rungs: analytic (the URDF's rigid body), urdf, inertia, loss, named, net [N m].

        Each has all that is below it, but for `urdf`: the URDF as a simulator loads it, with the friction that its
        `<dynamics>` state, which the loss takes the place of.
        """
        terms = self.torque_terms(q, dq, ddq, payload)
        rungs = {"analytic": self.nominal.with_payload(payload).inverse_dynamics(q, dq, ddq)}
        if self.states_friction:
            model, width = self.nominal.model, np.maximum(self.loss.transition_speed, SHARPEST)
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
        with atomic_folder(target, MODEL_KIND) as part:
            (part / "robot.urdf").write_text(self.robot.urdf, encoding="utf-8")
            (part / "arm.urdf").write_text(self.nominal.urdf, encoding="utf-8")
            (part / MODEL_FILE).write_text(tomli_w.dumps(self.record()), encoding="utf-8")
            if self.net is not None:
                self.net.save(part)
            if self.memory is not None:
                self.memory.save(part)
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
            raise ModelError("model", f"a {type(model).__name__} is no model", "give a HybridModel or its folder")
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
        record = read_toml(file, "fit the model again", ModelError)
        if record.get("schema") != SCHEMA:
            raise ModelError(file, f"schema is {record.get('schema')!r}, not {SCHEMA!r}", "fit the model again")
        try:
            source = Path(record["robot"]["source"])
            gravity = np.array(record["robot"].get("gravity_mps2", STANDARD_GRAVITY))
            robot = ArmModel.from_urdf(read_text(path / "robot.urdf", "fit the model again", ModelError), source)
            nominal = ArmModel.from_urdf(read_text(path / "arm.urdf", "fit the model again", ModelError), source)
            robot, nominal = robot.with_gravity(gravity), nominal.with_gravity(gravity)
            arm, loss = _read_fit(nominal, record["inertia"]["links"], record["loss"])
            alone = _read_fit(nominal, record["alone"]["links"], record["alone"]) if "alone" in record else None
            net, memory = None, None
            if record.get("net", {}).get("preset", "none") != "none":
                from ident.model.residual_net import ResidualNet

                net = ResidualNet.load(path)
            if record.get("net", {}).get("memory"):
                from ident.model.memory import JointMemory

                memory = JointMemory.load(path, nominal.n)
            model = cls(
                robot=robot,
                nominal=nominal,
                arm=arm,
                loss=loss,
                alone=alone,
                net=net,
                memory=memory,
                links=record["robot"]["links"],
                inertia=record["inertia"]["mode"],
                figures=tuple(LossFigure(**entry) for entry in record["loss"].get("figures", [])),
                inertias=tuple(InertiaFigure(**entry) for entry in record["inertia"].get("figures", [])),
                carried=tuple(CarriedEffect.from_dict(entry, nominal.n) for entry in record.get("carried", [])),
                named=tuple(NamedLaw.from_dict(entry, nominal.n) for entry in record.get("named", [])),
                trained=TrainingRange.from_dict(record["trained"]) if "trained" in record else None,
                provenance=record.get("provenance", {}),
            )
            model._check()
        except ModelError:
            raise
        except InputError as error:
            raise ModelError(path, f"its URDF is damaged ({error.what})", "fit the model again") from None
        except (AttributeError, IndexError, KeyError, OSError, OverflowError, TypeError, ValueError) as error:
            raise ModelError(file, f"damaged ({error!r})", "fit the model again") from None
        return model

    def _check(self) -> None:
        """Raises ValueError unless the parts speak of the same joints, in finite numbers."""
        n = self.arm.n
        for arm, loss in ((self.arm, self.loss), *(() if self.alone is None else (self.alone,))):
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

    def record(self) -> dict[str, Any]:
        """All of the model but its URDFs and weights, as it stands in model.toml."""
        own = _fit_record(self.arm, self.loss)
        return {
            "schema": SCHEMA,
            "robot": {
                "name": self.robot.name,
                "source": str(self.robot.source or ""),
                "gravity_mps2": self.robot.model.gravity.linear.tolist(),
                "joints": list(self.joint_names),
                "links": self.links,
                "urdf_sha256": self.robot.digest,
            },
            "inertia": {
                "mode": self.inertia,
                "order": "m mx my mz Ixx Ixy Iyy Ixz Iyz Izz, about the joint frame, SI",
                "links": own.pop("links"),
                "figures": [vars(figure) for figure in self.inertias],
            },
            "loss": {**own, "figures": [vars(figure) for figure in self.figures]},
            **({} if self.alone is None else {"alone": _fit_record(*self.alone)}),
            "net": self._net_record(),
            **({} if self.trained is None else {"trained": self.trained.to_dict()}),
            **({"named": [law.to_dict() for law in self.named]} if self.named else {}),
            **({"carried": [one.to_dict() for one in self.carried]} if self.carried else {}),
            "provenance": self.provenance,
        }

    def _net_record(self) -> dict[str, Any]:
        """Which net there is, and the joints that have a memory."""
        record: dict[str, Any] = {"preset": self.net.options.preset if self.net is not None else "none"}
        if self.memory is not None:
            pairs = zip(self.joint_names, self.memory.kept, strict=True)
            record["memory"] = [name for name, kept in pairs if kept]
        return record

    def require_robot(self, arm: ArmModel, where: str | Path) -> None:
        """Raises ModelError unless the model was fitted for this robot: the same joints, lengths and inertias."""
        if not set(self.joint_names) <= set(arm.joint_names) or not self.robot.is_same(arm):
            what = f"the model is of {self.robot.name!r} ({', '.join(self.joint_names)}), not of {arm.name!r}"
            same = ": lengths or inertias differ" if arm.name == self.robot.name else ""
            raise ModelError(where, what + same, "fit a model for this robot")


def _fit_record(arm: ArmModel, loss: LossParameters) -> dict[str, Any]:
    """Ten numbers a link, and losses."""
    rows = zip(arm.links, arm.inertial_parameters.reshape(arm.n, 10).tolist(), strict=True)
    losses = {name: getattr(loss, name).tolist() for name in NAMES}
    return {"links": dict(rows), **losses, "transition_speed_rad_s": loss.transition_speed.tolist()}


def _read_fit(nominal: ArmModel, links: Any, losses: Any) -> tuple[ArmModel, LossParameters]:
    """An arm and its losses from their record; KeyError or ValueError where they are not ten numbers a link."""
    numbers = np.array([links[name] for name in nominal.links], dtype=float)
    if numbers.shape != (nominal.n, 10):
        raise ValueError(f"link inertias have shape {numbers.shape}, not {(nominal.n, 10)}")
    same = np.array_equal(numbers.ravel(), nominal.inertial_parameters)
    arm = nominal if same else nominal.with_inertial_parameters(numbers.ravel())
    return arm, LossParameters(*(losses[name] for name in (*NAMES, "transition_speed_rad_s")))
