"""Members of zip files, read into memory within limits; nothing is ever unpacked to a disk."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path, PurePosixPath

from orip.exchange.sources.faults import Faults
from orip.files.text.regular_file import open_regular
from orip.files.text.shown import shown_token

_SMALL, _HIGHEST_RATIO = 1 << 22, 60
"""Bytes of a member that are always read; above, how many times larger than in the file it may be."""

_MOST_MEMBERS = 100_000


class ZipMembers:
    """The members of a zip file by name.

    Parameters
    ----------
    path : Path
    faults : Faults
        Takes the complaints: no zip file, names that lead out of it.
    """

    def __init__(self, path: Path, faults: Faults) -> None:
        self._path = path
        self._faults = faults
        self._sizes: dict[str, zipfile.ZipInfo] = {}
        try:
            with open_regular(path) as stream, zipfile.ZipFile(stream) as archive:
                members = archive.infolist()
        except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, EOFError) as fault:
            faults.complain(f"the zip file cannot be read ({fault}); save the project again")
            return
        if len(members) > _MOST_MEMBERS:
            faults.complain(f"{len(members)} members are more than a project has")
            return
        self._keep(members)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the members."""
        return tuple(self._sizes)

    def read(self, name: str) -> bytes | None:
        """Return the bytes of a member; None, and a complaint kept, if it is missing or damaged."""
        info = self._sizes.get(name)
        if info is None:
            self._faults.complain(f"there is no member '{shown_token(name)}'; save the project again")
            return None
        if info.file_size > _SMALL + _HIGHEST_RATIO * info.compress_size:
            self._faults.complain(
                f"member '{shown_token(name)}' would be {info.file_size} bytes from {info.compress_size}; "
                "no project has such a member, nothing is read"
            )
            return None
        try:
            with open_regular(self._path) as stream, zipfile.ZipFile(stream) as archive, archive.open(info) as member:
                data = member.read(info.file_size)
        except (
            zipfile.BadZipFile,
            zlib.error,
            OSError,
            ValueError,
            NotImplementedError,
            RuntimeError,
            EOFError,
        ) as fault:
            self._faults.complain(f"member '{shown_token(name)}' cannot be read ({fault}); save the project again")
            return None
        return data

    def _keep(self, members: list[zipfile.ZipInfo]) -> None:
        for info in members:
            if is_inside(info.filename):
                self._sizes[info.filename] = info
            else:
                message = (
                    f"member '{shown_token(info.filename)}' has a name that leads out of the project; it is refused"
                )
                self._faults.complain(message)


def is_inside(name: str) -> bool:
    """Return whether a relative name stays in its folder."""
    parts = PurePosixPath(name.replace("\\", "/"))
    return bool(name) and not parts.is_absolute() and ".." not in parts.parts and ":" not in name and "\0" not in name
