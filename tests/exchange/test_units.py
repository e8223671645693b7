"""What has a unit in a file of another program comes into a project in orip's: a row for each element.

The files are those that the tests of the readers write: 4000 x 3000 pixels of 0.006 mm, principal distance 18 mm.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conversion.exchanged_blocks import OBLIQUE, block
from exchange import test_blocks_exchange, test_metashape, test_micmac, test_opensfm, test_tables
from exchange.imported import written
from exchange.test_aerial import bingo_files, patb_files
from exchange.test_gubaio import film
from exchange.test_metric import PIXEL_MM, aicon_files, ign_files, photomodeler_text, pix4d_files
from exchange.test_scenes import alicevision_text, openmvg_text
from exchange.vision import test_opf

from orip.exchange import aicon, bingo, ign, patb, photomodeler, pix4d
from orip.exchange.formats import FORMATS_READ
from orip.exchange.project.block import ExchangeSettings
from orip.exchange.project.imported import ImportedProject, read_source
from orip.exchange.tables import READING as TABLES
from orip.exchange.vision import openmvg
from orip.geometry.rotation import rotation_from_angles

Files = Callable[[Path], Path]
Value = Callable[[ImportedProject], float]


def text_file(name: str, text: Callable[[], str]) -> Files:
    return lambda folder: written(folder / name, text())


def opensfm(folder: Path) -> Path:
    test_opensfm.project_folder(folder)
    written(folder / "geo.txt", "EPSG:25833\n0.jpg 500000 5800000 30 nan nan nan 0.02 0.05\n")
    written(folder / "gcp_list.txt", "EPSG:25833\n500000 5800000 30 99.5 199.5 0.jpg A\n")
    return folder


def tables(folder: Path) -> Path:
    test_tables.tables_of(folder, block(TABLES))
    written(folder / "cameras.csv", "camera,columns,rows,f,cx,cy,width,height\nK1,4000,3000,3000,2010,1490,24,18\n")
    rows = ["photo,point,x_mm,y_mm,s"]
    project = block(TABLES)
    for photo, point, (column, row) in zip(
        project.rays.photo, project.rays.point, project.rays.image.tolist(), strict=True
    ):
        rows.append(f"{photo}.jpg,{point},{(column - 2000) * PIXEL_MM},{(1500 - row) * PIXEL_MM},0.003")
    written(folder / "observations.csv", "\n".join(rows) + "\n")
    written(folder / "control.csv", "point,X,Y,Z,sX,sY,sZ\nA,1,2,3,0.01,0.02,0.03\n")
    return folder


def micmac(folder: Path) -> Path:
    return test_micmac.project_folder(folder) / "Ori-A"


def ray(imported: ImportedProject) -> float:
    """Return the a-priori error of the first measurement, pixels."""
    return float(imported.block.deviations[0])


def column(imported: ImportedProject) -> float:
    return float(imported.block.pixels[0, 0])


def turned(imported: ImportedProject) -> float:
    """Return how far photo 1 is turned against photo 0 from what the block says; the block may stand elsewhere."""
    given = rotation_from_angles(OBLIQUE[:2])
    photos = imported.block.photos
    first, second = (next(n for n, name in enumerate(photos) if name.endswith(end)) for end in "01")
    found = imported.block.found.rotations
    return float(np.abs(found[first].T @ found[second] - given[0].T @ given[1]).max())


def principal_distance(imported: ImportedProject) -> float:
    """Return that of orip's camera, pixels."""
    camera = imported.block.cameras[0].camera
    assert camera.sensor is not None
    return camera.parameters[0] / camera.sensor.width * camera.sensor.columns


def control(name: str, axis: int) -> Value:
    return lambda imported: next(
        point.errors[axis] or 0.0 for point in imported.block.project.control if point.name == name
    )


def station(axis: int) -> Value:
    return lambda imported: imported.block.project.stations[0].position_error[axis]


def length(imported: ImportedProject) -> float:
    return imported.block.project.distances[0].error or 0.0


def precision(imported: ImportedProject) -> float:
    return float(imported.block.project.precision or 0.0)


class Row(NamedTuple):
    """An element of a format with its unit there, and what it is in orip."""

    format: str
    element: str
    unit: str
    files: Files
    value: Value
    expected: float


AICON: Files = lambda folder: aicon_files(folder, block(aicon.READING))  # noqa: E731
BINGO: Files = lambda folder: bingo_files(folder, block(bingo.READING))  # noqa: E731
PATB: Files = lambda folder: patb_files(folder, block(patb.READINGS[0]))  # noqa: E731
PATB_MM: Files = lambda folder: patb_files(folder, block(patb.READINGS[0]), unit=1.0)  # noqa: E731
PIX4D: Files = lambda folder: pix4d_files(folder / "1_initial" / "params", block(pix4d.READING))  # noqa: E731
IGN: Files = lambda folder: ign_files(folder, block(ign.READING))  # noqa: E731
BLOCKS = text_file("b.xml", lambda: test_blocks_exchange.text(block(test_blocks_exchange.MATRIX_DOWN)))
BLOCKS_ANGLES = text_file("b.xml", lambda: test_blocks_exchange.text(block(test_blocks_exchange.ANGLES_DOWN)))
METASHAPE = text_file("cameras.xml", lambda: test_metashape.document(block(test_metashape.READING)))
OPENMVG = text_file("sfm_data.json", lambda: openmvg_text(block(openmvg.READING)))
ALICEVISION = text_file("cameras.sfm", lambda: alicevision_text(block(openmvg.READING)))
OPF: Files = test_opf.project_folder
OPF_FIRST = float(test_opf.first_mark()[0])
PHOTOMODELER = text_file("a.txt", lambda: photomodeler_text(block(photomodeler.READING)))

FIRST = float(block(aicon.READING).rays.image[0, 0])
"""Column of the first measurement, pixels from the outer corner."""

TABLE = [
    Row("aicon", ".phc sx sy", "mm", AICON, ray, 0.0005 / PIXEL_MM),
    Row("aicon", ".phc x", "mm", AICON, column, FIRST),
    Row("aicon", ".eor angles", "rad", AICON, turned, 0.0),
    Row("aicon", ".scale sigma", "mm, ground unit mm", AICON, length, 0.02),
    Row("bingo", "CONT deviations", "m", BINGO, control("2", 1), 0.2),
    Row("bingo", "ORIA angles", "gon", BINGO, turned, 0.0),
    Row("patb", ".ori matrix", "1", PATB, turned, 0.0),
    Row("patb", ".im x in micrometres", "µm", PATB, principal_distance, 18.0 / 0.01),
    Row("patb", ".im x in millimetres", "mm", PATB_MM, principal_distance, 18.0 / 0.01),
    Row("pix4d", "R", "1", PIX4D, turned, 0.0),
    Row("ign", ".OPK angles", "degree", IGN, turned, 0.0),
    Row("ign", ".mes column", "px", IGN, column, FIRST),
    Row("blocks", "HorizontalAccuracy", "m", BLOCKS, control("G1", 0), -0.01),
    Row("blocks", "VerticalAccuracy", "m", BLOCKS, control("G1", 2), -0.02),
    Row("blocks", "FocalLength, SensorSize", "mm", BLOCKS, principal_distance, 3000.0),
    Row("blocks", "Omega Phi Kappa", "degree", BLOCKS_ANGLES, turned, 0.0),
    Row("metashape", "accuracy_tiepoints", "px", METASHAPE, precision, 0.7),
    Row("metashape", "accuracy_projections", "px", METASHAPE, ray, 0.3),
    Row("metashape", "marker sxy", "m", METASHAPE, control("M3", 0), 0.01),
    Row("metashape", "marker sz", "m", METASHAPE, control("M3", 2), 0.02),
    Row("metashape", "camera sxyz, not enabled", "m", METASHAPE, station(0), -0.5),
    Row("metashape", "scale bar accuracy", "m", METASHAPE, length, 0.01),
    Row("photomodeler", "marks sx sy", "px", PHOTOMODELER, ray, 0.2),
    Row("photomodeler", "control sX", "ground unit", PHOTOMODELER, control("7", 2), 0.3),
    Row("photomodeler", "kappa phi omega", "degree", PHOTOMODELER, turned, 0.0),
    Row("micmac", "Incertitude", "m", micmac, control("G1", 0), 2.0),
    Row("micmac", "CodageMatr", "1", micmac, turned, 0.0),
    Row("opensfm", "geo.txt horizontal accuracy", "m", opensfm, station(0), 0.02),
    Row("opensfm", "geo.txt vertical accuracy", "m", opensfm, station(2), 0.05),
    Row("opensfm", "rotation", "rad", opensfm, turned, 0.0),
    Row("openmvg", "focal_length", "px", OPENMVG, principal_distance, 3000.0),
    Row("openmvg", "x", "px from the centre of the first pixel", OPENMVG, column, FIRST),
    Row("openmvg", "rotation", "1", OPENMVG, turned, 0.0),
    Row("alicevision", "focalLength, sensorWidth", "mm", ALICEVISION, principal_distance, 3000.0),
    Row("alicevision", "x", "px from the centre of the first pixel", ALICEVISION, column, FIRST),
    Row("alicevision", "rotation", "1", ALICEVISION, turned, 0.0),
    Row("opf", "focal_length_px", "px", OPF, principal_distance, 3000.0),
    Row("opf", "position_px", "px", OPF, column, OPF_FIRST),
    Row("opf", "accuracy", "px", OPF, ray, 0.5),
    Row("opf", "sigmas of a control point", "ground unit", OPF, control("P0", 2), 0.05),
    Row("opf", "sigmas of a position", "ground unit", OPF, station(1), 0.03),
    Row("csv", "s beside x_mm", "mm", tables, ray, 0.003 / PIXEL_MM),
    Row("csv", "control sY", "m", tables, control("A", 1), 0.02),
    Row("csv", "OMEGA PHI KAPPA", "degree", tables, turned, 0.0),
    Row("gubaio", "ScanResolution", "µm", film, principal_distance, 303.1 / 0.025),
]

ELSEWHERE = {"colmap", "bundler", "bal", "nvm", "lens"}
"""Formats of pixels and matrices alone, without a-priori errors."""


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row.format} {row.element}")
def test_a_unit_of_a_file_is_one_of_orip(tmp_path: Path, row: Row) -> None:
    imported = read_source(row.format, row.files(tmp_path / "source"), ExchangeSettings())
    assert row.value(imported) == pytest.approx(row.expected, rel=1e-9, abs=1e-8)


def test_every_format_that_is_read_has_its_units_checked() -> None:
    assert {row.format for row in TABLE} | ELSEWHERE == {found.name for found in FORMATS_READ}
