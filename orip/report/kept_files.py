"""What is made from files that do not change, kept beside the package like the compiled modules of Python.

Templates as they were compiled last, and the compressed script of the page.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable
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
        _keep(self._path(bucket), bucket.bytecode_to_string())

    @staticmethod
    def _path(bucket: Bucket) -> Path:
        return _FOLDER / f"{bucket.key}.{sys.implementation.cache_tag}.template"


def kept(name: str, made: Callable[[], bytes]) -> bytes:
    """Return the content of a kept file, which is made where it is not there; its name tells what it was made from."""
    path = _FOLDER / name
    with suppress(OSError):
        return path.read_bytes()
    content = made()
    _keep(path, content)
    return content


def _keep(path: Path, content: bytes) -> None:
    """Write a file, if that can be; killed at any instant, it is whole or not there."""
    if sys.dont_write_bytecode:
        return
    with suppress(OSError):
        descriptor, written = tempfile.mkstemp(dir=_FOLDER, suffix=path.suffix)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        Path(written).chmod(0o644)  # as compiled modules have it
        os.replace(written, path)  # noqa: PTH105
