"""Options of the jobs, each once: the functions take them by name; commands, help and reference are
made of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, get_args

from ident.errors import InputError
from ident.recordings import TOPIC

if TYPE_CHECKING:
    from ident.motion.settings import MotionSettings

# How the links' inertias are found, or that runs left out decide.
Inertia = Literal["auto", "nominal", "base", "consistent"]
# Whether joints have a constant torque, or that runs left out decide.
Offset = Literal["auto", "on", "off"]
# Laws of friction beside the plain ones: those that runs left out ask for, also what a diagnosis of
# the same recordings is sure of, or none but those of a given diagnosis.
Laws = Literal["runs", "auto", "none"]
Net = Literal["default", "paper", "none"]
# Names of the two kinds of arm, after the paper's six-jointed one; a full arm of seven joints is a
# 6 too.
FULL_ARM = 6
LUMPED = 3
# Seeds of the arms that follow the first fit below the simulator's own bound.
LARGEST_SEED = 2**62 - 1
READ = "read"
# What `--robot` takes.
ROBOT_HELP = "URDF path, tm5-900, or a name of example-robot-data (panda, baxter:left_w2, …)"
# How long a model is driven by the logged torque alone [s].
HORIZON = 0.25
FORMATS_HELP = (
    "urdf, mjcf, toml, python, isaaclab, ros2_control, cpp, newton or feedforward: "
    "all if not given; or onnx, ur."
)
HORIZON_HELP = "Length of the replays by which a file has to beat the URDF alone [s]."


def option(
    default: Any,
    text: str,
    *names: str,
    typed: Any = None,
    place: str = "",
    one_of: Sequence[Any] = (),
    **bounds: float,
) -> Any:
    """A field of options.

    Args:
        default: Its value where it is not given.
        text: Its help.
        names: Its names on the command line, if they are not its own.
        typed: Its type on the command line, where Python takes more.
        place: The kind of a folder that the command writes; `read` of what it reads that is no path
            by its type.
        one_of: The values that there are; any if empty.
        bounds: `min` and `max`.
    """
    known = {"help": text, "names": names, "typed": typed, "one_of": one_of, "bounds": bounds}
    reads = place == READ
    return field(
        default=default, metadata={**known, "reads": reads, "writes": "" if reads else place}
    )


@dataclass(frozen=True, kw_only=True)
class Options:
    """Base of a job's options; fields without a help text are for Python alone."""

    def __post_init__(self) -> None:
        """Refuses with an InputError what is none of an option's values, or beyond its bounds."""
        for option_field in (
            option_field
            for option_field in fields(self)
            if option_field.metadata and getattr(self, option_field.name) is not None
        ):
            value = getattr(self, option_field.name)
            known = option_field.metadata["one_of"]
            bounds = option_field.metadata["bounds"]
            label = (
                *option_field.metadata["names"],
                f"--{option_field.name}" if option_field.metadata["help"] else option_field.name,
            )[0]
            if known and value not in known:
                raise InputError(
                    label, f"{value!r} is unknown", f"use one of: {', '.join(map(str, known))}"
                )
            if bounds and not bounds.get("min", -inf) <= value <= bounds.get("max", inf):
                ends = [
                    f"{words} {bounds[end]}"
                    for end, words in (("min", "from"), ("max", "to"))
                    if end in bounds
                ]
                raise InputError(
                    label, f"{value!r} is out of bounds", f"give a number {' '.join(ends)}"
                )

    @classmethod
    def of(cls, job: str, given: Mapping[str, Any]) -> Self:
        """The options of a job by their names.

        Raises:
            InputError: There is no such option.
        """
        known = [option_field.name for option_field in fields(cls)]
        for name in given:
            if name not in known:
                raise InputError(
                    job, f"there is no option {name!r}", f"give some of: {', '.join(sorted(known))}"
                )
        return cls(**given)


@dataclass(frozen=True, kw_only=True)
class ReadOptions(Options):
    """How recordings are read."""

    topic: str = option(TOPIC, "Topic of the joint states, for ROS 2 bags.")
    session_file: Path | None = option(None, "A session.toml, for folders that can't hold one.")
    accept: tuple[str, ...] = option(
        (),
        "Use the recordings although this issue refuses them; may be given again.",
        typed=list[str] | None,
    )


@dataclass(frozen=True, kw_only=True)
class FilterOptions(ReadOptions):
    """How recordings are read and filtered."""

    cutoff: float | None = option(None, "Corner of the filter for torques and columns [Hz].")


@dataclass(frozen=True, kw_only=True)
class CatalogueOptions(ReadOptions):
    """Recordings, and effects beside the catalogue's: a Python file, or in Python objects."""

    catalogue: Any = option(
        None,
        "A Python file with further effects. It is run: give none that you don't trust.",
        typed=Path | None,
    )


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(CatalogueOptions, FilterOptions):
    """How recordings are diagnosed."""

    model: Any = option(
        None, "Model fitted to this arm: its inertias count as known.", typed=Path | None
    )
    seed: int = option(0, "Seed of the sign flips by which the map of the gap is tested.", min=0)
    settings: Any = (
        None  # the numbers by which it is decided, an `ident.DiagnosisSettings`; as shipped if None
    )


@dataclass(frozen=True, kw_only=True)
class ComparisonOptions(FilterOptions):
    """How two sets of recordings are compared."""

    seed: int = option(
        0, "Seed of how runs are dealt into sets between which nothing changed.", min=0
    )


@dataclass(frozen=True, kw_only=True)
class WriteOptions(ReadOptions):
    """On which recordings written files are measured."""

    on: Any = option(
        None,
        "Sessions to measure the files on: the best of their candidates is written.",
        typed=list[Path] | None,
    )


@dataclass(frozen=True, kw_only=True)
class PatchOptions(WriteOptions, CatalogueOptions):
    """How what a diagnosis found is written."""

    into: Path | None = option(
        None,
        "Your own URDF or MJCF: friction, rotors and links are changed in it, and nothing else. "
        "The folder keeps it as it was.",
        place=READ,
    )


@dataclass(frozen=True, kw_only=True)
class ExportOptions(WriteOptions):
    """How the arm of a fitted model is written."""

    formats: tuple[str, ...] | None = option(
        None,
        FORMATS_HELP,
        "--format",
        typed=list[str] | None,
    )
    nearest: bool = option(False, "Write links that no body could be as the nearest bodies.")
    in_sample: bool = option(False, "Accept recordings that the model was fitted on.")
    horizon: float = option(HORIZON, HORIZON_HELP, min=0.01)


@dataclass(frozen=True, kw_only=True)
class VerifyOptions(FilterOptions):
    """How a model is held against limits."""

    in_sample: bool = option(False, "Accept recordings that the model was fitted on.")
    horizon: float = option(HORIZON, HORIZON_HELP, min=0.01)


@dataclass(frozen=True, kw_only=True)
class RangesOptions(FilterOptions):
    """How ranges for domain randomisation are found."""

    model: Any = option(None, "Fitted model whose inertias all days refer to.", typed=Path | None)
    out: Path | None = option(
        None, "Folder for randomisation files of Isaac Lab and MuJoCo Playground.", place="ranges"
    )


@dataclass(frozen=True)
class FitOptions(Options):
    """How a hybrid model is fitted."""

    links: int = option(
        FULL_ARM,
        "6 for the full arm with all its joints, 3 for the lumped one.",
        one_of=(LUMPED, FULL_ARM),
    )
    inertia: Inertia = option(
        "auto",
        "auto (the best on runs left out), nominal, base or consistent.",
        typed=str,
        one_of=get_args(Inertia),
    )
    net: Net = option("default", "default, paper or none.", typed=str, one_of=get_args(Net))
    offset: Offset = option(
        "auto",
        "A constant torque a joint: auto (where runs left out ask for it), on or off.",
        typed=str,
        one_of=get_args(Offset),
    )
    laws: Laws = option(
        "runs",
        "Laws of friction beside Coulomb's: runs (those that runs left out ask for), "
        "auto (also what a diagnosis of these recordings is sure of) or none.",
        typed=str,
        one_of=get_args(Laws),
    )
    coupling: str | None = option(
        None,
        "Two joints whose motors turn each other, as 5,6: friction and inertia of each act on the "
        "other; or none. If not given, neighbours are tried on runs left out.",
    )
    robust: bool = option(False, "Stretches that fit badly lose their pull.")
    seed: int = option(0, "Seed of the net.", min=0)
    accept: tuple[
        str, ...
    ] = ()  # names of issues whose refusal is overruled; on the command line of `ReadOptions`
    smoother: str = option(
        "fast", "fast, or filterpy: the same numbers, slowly.", one_of=("fast", "filterpy")
    )

    def __post_init__(self) -> None:
        """Takes True and False for an offset that is on or off."""
        if isinstance(self.offset, bool):
            object.__setattr__(self, "offset", "on" if self.offset else "off")
        super().__post_init__()

    @property
    def motion(self) -> MotionSettings:
        """How recordings become the motions that are fitted."""
        from ident.motion.settings import MotionSettings

        return MotionSettings(smoother=self.smoother)


@dataclass(frozen=True)
class WatchOptions(Options):
    """How a folder is watched; the robot is a URDF path or a name."""

    robot: str | None = option(None, f"{ROBOT_HELP}.", place=READ)
    model: str | Path | None = option(
        None, "Fitted model whose inertias all figures refer to.", typed=Path | None
    )
    diagnosed: bool = option(
        True, "Diagnose each session too (ten times the work).", "--diagnose/--no-diagnose"
    )
    level: float = option(0.05, "Chance of any false alarm in an arm's life.", min=1e-6, max=0.5)
    settle: float = option(
        10.0, "Leave a session alone that was written to within so many s.", min=0.0
    )
    workers: int = option(1, "Processes on this machine.", min=1)
    scheduler: str | None = option(None, "Address of a Dask scheduler instead.")
    accept: tuple[str, ...] = option(
        (),
        "Use the recordings although this issue refuses them; may be given again.",
        typed=list[str] | None,
    )


@dataclass(frozen=True, kw_only=True)
class CloseOptions(Options):
    """How the gap of arms is closed."""

    arms: int = option(1, "Simulated arms, each with three random effects.", min=1)
    seed: int = option(0, "Of the first arm; the next ones count up.", min=0, max=LARGEST_SEED)
    rounds: int = option(8, "Most rounds of recording an arm.", min=2)
    effects: tuple[str, ...] | None = option(
        None, "ID:JOINT:SIZE instead of random effects.", "--effect", typed=list[str] | None
    )
    recorder: Any = option(
        None,
        "Command that moves a real arm: {commands} and {session} in it become folders.",
        "--record",
        typed=str | None,
    )
    compared: bool = option(
        True, "Make rivals of the same data, try a controller with each.", "--compare/--no-compare"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.recorder is not None and self.arms != 1:
            raise InputError(
                "--arms", f"{self.arms} arms behind one recorder", "record one arm at a time"
            )


@dataclass(frozen=True)
class CheckOptions(Options):
    """What the check on withheld effects checks."""

    cases: int = option(40, "Number of cases.", min=1)
    seed: int | None = option(
        None, "Of the check; the system's entropy if not given.", min=0, max=LARGEST_SEED
    )
    out: Path = option(
        Path("out/blind"), "Folder of the check; one that was stopped there goes on."
    )
    workers: int = option(1, "Processes on this machine.", min=1)
    scheduler: str | None = option(None, "Address of a Dask scheduler instead.")
    robot: str = option("tm5-900", f"{ROBOT_HELP}.", place=READ)
    worlds: str = option(
        "", "Arms and sensors of other worlds: all, development, quoted, NAME,… (-NAME: without)."
    )
    oracle: bool = option(True, "Work out what an oracle would name (in worlds; takes time).")
    edit: bool = option(
        False, "Take named causes out of the patched model; judge it on the arm without them."
    )


@dataclass(frozen=True, kw_only=True)
class BoardOptions(Options):
    """How a public board is made, answered and scored."""

    cases: int = option(117, "make: sessions of drawn worlds and on recordings together.", min=1)
    seed: int | None = option(
        None,
        "make: of everything, answers included; the system's entropy if not given.",
        min=0,
        max=LARGEST_SEED,
    )
    real: Path | None = option(
        None,
        "make: folder of real recordings; only those that may be passed on are used.",
        place=READ,
    )
    worlds: str = option(
        "all", "make: arms and sensors that are drawn: all, development, quoted, NAME,…"
    )
    oracle: bool = option(False, "make: work out what an oracle would name (takes time).")
    kept: Path | None = option(
        None, "Folder of seed, salts and answers; beside the board, as DIR.kept, if not given."
    )
    limit: int | None = option(
        None, "answer: stop after so many sessions; the next call goes on.", min=1
    )


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(Options):
    """A session of the simulated arm; what is not given is as usual, or as the world has it."""

    effect: tuple[str, ...] = option(
        (), "ID:JOINT:SIZE; SIZE in SI units, or 3x the noise.", typed=list[str] | None
    )
    robot: str | None = option(None, f"{ROBOT_HELP}; tm5-900 if not given.", place=READ)
    world: str | None = option(
        None,
        "Another arm and sensors: a preset's name, or a TOML file. Other options hold.",
        place=READ,
    )
    seed: int = option(0, "Of everything: arm, motions, noise.", min=0)
    motion: tuple[str, ...] = option((), "Kinds of motion, in turn.", typed=list[str] | None)
    commands: Path | None = option(
        None, "Run the motions of these command files instead (as of plan excite --out)."
    )
    plan: Path | None = option(
        None, "Run this plan instead (as of plan solve --json), so many times as --runs says."
    )
    runs: int | None = option(None, "Number of runs; 10 if not given.")
    duration: float | None = option(None, "Rough duration of a run [s]; 8 if not given.")
    rate: float | None = option(None, "Log rate [Hz]; 250 if not given.")
    velocity: bool | None = option(None, "Log the velocity channel; yes if not given.")
    temperature: bool = option(False, "Log joint temperatures.")
    payload: str | None = option(None, "Known body at the flange: MASS or MASS@X,Y,Z.")
    decoy: tuple[str, ...] = option(
        (), "inertia, geometry, friction, controller.", typed=list[str] | None
    )
    answer: bool = option(False, "Write what was wrong beside the session.")
    sealed: bool = option(False, "Write it encrypted; its SHA-256 and key are printed.")
