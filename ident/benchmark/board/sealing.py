"""Sealed answers: SHA-256 over a salt and the answer. Who has salt and answer can check it; without
the salt nobody can try answers until one fits.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from collections.abc import Mapping
from pathlib import Path

from ident.errors import InputError
from ident.outputs import sha256_of
from ident.records import JsonTable

REMEDY = "give the file that the maker kept of this board, as it was"


def salt_of(seed: int, session: str) -> str:
    """Salt of a session's seal: 32 bytes that follow from the board's seed, in hexadecimal."""
    key = f"ident.board/1 {seed}".encode()
    return hmac.new(key, session.encode(), hashlib.sha256).hexdigest()


def canonical(answer: JsonTable) -> str:
    """An answer as one line in which keys stand in order and no space is left."""
    return json.dumps(answer, sort_keys=True, separators=(",", ":"), allow_nan=False)


def seal_of(salt: str, answer: JsonTable) -> str:
    """SHA-256 over the salt, a line feed, and the answer in its canonical form."""
    text = f"{salt}\n{canonical(answer)}"
    return hashlib.sha256(text.encode()).hexdigest()


def check_seals(
    sealed: Mapping[str, str],
    salts: Mapping[str, str],
    answers: Mapping[str, JsonTable],
    where: Path,
) -> None:
    """Passes if every sealed answer is there and as it was sealed.

    Raises:
        InputError: One is missing, or was changed.
    """
    for session, seal in sealed.items():
        if session not in salts or session not in answers:
            raise InputError(where, f"it lacks the answer of {session}", REMEDY)
        if not hmac.compare_digest(seal, seal_of(salts[session], answers[session])):
            what = f"the answer of {session} is not the one that was sealed"
            raise InputError(where, what, REMEDY)


def digest_of(folder: Path, pattern: str = "*") -> str:
    """SHA-256 over the names and contents of a folder's files: by it an entry is known again."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob(pattern)):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
            digest.update(bytes.fromhex(sha256_of(path)))
    return digest.hexdigest()
