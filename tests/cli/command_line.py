"""The program `orip` run in this process, from the words of the command line to the exit code."""

from __future__ import annotations

import io
import json
import sys
from contextlib import AbstractContextManager
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import typer.main
from msgspec import Struct
from support.json_schemas import schema_faults

from orip.cli.main import main

_tree = cache(typer.main.get_command)


def commands_put_together_once() -> AbstractContextManager[object]:
    """Let all runs of a process have the same commands: putting them together takes longer than most of them."""
    return patch.object(typer.main, "get_command", _tree)


class Said(Struct, frozen=True):
    """What a command said, and its exit code; `told` is both, as a terminal shows them together."""

    code: int
    out: str
    err: str
    told: str

    @property
    def document(self) -> Any:
        """Return stdout as one JSON document, strictly; it is as its schema says."""

        def refuse(constant: str) -> None:
            raise ValueError(constant)

        document = json.loads(self.out, parse_constant=refuse)
        assert not schema_faults(document)
        return document


class _Shared(io.BytesIO):
    """A stream that writes what it takes into another one too."""

    def __init__(self, both: io.BytesIO) -> None:
        super().__init__()
        self._both = both

    def write(self, data: Any) -> int:
        self._both.write(data)
        return super().write(data)


def orip(folder: Path, *arguments: str) -> Said:
    """Run ``orip -C folder arguments``."""
    both = io.BytesIO()
    out, err = (io.TextIOWrapper(_Shared(both), encoding="utf-8", write_through=True) for _ in range(2))
    words = ["orip", "-C", str(folder), *arguments]
    with patch.multiple(sys, argv=words, stdout=out, stderr=err), commands_put_together_once():
        try:
            main()
        except SystemExit as end:
            code = end.code
    texts = [stream.buffer.getvalue().decode("utf-8") for stream in (out, err)]  # type: ignore[attr-defined]
    assert "Traceback" not in texts[1]
    return Said(int(code or 0), *texts, both.getvalue().decode("utf-8"))
