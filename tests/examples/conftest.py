"""Recordings of real arms, where they are there."""

from tests.ident.conftest import real_data

__all__ = ["real_data"]
