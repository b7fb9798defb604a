"""The numbers by which two sets of recordings are compared."""

from __future__ import annotations

from ident.records import read_group

CHANGE, PRIOR, PERMUTED = (read_group(__file__, table) for table in ("change", "prior", "permuted"))
