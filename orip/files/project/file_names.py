"""Rules for the names of files, checked before any file is opened: of a project, and of what is exported."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import PurePath

_UNFIT_IN_FILE_NAMES = frozenset('/\\:*?"<>|')
_WILDCARDS = frozenset("*?[")
_LONGEST_NAME = 200
"""Bytes; file systems take 255, and what stands before and after it (_PRELIM_RESULT.OUT, -journal) needs its room."""
_DEVICES = frozenset({"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}) | {
    f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"
}
"""What Windows takes for a device, whatever follows after a dot."""
_LONGEST_PATH = 1000
"""Bytes; the folder before it needs its room in the 4096 that systems take."""


def file_name_fault(name: str) -> str | None:
    """Say why a name cannot be the base name of files, or return None if it can."""
    if not name or not name.isprintable():
        return "is empty or has characters that cannot be printed"
    if any(character.isspace() for character in name):
        return "has a blank"
    unfit = sorted(set(name) & _UNFIT_IN_FILE_NAMES)
    if unfit:
        return f"has {' '.join(unfit)}, which file names cannot have"
    return "is not a file name" if name in {".", ".."} else _length_fault(name)


def fit_file_name(name: str) -> str:
    """Return the file name nearest to a name that cannot be one."""
    fit = "".join(c if c.isprintable() and not c.isspace() and c not in _UNFIT_IN_FILE_NAMES else "_" for c in name)
    return fit if fit.strip("._") else "PROJECT"


def exported_file_names(pattern: str, names: Sequence[str], taken: Iterable[str] = ()) -> list[str]:
    """Return names of files that an export makes of names in the data: each a file of its own in the export's folder.

    What no file name can have on any system becomes ``_``, a name that is too long is cut, and what is then the same
    as another, on systems where case does not count, gets a number.

    Parameters
    ----------
    pattern : str
        Of the files, such as ``Orientation-{}.xml``.
    names : sequence of str
        From the data: they may be anything.
    taken : iterable of str
        Other files of the export.
    """
    used = {name.casefold() for name in taken}
    found = []
    for name in names:
        base, number = _fit_exported(name, _LONGEST_NAME - len(pattern.encode()) - 8), 1
        fit = pattern.format(base)
        while fit.casefold() in used:
            number += 1
            fit = pattern.format(f"{base}_{number}")
        used.add(fit.casefold())
        found.append(fit)
    return found


def is_one_file_name(name: str) -> bool:
    """Tell whether a name is that of a file in the folder that it is put into, and leads nowhere else."""
    is_windows_path = os.name == "nt" and (":" in name or "\\" in name)
    return PurePath(name).name == name and name not in {"", ".", ".."} and "\0" not in name and not is_windows_path


def _fit_exported(name: str, longest: int) -> str:
    fit = "".join(c if (c.isprintable() or c == " ") and c not in _UNFIT_IN_FILE_NAMES else "_" for c in name)
    while len(fit.encode("utf-8")) > longest:
        fit = fit[: longest if len(fit) > longest else -1]
    fit = fit.rstrip(". ") or "_"  # Windows drops dots and blanks at the end
    return f"_{fit}" if fit.split(".")[0].rstrip().upper() in _DEVICES else fit


def store_path_fault(path: str, extension: str) -> str | None:
    """Say why a text cannot be the path of a store that has the extension, or return None if it can."""
    if not path.isprintable():
        return f"has characters that cannot be printed; write a file name such as NAME{extension}"
    if PurePath(path).suffix.upper() != extension:
        return f"does not end in {extension}, as this store does; write a file name such as NAME{extension}"
    fault = _length_fault(path)
    return None if fault is None else f"{fault}; choose a shorter one"


def pattern_fault(pattern: str) -> str | None:
    """Say why a text cannot be the pattern of files, or return None if it can."""
    if not pattern.isprintable():
        return 'has characters that cannot be printed; write a pattern such as "*.MEA"'
    parts = PurePath(pattern).parts
    if is_pattern(pattern) and PurePath(pattern).anchor:
        return "has wildcards and begins at the top of the disk; write it from the project folder, or name each file"
    if any("**" in part and part != "**" for part in parts):
        return "has ** beside other characters; ** stands alone between two slashes, for folders"
    fault = _length_fault(pattern)
    return None if fault is None else f"{fault}; choose a shorter one"


def is_pattern(name: str) -> bool:
    """Tell whether a name has wildcards."""
    return not _WILDCARDS.isdisjoint(name)


def _length_fault(path: str) -> str | None:
    longest = max((len(part.encode("utf-8", "surrogatepass")) for part in PurePath(path).parts), default=0)
    if longest > _LONGEST_NAME:
        return f"has {longest} bytes, and names of files have up to {_LONGEST_NAME}"
    size = len(path.encode("utf-8", "surrogatepass"))
    return f"has {size} bytes, and paths have up to {_LONGEST_PATH}" if size > _LONGEST_PATH else None
