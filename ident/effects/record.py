"""The record of an effect: what is known of it beside its law.

An effect of the catalogue reads its record from its row of `effects.toml`; a user's effect states
the same fields as attributes of its class. Whatever neither says has its default here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_type_hints

from ident.effects.effect_info import AsChange, Doubt, Expression, Typical
from ident.laws.carried import KINDS, TABLE, LawKind

Size = float | str
"""A number, or a share of what a joint has ("0.5 rated", "3 coulomb") or the arm ("1 mass")."""


# Readers of the entries of a row that are no plain numbers, words or lists of these.
READERS: dict[str, Callable[[Any], Any]] = {
    "typical": lambda entry: Typical(**entry),
    "doubt": lambda entry: Doubt(**{**entry, "exact": frozenset(entry.get("exact", ()))}),
    "formats": lambda entry: {form: read_expression(stated) for form, stated in entry.items()},
    "as_change": lambda entry: AsChange(**entry),
    "clock": lambda entry: Clock(**entry),
    "finer": lambda entry: {name: FinerGrid(**numbers) for name, numbers in entry.items()},
    "set_ups": lambda entry: {other: TABLE["set_ups"][name] for other, name in entry.items()},
    "incomparable": frozenset,
    "opposite": frozenset,
}


@dataclass(frozen=True)
class Clock:
    """How times of a simulated arm's answer become those of a session."""

    run: str = ""  # the parameter that is the number of the run, from 1; "" for an effect of no run
    times: tuple[str, ...] = ()  # the parameters that are counted from that run's start [s]


@dataclass(frozen=True)
class FinerGrid:
    """A finer grid of one inner parameter about the point that fits best."""

    at: tuple[float, ...] = ()  # its numbers,
    times: tuple[float, ...] = ()  # or factors of the point's own

    def about(self, value: float) -> tuple[float, ...]:
        """The grid's numbers about a value: multiples of it, or the same wherever it is."""
        return tuple(factor * value for factor in self.times) or self.at


class EffectRecord:
    """What is known of an effect beside its law; every effect has all of it."""

    # What it is.
    id: ClassVar[str]  # fixed identifier
    summary: ClassVar[str] = ""  # one line for reports: what happens and where to look
    # `joint` if it belongs to one joint (or the link that the joint moves), `arm` if to the whole
    # arm.
    scope: ClassVar[Literal["joint", "arm"]] = "joint"

    # Its columns.
    # `own` if its torque acts on its own joint only: columns of shape (T, k);
    # `all` if on any: (T, n, k).
    rows: ClassVar[Literal["own", "all"]] = "own"
    # Columns whose coefficients can't be negative.
    nonnegative: ClassVar[tuple[int, ...]] = ()
    # Whether its columns are of the samples that the common filter keeps, so smooth that they need
    # no filter.
    decimated: ClassVar[bool] = False
    # Of a law of one joint's states: the law, the grid of numbers that bend it, and the finer grid
    # about the point that fits best.
    states: ClassVar[LawKind | None] = None
    grid: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    finer: ClassVar[Mapping[str, FinerGrid]] = {}

    # How it acts.
    # Whether wrong inertias of several links could do the same: then tuning them hides the effect.
    inertia_like: ClassVar[bool] = False
    # Whether it happens once: other runs say nothing of its size, and it can't be held out.
    event: ClassVar[bool] = False
    # Whether it acts only beyond a bound of its own (below a speed, past a gap or a travel): how
    # large it seems in a run hangs on how far the run went beyond, where the law isn't the
    # catalogue's to the letter.
    beyond_bound: ClassVar[bool] = False
    # Whether runs act on later ones.
    remembers: ClassVar[bool] = False
    # Whether it acts on whole runs: blocks of one run are no independent witnesses to it.
    by_run: ClassVar[bool] = False
    # Whether it is one of the log alone: the joint gets another torque than what is read.
    of_the_log: ClassVar[bool] = False

    # What shows it, and what tells it from others.
    # What recordings must hold to show it, by name with the least amount: see
    # `session_context.lacking`.
    needs: ClassVar[Mapping[str, float]] = {}
    # Family of the motion without which it can't be seen, one of `effect_info.SHOWINGS`.
    shown_by: ClassVar[str] = "wide"
    # For other effects, by id, the family of the motion that distinguishes the two, where it is not
    # simply the one that shows one of them.
    parted_by: ClassVar[Mapping[str, str]] = {}
    # For other effects, by id, the change of set-up that distinguishes the two, where no motion
    # does.
    set_ups: ClassVar[Mapping[str, str]] = {}
    # Other effects, by id, whose columns span its own exactly.
    twins: ClassVar[tuple[str, ...]] = ()

    # How large it is.
    # Reported parameters without which there is no such effect: where the intervals of all of them
    # hold zero, it gets no name.
    defining: ClassVar[tuple[str, ...]] = ()
    # Reported parameters that are the columns' coefficients, one after the other; see `parameters`.
    figures: ClassVar[tuple[str, ...]] = ()
    # Largest plausible coefficients; see `prior_scale`.
    prior: ClassVar[tuple[Size, ...]] = ()
    # By parameter, its least and largest value, and why no arm has others; see `physical`.
    bounds: ClassVar[Mapping[str, tuple[Size, Size, str]]] = {}
    typical: ClassVar[Typical] = Typical()  # how large it is taken to be where nobody has found it
    doubt: ClassVar[Doubt] = Doubt()  # how far an arm's own law may differ from this one
    # The parameter that is the number of another joint that takes part, or "".
    partner: ClassVar[str] = ""

    # What is said of it.
    # What to do about it, with {where} and parameters as {gap_rad:mrad}; see `action`.
    sentence: ClassVar[str] = ""
    # Whether the reported parameters leave its law open: a diagnosis then reports coefficients and
    # shape beside.
    open_law: ClassVar[bool] = False
    open_shape: ClassVar[bool] = False  # whether they leave open no more than the point of the grid
    # What even these leave open for a simulator, and what is taken then; "" for nothing.
    left_open: ClassVar[str] = ""
    # How `urdf` and `mjcf` express it, where that is not by damping and dry friction.
    formats: ClassVar[Mapping[str, Expression]] = {}
    as_change: ClassVar[AsChange] = AsChange()  # as a change between two sets of recordings
    # What its curve is drawn over: `speed`, `angle`, `load`, `torque` (load with friction and
    # rotor), `reversal` (time since one); "" for time.
    drawn_over: ClassVar[str] = ""
    # `whole` where the tuned friction is drawn with it, `odd` where its direction is taken out;
    # else "".
    drawn: ClassVar[Literal["", "whole", "odd"]] = ""

    # A simulated arm's answer in its terms; see `simulated_answer`.
    incomparable: ClassVar[frozenset[str]] = frozenset()  # parameters that it means otherwise
    opposite: ClassVar[frozenset[str]] = frozenset()  # and that it gives with the other sign
    # Parameters that it gives for another unit of motion: the factor's name, by parameter.
    multiplied_by: ClassVar[Mapping[str, str]] = {}
    clock: ClassVar[Clock] = Clock()  # and those that are times

    def __init_subclass__(cls) -> None:
        """Takes what a class does not state itself from the row of its id, if there is one."""
        for name, value in read_row(cls.__dict__.get("id", "")).items():
            if name not in cls.__dict__:
                setattr(cls, name, value)


def record_fields() -> dict[str, Any]:
    """The types of all fields of the record, by name."""
    hints = get_type_hints(EffectRecord)
    return {name: hint.__args__[0] for name, hint in hints.items()}


def read_row(effect: str) -> dict[str, Any]:
    """What the row of an id states, by the fields of `EffectRecord`; {} where there is no such row.

    Raises:
        ValueError: The row states what is no field: a name misspelt.
    """
    stated = {}
    for name, entry in TABLE["effects"].get(effect, {}).items():
        if name not in EffectRecord.__annotations__:
            raise ValueError(f"{effect} states {name!r} in effects.toml, which is no field")
        stated[name] = KINDS[effect] if name == "states" else _read_entry(name, entry)
    return stated


def read_expression(stated: tuple[Any, ...] | dict[str, Any]) -> Expression:
    """How a format expresses an effect, as the table states it.

    Args:
        stated: Its fields by name, or the first of them in their order.
    """
    if isinstance(stated, dict):
        return Expression(**stated)
    return Expression(*stated)


def _read_entry(name: str, entry: Any) -> Any:
    """A field's value from a row's entry."""
    frozen = _frozen(entry)
    if name in READERS:
        return READERS[name](frozen)
    return frozen


def _frozen(entry: Any) -> Any:
    """An entry with tuples in place of lists."""
    if isinstance(entry, list):
        return tuple(_frozen(item) for item in entry)
    if isinstance(entry, dict):
        return {name: _frozen(item) for name, item in entry.items()}
    return entry
