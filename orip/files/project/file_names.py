"""Rules for the names of a project's files, and which of them are not kept under version control."""

from __future__ import annotations

from pathlib import PurePath

from orip.files.text.atomic import is_device
from orip.records.names import name_fault

_UNFIT_IN_FILE_NAMES = frozenset('/\\:*?"<>|')
_WILDCARDS = frozenset("*?[")
_LONGEST_NAME = 200
"""Bytes; file systems take 255, and what stands before and after it (_PRELIM_RESULT.OUT, -journal) needs its room."""
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
    if is_device(name):
        return "is the name of a device on Windows, which no file can have"
    if not any(character.isalnum() for character in name):
        return "has neither letter nor digit"
    return _length_fault(name)


def bundle_name_fault(name: str) -> str | None:
    """Say why a name cannot be that of a bundle, whose files have it too, or return None if it can."""
    if fault := name_fault(name):
        return f"is not fit: {fault}"
    return file_name_fault(name)


def fit_file_name(name: str) -> str:
    """Return the file name nearest to a name that cannot be one."""
    fit = "".join(c if c.isprintable() and not c.isspace() and c not in _UNFIT_IN_FILE_NAMES else "_" for c in name)
    while len(fit.encode("utf-8", "surrogatepass")) > _LONGEST_NAME:
        fit = fit[: _LONGEST_NAME if len(fit) > _LONGEST_NAME else -1]
    if is_device(fit):
        return f"_{fit}"
    return fit if any(character.isalnum() for character in fit) else "PROJECT"


def store_path_fault(path: str, extension: str) -> str | None:
    """Say why a text cannot be the path of a store that has the extension, or return None if it can."""
    if not path.isprintable():
        return f"has characters that cannot be printed; write a file name such as NAME{extension}"
    if PurePath(path).suffix.upper() != extension:
        return f"does not end in {extension}, as this store does; write a file name such as NAME{extension}"
    if is_device(PurePath(path).name):
        return f"is the name of a device on Windows; write a file name such as NAME{extension}"
    fault = _length_fault(path)
    return None if fault is None else f"{fault}; choose a shorter one"


def image_path_fault(path: str) -> str | None:
    """Say why a text cannot be the path of an image, or return None if it can."""
    if not path.strip() or not path.isprintable():
        return 'is empty or has characters that cannot be printed; write a file name such as "DSC_0102.JPG"'
    if is_device(PurePath(path).name):
        return "is the name of a device on Windows; write the name of an image file"
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


IGNORE_FILE = ".gitignore"

IGNORED = """\
# What orip makes of the texts: 'orip run' makes it again.

# Stores. What commands have changed (orip update, orip camera edit ...) is in them alone, until 'orip export-toml'
# writes it into orip.toml.
*.CAM
*.TIK
*.PHO
*.TEM
*.EXT
*.EXO
older-stores/
before_update.json

# listings, results, reports, drive tables
*_RESULT.OUT
*_ERROR.OUT
result.json
*_result.json
residuals.csv
*_residuals.csv
residuals.npz
*_residuals.npz
report.html
*_report.html
*calibration_certificate.html
*.DRV

# photo points by sub-blocks, which the workers of 'orip solve --dask' read
.orip-sub-blocks/

# features and matches of images, which 'orip match' finds again
.orip-matching/

# left by a run that was killed
*-journal
*-mj*
*-undo
*-pact
.orip-*.tmp
"""
"""Names by which git leaves files alone; none of them is that of a text that a user writes."""
