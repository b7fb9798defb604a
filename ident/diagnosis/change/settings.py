"""Settings of a comparison: its search, its prior, and the permutation of runs."""

from __future__ import annotations

from ident.records import read_group

CHANGE, PRIOR, PERMUTED = (read_group(__file__, table) for table in ("change", "prior", "permuted"))
