"""EDITS.MEA: the measurement file that commands append to; it is replayed after all others."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from msgspec import Struct

from orip.files.text.lines import existing_text
from orip.records.observations.measurement import EditRecord

HEADING = "! Edits and repeated measurements; replayed after all other measurement files."


class EditsText(Struct, frozen=True):
    """EDITS.MEA as it was read.

    Parameters
    ----------
    path : Path
    shown : str
        The file as the user would name it.
    text : str or None
        None: there is no such file yet.
    """

    path: Path
    shown: str
    text: str | None

    @property
    def line_count(self) -> int:
        """Return how many lines the file will have before what is appended: its own, or those of its heading."""
        return len(self._lines_end().splitlines())

    def digest_with(self, lines: Sequence[str]) -> str:
        """Return the SHA-256 of the file with lines appended."""
        return sha256(self.text_with(lines).encode()).hexdigest()

    @property
    def digest(self) -> str | None:
        """Return the SHA-256 of the file as it was read; None if there was none."""
        return None if self.text is None else sha256(self.text.encode()).hexdigest()

    def text_with(self, lines: Sequence[str]) -> str:
        """Return the text with lines appended; what is there stays to the letter."""
        return self._lines_end() + "".join(f"{line}{self._line_end}" for line in lines)

    def _lines_end(self) -> str:
        """Return the text so that a line can follow."""
        if self.text is None:
            return f"{HEADING}\n"
        return self.text if not self.text or self.text.endswith(("\n", "\r")) else self.text + self._line_end

    @property
    def _line_end(self) -> str:
        return "\r\n" if "\r\n" in (self.text or "") else "\n"


def read_edits(path: Path, shown: str) -> EditsText:
    """Read EDITS.MEA as it stands.

    Raises
    ------
    InputError
        If it cannot be read or is not UTF-8.
    """
    return EditsText(path, shown, existing_text(path, shown))


def edit_line(record: EditRecord) -> str:
    """Return the line of an edit, such as ``DISREGARD POINT MAIN P101 1001``."""
    bundle = [record.bundle] if record.bundle is not None else []
    new_name = [record.new_name] if record.new_name is not None else []
    return " ".join([record.action, record.what, *bundle, record.owner, record.name, *new_name])
