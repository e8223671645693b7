"""Folders of tables: observations, cameras, photos, control, points, stations."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, written

from orip.exchange.tables import READING, is_tables, read_tables
from orip.records.exchanged import ExchangedProject

CAMERAS = "camera,columns,rows,f,cx,cy\nK1,4000,3000,3000,2010,1490\n"


def tables_of(folder: Path, project: ExchangedProject, mark: str = ",", comma: str = ".") -> Path:
    """Write a block as tables."""

    def lines(heading: list[str], rows: list[list[object]]) -> str:
        text = [mark.join(heading)]
        text += [mark.join(str(v).replace(".", comma) if isinstance(v, float) else str(v) for v in row) for row in rows]
        return "\n".join(text) + "\n"

    written(folder / "cameras.csv", CAMERAS.replace(",", mark))
    photos = [[photo.name, "K1", *photo.position, *photo.rotation] for photo in project.photos]
    photos = [[v if isinstance(v, str) else float(v) for v in row] for row in photos]
    written(folder / "photos.csv", lines(["photo", "camera", "X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA"], photos))
    places = [[name, *xyz] for name, xyz in zip(project.points.names, project.points.coordinates.tolist(), strict=True)]
    written(folder / "points.csv", lines(["name", "X", "Y", "Z"], places))
    rays = [
        [project.photos[photo].name, project.points.names[point], *image]
        for photo, point, image in zip(project.rays.photo, project.rays.point, project.rays.image.tolist(), strict=True)
    ]
    written(folder / "observations.csv", lines(["photo", "point", "column", "row"], rows=rays))
    return folder


@pytest.mark.parametrize(("mark", "comma"), [(",", "."), (";", "."), (";", ","), ("\t", ","), (" ", ".")])
def test_tables_are_read_whatever_separates_their_fields(tmp_path: Path, mark: str, comma: str) -> None:
    given = block(READING)
    folder = tables_of(tmp_path, given, mark, comma)
    assert is_tables(folder)
    project = read_well(read_tables, folder)
    assert len(project.rays.photo) == len(given.rays.photo)
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert any("decimal commas" in note for note in project.notes) == (comma == ",")


def test_a_table_without_rows_is_said(tmp_path: Path) -> None:
    written(tables_of(tmp_path, block(READING)) / "control.csv", "point,X,Y,Z\n")
    assert "control.csv has a heading alone: nothing was read." in read_well(read_tables, tmp_path).notes


def test_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    tables_of(tmp_path, block(READING))
    written(tmp_path / "control.csv", "point,X,Y,Z\nA,1,5,2,5,3,5\n")
    (complaint,) = read_tables(tmp_path, "t").complaints
    assert "7 fields, and the heading has 4; with decimal commas the separator has to be a semicolon" in str(complaint)
    assert str(complaint).startswith("t/control.csv:2")


def test_angles_are_in_the_unit_of_their_heading(tmp_path: Path) -> None:
    folder = tables_of(tmp_path, block(READING))
    written(folder / "photos.csv", "photo,camera,X0,Y0,Z0,OMEGA [gon],PHI (rad),KAPPA\n0.jpg,K1,1,2,3,100,0.5,30\n")
    angles = read_well(read_tables, folder).photos[0].rotation
    assert angles == pytest.approx((90.0, math.degrees(0.5), 30.0))


def test_control_with_what_is_not_known_and_check_points(tmp_path: Path) -> None:
    tables_of(tmp_path, block(READING))
    written(
        tmp_path / "control.csv",
        'Label;Easting (m);Northing (m);Height;sX;sY;sZ;type;remark\n"A 1";1,5;2;3;0,01;0,01;0,02;control;x\n'
        "B;1;2;;0,01;0,01;;control;\nC;1;2;3;0,01;0,01;0,02;check;\n",
    )
    project = read_well(read_tables, tmp_path)
    full, plan, check = project.control
    assert (full.name, full.coordinates, full.errors) == ("A 1", (1.5, 2.0, 3.0), (0.01, 0.01, 0.02))
    assert (plan.coordinates, plan.errors) == ((1.0, 2.0, None), (0.01, 0.01, None))
    assert check.kind == "check"
    assert "control: 1 column not read: remark." in project.notes


def test_observations_in_millimetres(tmp_path: Path) -> None:
    tables_of(tmp_path, block(READING))
    written(tmp_path / "cameras.csv", "camera,columns,rows,f,cx,cy,width,height\nK1,4000,3000,3000,2010,1490,24,18\n")
    given = block(READING)
    millimetres = (given.rays.image - [2000.0, 1500.0]) * [0.006, -0.006]
    rows = [
        f"{given.photos[photo].name},{given.points.names[point]},{x!r},{y!r}\n"
        for photo, point, (x, y) in zip(given.rays.photo, given.rays.point, millimetres.tolist(), strict=True)
    ]
    written(tmp_path / "observations.csv", "photo,point,x (mm),y (mm)\n" + "".join(rows))
    found, _ = reprojected(read_well(read_tables, tmp_path))
    assert found.rms < 1e-6


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("cameras.csv", "camera,columns,rows\nK,1,2\n", "there is no column f; the columns are camera, columns, rows"),
        ("cameras.csv", "camera,columns,rows,f\nK,10,10,0\n", "all above 0"),
        ("photos.csv", "photo,camera\nP,other\n", "camera 'other' is not in cameras.csv"),
        ("observations.csv", "photo,point,column,row\n0.jpg,1,5,five\n", "row: 'five'"),
        ("observations.csv", "", "the table is empty"),
        ("control.csv", "point,X,Y,Z,kind\nA,1,2,3,check\n", "check point A needs sX, sY and sZ"),
        ("stations.csv", "photo,X,Y,Z,sX,sY,sZ\n0.jpg,1,2,3,,,\n", "a station needs X, Y, Z and sX, sY, sZ"),
    ],
)
def test_what_is_wrong_in_a_table_is_said_with_its_line(tmp_path: Path, name: str, text: str, message: str) -> None:
    tables_of(tmp_path, block(READING))
    written(tmp_path / name, text)
    complaints = [str(complaint) for complaint in read_tables(tmp_path, "t").complaints]
    assert any(message in complaint and complaint.startswith(f"t/{name}") for complaint in complaints), complaints


@pytest.mark.parametrize(
    ("heading", "metres"),
    [
        ("point,X,Y,Z", 1.0),
        ("point,X (ft),Y [ft],Z (feet)", 0.3048),
        ("point,X_ft,Y_ft,Z_ft", 0.3048),
        ("point,East (ftUS),North (US survey feet),Height ftUS", 1200.0 / 3937.0),
        ("point,X (mm),Y (mm),Z (mm)", 0.001),
        ("point,X (m),Y (m),Z (m)", 1.0),
    ],
)
def test_ground_coordinates_are_in_the_unit_of_their_heading(tmp_path: Path, heading: str, metres: float) -> None:
    tables_of(tmp_path, block(READING))
    written(tmp_path / "control.csv", f"{heading}\nA,1000,2000,300\n")
    project = read_well(read_tables, tmp_path)
    assert project.control[0].coordinates == pytest.approx((1000 * metres, 2000 * metres, 300 * metres), rel=1e-14)
    said = [note for note in project.notes if "to be in metres" in note]
    assert len(said) == (metres != 1.0)
    assert all(("international feet" in note) == (metres == 0.3048) for note in said)
