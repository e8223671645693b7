"""The formats of other programs, a line each, and which of them a file or folder probably has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orip.errors import UsageError
from orip.exchange.aicon import is_aicon, read_aicon
from orip.exchange.bingo import AXES as BINGO_AXES
from orip.exchange.bingo import BINGO_TERMS, is_bingo, read_bingo, write_bingo
from orip.exchange.bingo import READING as BINGO
from orip.exchange.blocks_exchange import AXES as BLOCKS_AXES
from orip.exchange.blocks_exchange import READING as BLOCKS
from orip.exchange.blocks_exchange import is_blocks_exchange, read_blocks_exchange, write_blocks_exchange
from orip.exchange.colmap.reader import READING as COLMAP
from orip.exchange.colmap.reader import is_model, read_model
from orip.exchange.colmap.writer import COLMAP_FISHEYE_TERMS, write_model
from orip.exchange.format import Conventions, Format, Given
from orip.exchange.gis import READING as DRAWN
from orip.exchange.gis import write_dxf, write_geojson, write_geopackage, write_tables
from orip.exchange.gubaio import is_gubaio, read_gubaio
from orip.exchange.ign import is_ign, read_ign
from orip.exchange.metashape.references import with_references
from orip.exchange.metashape.sensors import is_lens, read_lens
from orip.exchange.metashape.source import READING as METASHAPE
from orip.exchange.metashape.source import is_metashape, read_metashape
from orip.exchange.metashape.writer import is_copied, require_labels, write_metashape
from orip.exchange.micmac.source import READING as MICMAC
from orip.exchange.micmac.source import is_micmac, read_micmac
from orip.exchange.micmac.writer import is_copied_folder, write_micmac
from orip.exchange.opensfm.reconstruction import READING as OPENSFM
from orip.exchange.opensfm.source import is_opensfm, read_opensfm
from orip.exchange.opensfm.writer import (
    OPENSFM_FISHEYE_TERMS,
    OPENSFM_TERMS,
    is_copied_reconstruction,
    write_opensfm,
)
from orip.exchange.patb import AXES as PATB_AXES
from orip.exchange.patb import PATB_TERMS, is_patb, read_patb, write_patb
from orip.exchange.patb import READINGS as PATB
from orip.exchange.photomodeler import is_photomodeler, read_photomodeler
from orip.exchange.pix4d import is_pix4d, read_pix4d
from orip.exchange.tables import is_tables, read_tables
from orip.exchange.vision.alicevision import (
    ALICEVISION_FISHEYE_TERMS,
    ALICEVISION_TERMS,
    is_alicevision,
    read_alicevision,
    write_alicevision,
)
from orip.exchange.vision.alicevision import READING as ALICEVISION
from orip.exchange.vision.bundler import AXES as BUNDLER_AXES
from orip.exchange.vision.bundler import (
    BAL,
    BUNDLER,
    BUNDLER_TERMS,
    is_bal,
    is_bundler,
    read_bal,
    read_bundler,
    write_bal,
    write_bundler,
)
from orip.exchange.vision.nvm import CENTRE as NVM_AXES
from orip.exchange.vision.nvm import NVM_TERMS, is_nvm, read_nvm, write_nvm
from orip.exchange.vision.nvm import READING as NVM
from orip.exchange.vision.openmvg import AXES as OPENMVG_AXES
from orip.exchange.vision.openmvg import (
    OPENMVG_FISHEYE_TERMS,
    OPENMVG_TERMS,
    is_openmvg,
    read_openmvg,
    write_openmvg,
)
from orip.exchange.vision.openmvg import READING as OPENMVG
from orip.exchange.vision.opf import is_opf, read_opf
from orip.workflow.project.folder import PROJECT_FILE


def _never(_original: Path) -> bool:
    """Return that a format is always written as a new project."""
    return False


_OBSERVED: tuple[Given, ...] = ("stations", "distances")
_WITHOUT_GROUND: tuple[Given, ...] = ("control points", "check points", *_OBSERVED)

FORMATS: tuple[Format, ...] = (
    Format(
        "colmap",
        "COLMAP: folder of a sparse model, text or binary",
        read_model,
        is_model,
        write_model,
        Conventions(
            "opencv",
            COLMAP,
            fisheye_lens="equidistant",
            fisheye_terms=COLMAP_FISHEYE_TERMS,
            has_rigs=True,
            lacks=_WITHOUT_GROUND,
        ),
    ),
    Format(
        "opensfm",
        "OpenSfM, OpenDroneMap: project folder, reconstruction.json, or shots.geojson (orientations only)",
        read_opensfm,
        is_opensfm,
        write_opensfm,
        Conventions(
            "opencv",
            OPENSFM,
            fisheye_lens="equidistant",
            terms=OPENSFM_TERMS,
            fisheye_terms=OPENSFM_FISHEYE_TERMS,
            is_copied=is_copied_reconstruction,
            has_rigs=True,
            lacks=_WITHOUT_GROUND,
        ),
    ),
    Format(
        "metashape",
        "Agisoft Metashape: project (.psx, .psz), or cameras XML with markers and reference tables (CSV) beside it",
        read_metashape,
        is_metashape,
        write_metashape,
        Conventions(
            "agisoft",
            METASHAPE,
            fisheye_lens="agisoft_fisheye",
            is_copied=is_copied,
            has_terms_of_original=True,
            has_rigs=True,
            lacks=("distances", "tie points"),
        ),
        add_references=with_references,
        require_way_back=require_labels,
    ),
    Format("lens", "Agisoft camera calibration (XML): a camera without photos", read_lens, is_lens),
    Format(
        "blocks",
        "Blocks Exchange XML: ContextCapture, iTwin Capture",
        read_blocks_exchange,
        is_blocks_exchange,
        write_blocks_exchange,
        Conventions("agisoft", BLOCKS, BLOCKS_AXES, BLOCKS_AXES, is_cartesian=False, is_copied=_never, lacks=_OBSERVED),
        is_file=True,
    ),
    Format(
        "micmac",
        "MicMac, MMVII: folder Ori-NAME or Ori/NAME, or the project's folder",
        read_micmac,
        is_micmac,
        write_micmac,
        Conventions("fraser", MICMAC, is_copied=is_copied_folder, lacks=(*_WITHOUT_GROUND, "measurements")),
    ),
    Format(
        "bundler",
        "Bundler: bundle.out, with list.txt beside it",
        read_bundler,
        is_bundler,
        write_bundler,
        Conventions(
            "agisoft",
            BUNDLER,
            BUNDLER_AXES,
            BUNDLER_AXES,
            terms=BUNDLER_TERMS,
            counts_from_principal_point=True,
            is_copied=_never,
            lacks=_WITHOUT_GROUND,
        ),
    ),
    Format(
        "bal",
        "Bundle Adjustment in the Large: problem file",
        read_bal,
        is_bal,
        write_bal,
        Conventions(
            "agisoft",
            BAL,
            BUNDLER_AXES,
            BUNDLER_AXES,
            terms=BUNDLER_TERMS,
            counts_from_principal_point=True,
            lacks=_WITHOUT_GROUND,
        ),
        is_file=True,
    ),
    Format(
        "nvm",
        "VisualSFM: .nvm",
        read_nvm,
        is_nvm,
        write_nvm,
        Conventions(
            "measured",
            NVM,
            NVM_AXES,
            NVM_AXES,
            terms=NVM_TERMS,
            counts_from_principal_point=True,
            is_copied=_never,
            lacks=_WITHOUT_GROUND,
        ),
        is_file=True,
    ),
    Format(
        "openmvg",
        "openMVG: sfm_data.json",
        read_openmvg,
        is_openmvg,
        write_openmvg,
        Conventions(
            "agisoft",
            OPENMVG,
            OPENMVG_AXES,
            OPENMVG_AXES,
            fisheye_lens="agisoft_fisheye",
            terms=OPENMVG_TERMS,
            fisheye_terms=OPENMVG_FISHEYE_TERMS,
            is_copied=_never,
            lacks=_WITHOUT_GROUND,
        ),
        is_file=True,
    ),
    Format(
        "alicevision",
        "AliceVision, Meshroom: scene as JSON (.sfm)",
        read_alicevision,
        is_alicevision,
        write_alicevision,
        Conventions(
            "opencv",
            ALICEVISION,
            OPENMVG_AXES,
            OPENMVG_AXES,
            fisheye_lens="equidistant",
            terms=ALICEVISION_TERMS,
            fisheye_terms=ALICEVISION_FISHEYE_TERMS,
            is_copied=_never,
            lacks=_WITHOUT_GROUND,
        ),
        is_file=True,
    ),
    Format("photomodeler", "PhotoModeler: text export", read_photomodeler, is_photomodeler),
    Format("aicon", "AICON 3D Studio: folder with .ior, .eor, .obc, .phc", read_aicon, is_aicon),
    Format(
        "bingo",
        "BINGO: folder with image.dat, geoin.dat, itera.dat",
        read_bingo,
        is_bingo,
        write_bingo,
        Conventions(
            "isp",
            BINGO,
            BINGO_AXES,
            BINGO_AXES,
            is_cartesian=False,
            terms=BINGO_TERMS,
            is_copied=_never,
            lacks=_OBSERVED,
        ),
    ),
    Format(
        "patb",
        "PAT-B: folder with .ori, .im, .con, and camera.txt",
        read_patb,
        is_patb,
        write_patb,
        Conventions(
            "isp",
            PATB[0],
            PATB_AXES,
            PATB_AXES,
            is_cartesian=False,
            terms=PATB_TERMS,
            is_copied=_never,
            counts_from_principal_point=True,
            lacks=("check points", *_OBSERVED),
        ),
    ),
    Format("opf", "OPF (Open Photogrammetry Format), Pix4D: project.opf or its folder", read_opf, is_opf),
    Format("pix4d", "Pix4D: folder 1_initial/params (orientations only)", read_pix4d, is_pix4d),
    Format("gubaio", "GUBAIO: folder with gubaio.img, gubaio.gcp, gubaio.cam", read_gubaio, is_gubaio),
    Format("ign", "IGN: folder with .OPK, camera text, .mes, .app", read_ign, is_ign),
    Format(
        "geopackage",
        "GeoPackage for GIS: points, photos, footprints, error ellipses, residual vectors, rays",
        write=write_geopackage,
        conventions=Conventions(None, DRAWN, is_cartesian=False, is_drawn=True),
        is_file=True,
    ),
    Format(
        "dxf",
        "DXF (release 12) for CAD: points, photos, footprints, error ellipses, residual vectors, rays",
        write=write_dxf,
        conventions=Conventions(None, DRAWN, is_cartesian=False, is_drawn=True),
        is_file=True,
    ),
    Format(
        "geojson",
        "GeoJSON for maps: the same in longitude and latitude, where the project has a crs",
        write=write_geojson,
        conventions=Conventions(None, DRAWN, is_cartesian=False, is_drawn=True),
        is_file=True,
    ),
    Format(
        "csv",
        "CSV: tables of observations, cameras and more are read; adjusted points and photos are written",
        read_tables,
        is_tables,
        write=write_tables,
        conventions=Conventions(None, DRAWN, is_cartesian=False, is_copied=_never),
    ),
)


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
    names = ", ".join(one.name for one, _ in found) or ", ".join(one.name for one in FORMATS_READ)
    what = "may be of several formats" if found else "looks like none of the formats"
    photos = "; a folder of photographs is for 'orip photos'" if path.is_dir() and not found else ""
    message = f"{path} {what}; name the format before it: FORMAT {path}, with one of {names}{photos}"
    raise UsageError(message)


def files_of_formats(folder: Path, known: Sequence[Format]) -> list[tuple[Format, Path]]:
    """Return the files of a folder that look like one of some formats, of the first hundred of any kind."""
    files = sorted(path for path in folder.iterdir() if path.is_file())[:_MOST_FILES]
    return [(one, file) for file in files for one in known if one.recognises(file)]
