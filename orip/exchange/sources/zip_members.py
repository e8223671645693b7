"""Members of zip files, by names that stay inside, and not larger than such files are when they are packed."""

from __future__ import annotations

import zipfile
import zlib
from io import BytesIO
from pathlib import Path, PurePosixPath

from orip.exchange.sources.faults import Faults
from orip.files.text.lines import read_bytes
from orip.files.text.regular_file import LARGEST_FILE
from orip.files.text.shown import shown_token

_LARGEST_GROWTH = 100
"""Times the size of the zip file that all its members may have; more is made to fill the memory."""

_ALWAYS = 1 << 20
"""Bytes that members may have in any case."""


def is_inside(name: str) -> bool:
    """Return whether a relative path stays in the folder that it begins in."""
    path = PurePosixPath(name.replace("\\", "/"))
    return bool(name) and not path.is_absolute() and ".." not in path.parts and ":" not in path.parts[0]


class ZipMembers:
    """A zip file that is open.

    Parameters
    ----------
    archive : zipfile.ZipFile
    faults : Faults
        Of the zip file; takes the complaints.
    most : int
        Bytes that all members together may have.
    """

    def __init__(self, archive: zipfile.ZipFile, faults: Faults, most: int) -> None:
        self._archive = archive
        self._left = most
        self.faults = faults

    def of_member(self, name: str) -> Faults:
        """Return the faults of a member; they are those of the zip file."""
        return Faults(f"{self.faults.shown}/{shown_token(name)}", self.faults.complaints)

    def read(self, name: str) -> bytes | None:
        """Return the bytes of a member; None, and a complaint kept, if it cannot be read."""
        if not is_inside(name):
            self.faults.complain(f"'{shown_token(name)}' leads out of the zip file; it is not read")
            return None
        try:
            size = self._archive.getinfo(name).file_size
            if size > self._left:
                self.faults.complain(f"'{shown_token(name)}' says that it has {size} bytes, more than can be; not read")
                return None
            self._left -= size
            return self._archive.read(name)
        except KeyError:
            self.faults.complain(f"the zip file has no '{shown_token(name)}'; save the project again")
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError, ValueError):
            self.faults.complain(f"'{shown_token(name)}' is damaged or encrypted; save the project again")
        return None


def open_zip(path: Path, faults: Faults) -> ZipMembers | None:
    """Return a zip file whose members are all inside it; None, and complaints kept, if it is not one."""
    data, complaints = read_bytes(path, faults.shown)
    faults.complaints += complaints
    if data is None:
        return None
    try:
        archive = zipfile.ZipFile(BytesIO(data))
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, EOFError, IndexError):
        faults.complain("this is not a zip file, or it is damaged; save the project again")
        return None
    outside = [name for name in archive.namelist() if not is_inside(name)]
    if outside:
        faults.complain(f"member '{shown_token(outside[0])}' leads out of the zip file; nothing of it is read")
        return None
    return ZipMembers(archive, faults, min(_ALWAYS + _LARGEST_GROWTH * len(data), LARGEST_FILE))
