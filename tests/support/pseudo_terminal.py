"""orip at a terminal of a certain width: what it writes there, byte by byte, and what stays to be seen."""

from __future__ import annotations

import fcntl
import os
import re
import struct
import sys
import termios
import threading
from pathlib import Path
from unittest.mock import patch

from msgspec import Struct

from orip.cli import terminal as progress_bar
from orip.cli.main import main

NEVER = 1e3
_ESCAPE = re.compile(r"\x1b\[([0-9;?]*)([A-Za-z])")


class Shown(Struct, frozen=True):
    """What a command wrote to a terminal, by stdout and stderr, and its exit code."""

    code: int
    raw: bytes

    @property
    def text(self) -> str:
        """Return what was written, without colours."""
        return re.sub(r"\x1b\[[0-9;]*m", "", self.raw.decode("utf-8", errors="replace")).replace("\r\n", "\n")

    @property
    def screen(self) -> list[str]:
        """Return the lines that are left in the end, as a terminal of endless height has them."""
        lines, row, column = [""], 0, 0
        text, place = self.raw.decode("utf-8", errors="replace"), 0
        while place < len(text):
            if found := _ESCAPE.match(text, place):
                place = found.end()
                if found[2] == "A":
                    row -= int(found[1] or 1)
                elif found[2] == "K":
                    assert found[1] == "2"
                    lines[row] = ""
                else:
                    assert found[2] in "mhl", found[0]
                continue
            if text[place] == "\n":
                row += 1
                lines += [""] * (row == len(lines))
            elif text[place] == "\r":
                column = 0
            else:
                lines[row] = f"{lines[row][:column]:{column}}{text[place]}{lines[row][column + 1 :]}"
                column += 1
            place += 1
        return lines[:-1] if not lines[-1] else lines


def at_terminal(
    folder: Path,
    *arguments: str,
    columns: int = 80,
    delay: float = NEVER,
    encoding: str = "utf-8",
    environment: dict[str, str] | None = None,
) -> Shown:
    """Run ``orip -C folder arguments`` at a terminal; bars appear after a delay in seconds."""
    leader, follower = os.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    given = {key: value for key, value in os.environ.items() if key not in {"COLUMNS", "NO_COLOR"}}
    raw = bytearray()
    reader = threading.Thread(target=_read, args=(leader, raw))
    reader.start()
    code: object = 0
    with (
        os.fdopen(os.dup(follower), "w", encoding=encoding) as out,
        os.fdopen(follower, "w", encoding=encoding) as err,
        patch.multiple(sys, argv=["orip", "-C", str(folder), *arguments], stdout=out, stderr=err),
        patch.dict(os.environ, {**given, "TERM": "xterm", **(environment or {})}, clear=True),
        patch.object(progress_bar, "DELAY_SECONDS", delay),
    ):
        try:
            main()
        except SystemExit as end:
            code = end.code
    reader.join()
    os.close(leader)
    return Shown(int(code or 0), bytes(raw))  # type: ignore[call-overload]


def _read(leader: int, raw: bytearray) -> None:
    """Read until the last writer has gone, which Linux tells by an error."""
    while True:
        try:
            piece = os.read(leader, 65536)
        except OSError:
            return
        if not piece:
            return
        raw += piece
