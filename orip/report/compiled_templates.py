"""Templates as they were compiled last, kept beside the package like the compiled modules of Python."""

from __future__ import annotations

import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from jinja2.bccache import Bucket, BytecodeCache

_FOLDER = Path(__file__).parent / "__pycache__"


class CompiledTemplates(BytecodeCache):
    """Reads and writes compiled templates in the folder of compiled modules, if that can be written.

    Jinja2 compares the digest of the template, and its own version and that of Python.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        """Read a template, if it is there."""
        with suppress(OSError), self._path(bucket).open("rb") as file:
            bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write a template; killed at any instant, the file is whole or not there."""
        if sys.dont_write_bytecode:
            return
        with suppress(OSError):
            descriptor, written = tempfile.mkstemp(dir=_FOLDER, suffix=".template")
            with os.fdopen(descriptor, "wb") as file:
                bucket.write_bytecode(file)
            Path(written).chmod(0o644)  # as compiled modules have it
            os.replace(written, self._path(bucket))  # noqa: PTH105

    @staticmethod
    def _path(bucket: Bucket) -> Path:
        return _FOLDER / f"{bucket.key}.{sys.implementation.cache_tag}.template"
