"""Reference tables of Metashape, read and written, and lenses as cameras of a project."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange import test_metashape
from exchange.imported import read_well, sample, written
from exchange.test_metashape import document
from pyproj import Transformer

from orip.exchange.conversion.ground import LocalGround, from_local_ground, in_local_ground
from orip.exchange.metashape.references import read_reference_table, require_letters, with_references
from orip.exchange.metashape.source import READING, read_metashape
from orip.exchange.metashape.writer import CAMERAS, MARKERS, write_metashape
from orip.exchange.sources.text import Faults
from orip.structs import replace

BERLIN = LocalGround(np.array([np.radians(13.4), np.radians(52.5), 80.0]))

TABLE = """# Cameras (3)
#Label,X/East,Y/North,Z/Altitude,Accuracy_X/Y_(m),Accuracy_Z_(m),Error_(m),X_error,Yaw,Pitch,Roll,Accuracy_(deg),X_est,Enable
0.jpg,1.5,2.5,100.5,0.02,0.05,9.9,9.9,10.0,1.0,-2.0,0.5,9.9,1
1.jpg,3.5,4.5,101.5,0.02,0.05,9.9,9.9,,,,,9.9,0
absent.jpg,3.5,4.5,101.5,0.02,0.05,9.9,9.9,,,,,9.9,0
# Markers (2)
#Label,X/East,Y/North,Z/Altitude,Accuracy_(m),Enable
M3,1,2,,0.25,1
"M4",4,5,6,0.5,0
#Label,Distance_(m),Accuracy_(m)
bar,5.0,0.01
# Total error
"""


def placed(folder: Path, table: str, name: str = "reference.csv") -> Path:
    """Write cameras and a table of references into a folder."""
    written(folder / "cameras.xml", document(block(READING)))
    written(folder / name, table)
    return folder


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_table_beside_the_document_counts_before_it(tmp_path: Path, separator: str) -> None:
    table = TABLE.replace(",", separator)
    if separator == ";":  # decimal commas, as German Windows has them
        table = "\n".join(line if line.startswith("#") else line.replace(".", ",") for line in table.split("\n"))
        table = table.replace(",jpg", ".jpg")
    project = read_well(read_metashape, placed(tmp_path, table))
    stations = {station.photo: station for station in project.stations}
    assert stations["0.jpg"].position == (1.5, 2.5, 100.5)
    assert stations["0.jpg"].position_error == (0.02, 0.02, 0.05)
    assert np.degrees(stations["0.jpg"].angles) == pytest.approx([-2.0, 1.0, 10.0])  # roll, pitch, heading
    assert np.degrees(stations["0.jpg"].angle_error) == pytest.approx([0.5, 0.5, 0.5])
    assert stations["1.jpg"].position_error == (-0.02, -0.02, -0.05)
    assert not stations["1.jpg"].has_angles
    assert stations["2.jpg"].position == (2.0, 2.0, 3.0)  # of the document
    assert project.station_reference.navigation
    control = {point.name: point for point in project.control}
    assert (control["M3"].coordinates, control["M3"].errors) == ((1.0, 2.0, None), (0.25, 0.25, None))
    assert control["M4"].errors == (-0.5, -0.5, -0.5)
    assert any("1 label of reference.csv left out" in note and "absent.jpg" in note for note in project.notes)


def test_angles_without_accuracies_are_compared_only(tmp_path: Path) -> None:
    project = read_well(read_metashape, placed(tmp_path, "#Label,X,Y,Z,Yaw,Pitch,Roll\n0.jpg,1,2,3,4,5,6\n"))
    station = next(one for one in project.stations if one.photo == "0.jpg")
    assert max(station.angle_error) < 0.0
    assert station.position_error == (0.5, 0.5, 0.5)  # those of the document


def test_columns_without_a_heading_have_letters(tmp_path: Path) -> None:
    folder = placed(tmp_path, "7 0.jpg 3 1 2\n8 1.jpg 6 4 5\n", "plain.asc")
    code = orip(folder, "import", "metashape", "cameras.xml", "new", "--reference", "plain.asc").code
    assert code != 0
    said = orip(folder, "import", "cameras.xml", "new", "--reference", "plain.asc", "--reference-columns", "_nzxy")
    assert said.code != 0
    assert "write a letter for each column" in said.err
    said = orip(folder, "import", "cameras.xml", "new", "--reference", "plain.asc", "--reference-columns", "unzxy")
    assert said.code == 0, said.err
    (stations,) = (folder / "new").glob("*.STA")
    rows = [line.split() for line in stations.read_text().splitlines()]
    assert ["0", "1.0000", "2.0000", "3.0000"] in [row[:4] for row in rows]
    assert require_letters("nxyzXYZabc") is None


def test_a_table_of_the_earth_goes_to_the_local_system_and_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(test_metashape, "SHIFT", BERLIN.origin)
    text = document(from_local_ground(block(READING), BERLIN))
    text = text.replace('<reference>LOCAL_CS["x"]</reference>', "<reference>EPSG:4979</reference>")
    text = text.replace('<reference x="', '<none x="')
    written(tmp_path / "cameras.xml", text)
    table = "#Label,X/Longitude,Y/Latitude,Z/Altitude,Accuracy_(m),Yaw,Pitch,Roll\n0.jpg,13.41,52.51,180,0.1,90,0,0\n"
    written(tmp_path / "a.csv", table + "M4,13.4,52.5,80.5,0.02,,,\n")
    project = read_well(read_metashape, tmp_path)
    local = in_local_ground(project, BERLIN)
    (station,) = [one for one in local.stations if one.photo == "0.jpg"]
    # pyproj's geod: 1298.7 m to the east-north-east; its horizon is turned there by that over the earth's radius
    assert np.hypot(*station.position[:2]) == pytest.approx(1303.5, abs=2.0)
    assert station.position[2] == pytest.approx(100.0 - 1303.5**2 / 2 / 6.38e6, abs=0.01)
    assert np.degrees(station.angles[2]) == pytest.approx(90.0, abs=0.02)
    assert np.degrees(station.angles[2]) != pytest.approx(90.0, abs=0.005)  # meridians converge
    (point,) = [one for one in local.control if one.name == "M4"]
    assert point.coordinates == pytest.approx((0.0, 0.0, 0.5), abs=1e-6)
    back = from_local_ground(local, BERLIN, project.control_crs)
    (again,) = [one for one in back.control if one.name == "M4"]
    assert again.coordinates == pytest.approx((13.4, 52.5, 80.5), abs=1e-9)
    assert back.stations[0].position == pytest.approx((13.41, 52.51, 180.0), abs=1e-8)
    assert back.mapped is not None
    assert back.mapped.photos[0][:2] == pytest.approx((13.4, 52.5), abs=0.01)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("Point,X\n1,2\n", "no line names the columns"),
        ("#Label,X,Y,Z\n0.jpg,1,2\n0.jpg,a,2,3\n", "'a' is not a number"),
        ("#Label,X,Y,Z\n0.jpg\n", "1 fields"),
        ("#Label,X,Y,Z,Accuracy_(m)\n0.jpg,1,2,3,-1\n", "below 0"),
        ('# CoordinateSystem: GEOGCS["WGS 84"]\n#Label,X,Y,Z\n0.jpg,1,2,3\n', "a system of the earth"),
        ("#Label,X,Y,Z\n,1,2,3\n", "no label"),
        ("#Label,X,Y,Z\n0.jpg,1,5,2,5,3,5\n", "7 fields, and the heading has 4; with decimal commas"),
    ],
)
def test_faults_of_a_table_name_their_line(tmp_path: Path, table: str, said: str) -> None:
    project = read_well(read_metashape, written(tmp_path / "a" / "cameras.xml", document(block(READING))))
    parsed = with_references(project, written(tmp_path / "table.csv", table), "table.csv")
    assert any(said in complaint.message for complaint in parsed.complaints), parsed.complaints


def test_a_table_without_rows_is_said(tmp_path: Path) -> None:
    project = read_well(read_metashape, written(tmp_path / "a" / "cameras.xml", document(block(READING))))
    parsed = with_references(project, written(tmp_path / "table.csv", "#Label,X,Y,Z\n"), "table.csv")
    assert parsed.value.notes[-1] == "table.csv has a heading alone: no reference was read."


def test_an_export_has_tables_of_what_was_given_and_found(tmp_path: Path) -> None:
    project = read_well(read_metashape, placed(tmp_path / "source", TABLE))
    covariance = np.broadcast_to(np.diag([1e-4, 4e-4, 9e-4]), (len(project.points.names), 3, 3))
    deviations = (0.1, 0.2, 0.3)
    result = replace(
        project,
        photos=tuple(replace(photo, position_deviation=deviations) for photo in project.photos),
        points=replace(project.points, covariance=covariance),
    )
    for name, data in write_metashape(result, None).items():
        written(tmp_path / "out" / name, data.decode())
    with (tmp_path / "out" / MARKERS).open() as stream:
        rows = {row["#Label"]: row for row in csv.DictReader(stream)}
    assert (rows["M3"]["X/East"], rows["M3"]["Z/Altitude"], rows["M3"]["Accuracy_X_(m)"]) == ("1.0", "", "0.25")
    assert (rows["M4"]["Enable"], rows["M3"]["Enable"]) == ("0", "1")
    assert [float(rows["M4"][f"SD_{axis}_(m)"]) for axis in "XYZ"] == pytest.approx([0.01, 0.02, 0.03])
    with (tmp_path / "out" / CAMERAS).open() as stream:
        rows = {row["#Label"]: row for row in csv.DictReader(stream)}
    assert float(rows["0.jpg"]["X_est"]) == project.photos[0].position[0]
    assert rows["0.jpg"]["SD_Z_(m)"] == "0.3"
    again = read_well(read_metashape, tmp_path / "out")
    (turned,) = [one for one in again.stations if one.has_angles]
    (given,) = [one for one in project.stations if one.has_angles]
    assert (turned.photo, turned.angles) == (given.photo, pytest.approx(given.angles))
    assert turned.angle_error == pytest.approx(given.angle_error)
    assert {one.photo: (one.position, one.position_error) for one in again.stations} == {
        one.photo: (one.position, one.position_error) for one in project.stations
    }
    known = {one.name: (one.coordinates, one.errors) for one in project.control if one.name != "M5"}  # not measured
    assert {one.name: (one.coordinates, one.errors) for one in again.control} == known


def test_a_lens_becomes_a_camera_of_a_project(tmp_path: Path) -> None:
    path = sample("metashape", "icepy4d", "35mm_280722_selfcal_all_metashape.xml")
    said = orip(tmp_path, "import", str(path), "new")
    assert said.code == 0, said.err
    definition = (tmp_path / "new" / "orip.toml").read_text()
    # f of 9263.45 px, 36 mm over 6012 columns
    assert f"c = {9263.4501761860829 * 36.0 / 6012}"[:18] in definition
    assert "[[photo]]" not in definition
    assert orip(tmp_path / "new", "init").code == 0


def test_a_heading_of_other_names_is_read(tmp_path: Path) -> None:
    table = "#Label,X/Easting,Y/Northing,Z/Altitude,Accuracy_X_(m),Accuracy_Y_(m),Accuracy_Z_(m)\nA 1,1,2,3,4,5,6\n"
    table = table.replace(",", "\t")
    faults = Faults("t")
    (found,) = read_reference_table(written(tmp_path / "t.txt", table), faults).references
    assert not faults.complaints
    assert (found.label, found.coordinates, found.accuracy) == ("A 1", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))


def test_a_lens_is_not_adjusted(tmp_path: Path) -> None:
    lens = "<calibration><projection>frame</projection><width>40</width><height>30</height><f>50</f></calibration>"
    written(tmp_path / "lens.xml", lens)
    said = orip(tmp_path, "adjust", "lens.xml", "new")
    assert said.code != 0
    assert "has no measurements, and nothing to adjust" in said.err
    assert not (tmp_path / "new").exists()


ANGLES = 'yaw="10" pitch="1" roll="-2" '


@pytest.mark.parametrize(
    ("further", "setting", "expected"),
    [
        ('rotation_enabled="true" ', 0.5, [0.5] * 3),
        ('rotation_enabled="false" ', 0.5, [-0.5] * 3),
        ("", 0.0, [-2.0] * 3),  # an older document, which does not use them; Metashape's own accuracy
        ('syaw="3" spitch="2" sroll="1" rotation_enabled="true" ', 0.5, [1.0, 2.0, 3.0]),
    ],
)
def test_angles_of_the_document_are_observed_where_it_uses_them(
    tmp_path: Path, further: str, setting: float, expected: list[float]
) -> None:
    text = document(block(READING)).replace('<reference x="0" ', f'<reference x="0" {ANGLES}{further}', 1)
    text = text.replace("<settings>", f'<settings><property name="accuracy_cameras_ypr" value="{setting}"/>')
    project = read_well(read_metashape, written(tmp_path / "cameras.xml", text))
    first, *others = project.stations
    assert np.degrees(first.angles) == pytest.approx([-2.0, 1.0, 10.0])  # roll, pitch, heading
    assert np.degrees(first.angle_error) == pytest.approx(expected)
    assert first.position_error[0] == -0.5  # its position is not enabled
    assert project.station_reference.navigation
    assert not any(station.has_angles for station in others)


def test_angles_of_a_drone_are_those_of_its_pose(tmp_path: Path) -> None:
    """The gimbal's heading against that of the adjusted pose, from the axes of the photo and the meridian."""
    text = sample("metashape", "geograypher", "camera.xml").read_text(encoding="utf-8")
    text = text.replace("</chunk>", "<reference>EPSG:4979</reference></chunk>")
    project = read_well(read_metashape, written(tmp_path / "cameras.xml", text))
    (photo,), (station,) = project.photos, project.stations
    to_geodetic = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    longitude, latitude = np.radians(to_geodetic.transform(*photo.position)[:2])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north = np.array([-np.sin(latitude) * np.cos(longitude), -np.sin(latitude) * np.sin(longitude), np.cos(latitude)])
    top = -np.array(photo.rotation).reshape(3, 3)[:, 1]
    heading = np.degrees(np.arctan2(top @ east, top @ north))
    assert np.degrees(station.angles[2]) == pytest.approx(heading, abs=3.0)
    assert max(station.angle_error) < 0.0  # the file does not use them
