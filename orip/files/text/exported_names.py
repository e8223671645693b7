"""Names of files that are made of names in the data, which may be anything: one place decides for all formats."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import PurePath

_UNFIT = frozenset('/\\:*?"<>|')
_LONGEST = 200
"""Bytes; file systems take 255."""
_DEVICES = frozenset({"CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"}) | {
    f"{port}{number}" for port in ("COM", "LPT") for number in "0123456789¹²³"
}
"""What Windows takes for a device, whatever follows after a dot."""


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
        base, number = _fit_exported(name, _LONGEST - len(pattern.encode()) - 8), 1
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


def is_device(name: str) -> bool:
    """Tell whether Windows takes a name of a file for a device; what follows after a dot does not count."""
    return name.partition(".")[0].rstrip().upper() in _DEVICES


def _fit_exported(name: str, longest: int) -> str:
    fit = "".join(c if (c.isprintable() or c == " ") and c not in _UNFIT else "_" for c in name)
    while len(fit.encode("utf-8")) > longest:
        fit = fit[: longest if len(fit) > longest else -1]
    fit = fit.rstrip(". ") or "_"  # Windows drops dots and blanks at the end
    return f"_{fit}" if is_device(fit) else fit
