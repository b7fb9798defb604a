"""What every result can do: tell itself in words, as a record, as a picture, and in a notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from ident.files import write_record
from ident.provenance import Provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# As much of a result as its `repr` shows [lines, characters].
LINES, LINE = 20, 100
# Why a spread over the runs is missing from a record.
ONE_RUN = "a single run tells nothing of what runs differ by"


@dataclass(frozen=True, eq=False, kw_only=True)
class Result(ABC):
    """Base of all results.

    Attributes:
        provenance: Where it comes from.
    """

    # How a result looks is known above, where pictures are made, and asked for by name when somebody looks:
    # a module with `write(console, result)` and `draw(result)`.
    SHOWN_BY: ClassVar[str] = "ident.show.results"

    provenance: Provenance = field(default_factory=Provenance)

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Every result is shown by its first lines, not by all its arrays."""
        super().__init_subclass__(**kwargs)
        cls.__repr__ = Result._first_lines  # type: ignore[assignment,method-assign]

    def _first_lines(self) -> str:
        lines = [line if len(line) <= LINE else f"{line[: LINE - 1]}…" for line in self.summary().splitlines()]
        more = f"  … {len(lines) - LINES} more lines: print(….summary())" if len(lines) > LINES else ""
        return "\n".join([f"{type(self).__name__}:", *lines[:LINES], *filter(None, [more])])

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The record that the command writes with --json; `ident schema` says what it holds."""

    def with_provenance(self, provenance: Provenance) -> Self:
        """The same result, with its origin."""
        return replace(self, provenance=provenance)

    def summary(self) -> str:
        """The result in plain lines, as the command prints it."""
        as_text = import_module("ident.show.panels").as_text
        return str(as_text(lambda console: import_module(self.SHOWN_BY).write(console, self)))

    def plot(self) -> Figure:
        """The result as a picture."""
        from matplotlib.text import Text

        figure: Figure = import_module(self.SHOWN_BY).draw(self)
        for text in figure.findobj(Text):
            text.set_parse_math(False)  # a joint's name is no formula
        return figure

    def save(self, path: str | Path) -> None:
        """Writes the record as JSON, whole or not at all."""
        write_record(path, self.to_dict())

    def _repr_html_(self) -> str:
        return str(import_module("ident.show.results").as_html(self))
