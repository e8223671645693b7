"""The digest by which a change of a file is recognised."""

from __future__ import annotations

import hashlib
from pathlib import Path

from orip.files.text.regular_file import open_regular


def text_digest(text: str) -> str:
    """Return the digest that a file with a text has."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes as 64 hexadecimal digits.

    Raises
    ------
    OSError
        If the file cannot be read, or is no regular file.
    """
    with open_regular(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
