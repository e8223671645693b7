"""The formats of other programs, a line each, and which of them a file or folder probably has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orip.errors import UsageError
from orip.exchange.aicon import AICON_FORMAT
from orip.exchange.bingo import BINGO_FORMAT
from orip.exchange.blocks_exchange import BLOCKS_FORMAT
from orip.exchange.colmap.writer import COLMAP_FORMAT
from orip.exchange.format import Format
from orip.exchange.gis import DXF_FORMAT, GEOJSON_FORMAT, GEOPACKAGE_FORMAT
from orip.exchange.gubaio import GUBAIO_FORMAT
from orip.exchange.ign import IGN_FORMAT
from orip.exchange.metashape.sensors import LENS_FORMAT
from orip.exchange.metashape.writer import METASHAPE_FORMAT
from orip.exchange.micmac.writer import MICMAC_FORMAT
from orip.exchange.opensfm.writer import OPENSFM_FORMAT
from orip.exchange.patb import PATB_FORMAT
from orip.exchange.photomodeler import PHOTOMODELER_FORMAT
from orip.exchange.pix4d import PIX4D_FORMAT
from orip.exchange.tables import CSV_FORMAT
from orip.exchange.vision.alicevision import ALICEVISION_FORMAT
from orip.exchange.vision.bundler import BAL_FORMAT, BUNDLER_FORMAT
from orip.exchange.vision.nvm import NVM_FORMAT
from orip.exchange.vision.openmvg import OPENMVG_FORMAT
from orip.exchange.vision.opf import OPF_FORMAT
from orip.workflow.project.folder import PROJECT_FILE

FORMATS: tuple[Format, ...] = (
    COLMAP_FORMAT,
    OPENSFM_FORMAT,
    METASHAPE_FORMAT,
    LENS_FORMAT,
    BLOCKS_FORMAT,
    MICMAC_FORMAT,
    BUNDLER_FORMAT,
    BAL_FORMAT,
    NVM_FORMAT,
    OPENMVG_FORMAT,
    ALICEVISION_FORMAT,
    PHOTOMODELER_FORMAT,
    AICON_FORMAT,
    BINGO_FORMAT,
    PATB_FORMAT,
    OPF_FORMAT,
    PIX4D_FORMAT,
    GUBAIO_FORMAT,
    IGN_FORMAT,
    GEOPACKAGE_FORMAT,
    DXF_FORMAT,
    GEOJSON_FORMAT,
    CSV_FORMAT,
)

_ARCHIVES = frozenset({".zip", ".7z", ".rar", ".tar", ".gz", ".tgz", ".bz2", ".xz"})

_MOST_FILES = 100
"""Of a folder, that are looked at."""

FORMATS_READ = tuple(one for one in FORMATS if one.read is not None)
FORMATS_WRITTEN = tuple(one for one in FORMATS if one.write is not None)


def format_named(name: str, known: Sequence[Format] = FORMATS) -> Format:
    """Return the format of a name; case does not count.

    Parameters
    ----------
    known : sequence of Format
        Those that are named where there is none of that name.

    Raises
    ------
    UsageError
        If there is none.
    """
    for found in FORMATS:
        if found.name == name.lower():
            return found
    message = f"there is no format '{name}'; known are: {', '.join(one.name for one in known)}"
    raise UsageError(message)


def guessed_source(path: Path) -> tuple[Format, Path]:
    """Return the format that a file or folder probably has, and what is to be read.

    That is the only file that is of a format where the folder itself, by the names of its files, is of none.

    Raises
    ------
    UsageError
        If it looks like none, or like several.
    """
    if not path.exists():
        message = f"there is no '{path}', nor a format '{path.name}'; name the file or folder of the other program"
        raise UsageError(message)
    if (path / PROJECT_FILE).is_file():
        message = f"{path} is a project of orip, not of another program: adjust it with 'orip -C {path} run'"
        raise UsageError(message)
    found = [(one, path) for one in FORMATS_READ if one.recognises(path)]
    if not found and path.is_dir():
        found = files_of_formats(path, FORMATS_READ)
    if len(found) == 1:
        return found[0]
    if found and found[0][1] != path:
        files = ", ".join(f"{file.name} ({form.name})" for form, file in found)
        message = f"{path} has several files of other programs: {files}; name one of them"
        raise UsageError(message)
    if path.suffix.lower() in _ARCHIVES:
        message = f"{path} is an archive; unpack it, and name the folder or file that was in it"
        raise UsageError(message)
    names = ", ".join(one.name for one, _ in found) or ", ".join(one.name for one in FORMATS_READ)
    what = "may be of several formats" if found else "looks like none of the formats"
    photos = "; a folder of photographs is for 'orip photos'" if path.is_dir() and not found else ""
    message = f"{path} {what}; name the format before it: FORMAT {path}, with one of {names}{photos}"
    raise UsageError(message)


def files_of_formats(folder: Path, known: Sequence[Format]) -> list[tuple[Format, Path]]:
    """Return the files of a folder that look like one of some formats, of the first hundred of any kind."""
    files = sorted(path for path in folder.iterdir() if path.is_file())[:_MOST_FILES]
    return [(one, file) for file in files for one in known if one.recognises(file)]
