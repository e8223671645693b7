"""Files of positions: what is read of each format, and what is said of faulty ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reference.published_data import REFERENCE_DATA

from orip.records.epochs import Epochs
from orip.stations.imported import read_epochs
from orip.stations.interpolation import without_contradicting_velocities

POS = (
    "% program   : RTKPOST\n"
    "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
    "%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)"
    "  sdeu(m)  sdun(m) age(s)  ratio\n"
    "2020/12/24 21:28:42.000   40.5 -105.25  1578.8456   1  11   0.03   0.02   0.05  -0.01   0.02  -0.03   0.00   0.0\n"
    "2020/12/24 21:28:42.200   40.5 -105.25  1578.8200   2  11   1.0348   1.0174   2.1384  -0.3149   0.7394  -0.8049"
    "   0.00    0.0\n"
)
MRK = (
    "1\t384139.972347\t[2315]\t    20,N\t   -10,E\t   120,V\t53.5,Lat\t9.25,Lon\t142.356,Ellh\t"
    "0.010000, 0.020000, 0.030000\t50,Q\n"
    "2\t384142.382410\t[2315]\t    21,N\t   -11,E\t   121,V\t53.5,Lat\t9.25,Lon\t142.211,Ellh\t"
    "0.5, 0.5, 1.0\t34,Q\n"
)


def read(folder: Path, name: str, text: str | bytes, **more: object) -> Epochs:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    parsed = read_epochs(path, name, **more)  # type: ignore[arg-type]
    assert parsed.complaints == ()
    return parsed.value


def complaints(folder: Path, name: str, text: str | bytes) -> list[str]:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return [str(complaint) for complaint in read_epochs(path, name).complaints]


def genuine(name: str) -> Path:
    path = REFERENCE_DATA / "exchange" / name
    if not path.exists():
        pytest.skip(f"the file {name} is not in ../shared/reference-data/exchange beside the repository")
    return path


# RTKLIB


def test_a_solution_of_rtklib(tmp_path: Path) -> None:
    found = read(tmp_path, "a.pos", POS)
    np.testing.assert_allclose(np.degrees(found.place[0, :2]), [-105.25, 40.5])
    assert found.place[0, 2] == 1578.8456
    assert found.quality == ("fixed", "float")
    assert found.line.tolist() == [4, 5]
    # week 2137, second 422922: as the head of a genuine file of that time says
    assert found.time[0] == 2137 * 604800 + 422922
    # east, north, up; sdne, sdeu, sdun are roots with a sign
    expected = [[0.0004, -0.0001, 0.0004], [-0.0001, 0.0009, -0.0009], [0.0004, -0.0009, 0.0025]]
    np.testing.assert_allclose(found.covariance[0], expected, atol=1e-12)


def test_weeks_utc_and_sexagesimal_degrees_mean_the_same(tmp_path: Path) -> None:
    head, first = POS.splitlines()[2:4]
    week = first.replace("2020/12/24 21:28:42.000", "2137 422922.000")
    utc = f"{head.replace('GPST', 'UTC')}\n{first.replace('21:28:42', '21:28:24')}\n"
    degrees = head.replace("latitude(deg) longitude(deg)", "latitude(d'\") longitude(d'\")")
    sexagesimal = first.replace("40.5 -105.25", "40 30 0.0 -105 15 0.0")
    expected = read(tmp_path, "a.pos", POS)
    for text in (f"{head}\n{week}\n", utc, f"{degrees}\n{sexagesimal}\n", f"{head}\n{first}\n".replace(" -", ",-")):
        found = read(tmp_path, "b.pos", text)
        assert found.time[0] == expected.time[0]
        np.testing.assert_allclose(found.place[0], expected.place[0], rtol=1e-14)


def test_heights_above_a_geoid_are_refused(tmp_path: Path) -> None:
    (said,) = complaints(tmp_path, "a.pos", POS.replace("WGS84/ellipsoidal", "WGS84/geodetic"))
    assert "heights are above a geoid that the file does not name" in said


def test_faults_of_a_solution_are_all_said_with_their_places(tmp_path: Path) -> None:
    text = POS.replace("40.5 -105.25  1578.8200", "140.5 -105.25 x") + "2020/13/24 21:28:43 1 2 3 1\n2020/12/24 1\n"
    said = complaints(tmp_path, "a.pos", text)
    assert [entry.split(": ")[0] for entry in said] == ["a.pos:5:27", "a.pos:5:41", "a.pos:6:1", "a.pos:7"]
    assert "'140.5' is not between -90 and 90" in said[0]
    assert "'2020/13/24 21:28:43' is not a time" in said[2]


@pytest.mark.parametrize(("name", "deviation"), [("demo5_b34f_f.pos", 1.4193), ("py_0315f.pos", 1.8441)])
def test_genuine_solutions(name: str, deviation: float) -> None:
    parsed = read_epochs(genuine(f"rtklib/{name}"), name)
    assert parsed.complaints == ()
    found = parsed.value
    assert len(found) == 4521
    assert found.time[0] == 2137 * 604800 + 422922
    assert found.quality[0] == "float"
    assert np.sqrt(found.covariance[0, 1, 1]) == pytest.approx(deviation)
    np.testing.assert_allclose(np.degrees(found.place[0, :2]), [-105.147248, 40.097025], atol=2e-6)
    assert (np.diff(found.time) > 0).all()


# DJI


def test_an_image_log(tmp_path: Path) -> None:
    found = read(tmp_path, "a.MRK", MRK)
    assert found.number.tolist() == [1, 2]
    np.testing.assert_allclose(found.time, 2315 * 604800 + np.array([384139.972347, 384142.382410]), rtol=1e-15)
    np.testing.assert_allclose(np.degrees(found.place[0, :2]), [9.25, 53.5])
    # V is counted downwards
    np.testing.assert_allclose(found.to_camera[0], [-0.010, 0.020, -0.120])
    np.testing.assert_allclose(np.diag(found.covariance[0]), [0.0004, 0.0001, 0.0009])
    assert found.quality == ("fixed", "float")


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("53.5,Lat", "53.5", "a.MRK:1", "LAT missing; a line of an image log (.MRK) is: number seconds [week]"),
        ("[2315]", "2315", "a.MRK:1:3", "is not a time; write seconds and [GPS week]"),
        ("53.5,Lat", "north,Lat", "a.MRK:1:51", "'north' is not a number"),
        ("53.5,Lat", "535,Lat", "a.MRK:1:51", "'535' is not between -90 and 90"),
    ],
)
def test_faulty_image_logs(tmp_path: Path, old: str, new: str, place: str, words: str) -> None:
    (said,) = complaints(tmp_path, "a.MRK", MRK.replace(old, new, 1))
    assert said.startswith(f"{place}: ")
    assert words in said


# SBET


def sbet(count: int = 3, wander: float = 0.1) -> np.ndarray:
    records = np.zeros((count, 17))
    records[:, 0] = 1000.0 + 0.005 * np.arange(count)
    records[:, 1:4] = 0.9, 0.2, 100.0
    records[:, 7:11] = 0.01, -0.02, 1.5, wander
    return records


def test_a_trajectory_with_its_deviations(tmp_path: Path) -> None:
    deviations = np.zeros((2, 10))
    deviations[:, 0] = 999.0, 1001.0
    deviations[:, 1:4] = 0.01, 0.02, 0.03
    deviations[:, 7:10] = 0.6, 0.6, 3.0
    (tmp_path / "a.smrmsg").write_bytes(deviations.astype("<f8").tobytes())
    found = read(tmp_path, "a.sbet", sbet().astype("<f8").tobytes(), deviations=tmp_path / "a.smrmsg")
    assert not found.has_week
    np.testing.assert_allclose(found.place, np.tile([0.2, 0.9, 100.0], (3, 1)))
    # true heading is platform heading less wander angle
    np.testing.assert_allclose(found.angles[0], [0.01, -0.02, 1.4])
    np.testing.assert_allclose(found.covariance[1], np.diag([0.0004, 0.0001, 0.0009]))
    np.testing.assert_allclose(found.angle_error[1], np.radians([0.01, 0.01, 0.05]))


def test_velocities_in_wander_axes_are_turned_to_east_and_north(tmp_path: Path) -> None:
    records = sbet(2, wander=np.radians(30.0))
    # 20 m/s to the north, then to the east: x is 30 degrees to the left of north, y to the left of x
    records[0, 4:7] = 20.0 * np.cos(np.radians(30.0)), -20.0 * np.sin(np.radians(30.0)), 0.5
    records[1, 4:7] = -20.0 * np.sin(np.radians(30.0)), -20.0 * np.cos(np.radians(30.0)), -0.5
    found = read(tmp_path, "a.sbet", records.astype("<f8").tobytes())
    np.testing.assert_allclose(found.velocity, [[0.0, 20.0, 0.5], [20.0, 0.0, -0.5]], atol=1e-12)


def test_damaged_trajectories(tmp_path: Path) -> None:
    whole = sbet().astype("<f8").tobytes()
    (cut,) = complaints(tmp_path, "a.sbet", whole[:-5])
    assert "has 403 bytes, but SBET has records of 136 bytes; it is cut off, or of another kind" in cut
    (swapped, *_) = complaints(tmp_path, "a.sbet", sbet().astype(">f8").tobytes())
    assert swapped.startswith("a.sbet:1: this record has numbers that cannot be a place, velocity and attitude")
    records = sbet()
    records[1, 2] = np.nan
    (bad,) = complaints(tmp_path, "a.sbet", records.astype("<f8").tobytes())
    assert bad.startswith("a.sbet:2: ")


def test_a_genuine_trajectory_moves_where_its_velocity_says() -> None:
    parsed = read_epochs(genuine("sbet/2-points.sbet"), "s")
    assert parsed.complaints == ()
    found = parsed.value
    assert found.time[0] == pytest.approx(151631.002836, abs=1e-6)
    assert found.place[0] == pytest.approx([-2.041654, 0.568021, 107.715], abs=5e-4)
    north, east = np.diff(found.place[:, 1])[0], np.diff(found.place[:, 0])[0] * np.cos(found.place[0, 1])
    course, by_velocity = np.arctan2(east, north), np.arctan2(*found.velocity.mean(axis=0)[:2])
    # two epochs 5 ms apart tell the course to half a degree; the other sign of the wander angle is 2.3 degrees off
    assert np.degrees(course - by_velocity) == pytest.approx(0.0, abs=0.5)
    height = np.diff(found.place[:, 2])[0] / np.diff(found.time)[0]
    assert height == pytest.approx(found.velocity[:, 2].mean(), abs=1e-3)
    assert without_contradicting_velocities(found) == (found, ())


def test_genuine_deviations(tmp_path: Path) -> None:
    records = sbet()
    records[:, 0] += 536258.0 - 1000.0
    (tmp_path / "a.sbet").write_bytes(records.astype("<f8").tobytes())
    parsed = read_epochs(tmp_path / "a.sbet", "s", deviations=genuine("sbet/smrmsg.smrmsg"))
    assert parsed.complaints == ()
    np.testing.assert_allclose(np.sqrt(np.diag(parsed.value.covariance[0])), [0.057791, 0.056279, 0.070774], atol=1e-6)
    assert np.degrees(parsed.value.angle_error[0, 2]) * 60 == pytest.approx(3.0108, abs=1e-4)


# tables


@pytest.mark.parametrize(
    "text",
    [
        "photo,X,Y,Z,sX,sY,sZ,omega,phi,kappa\nDJI_1.JPG,1,2,3,0.1,0.2,0.3,10,20,30\n",
        "# image; Easting [m];N [m];H (m); sde;sdn;sdu;om(deg);ph;ka\nimg/DJI_1.JPG; 1;2;3;0.1;0.2;0.3;10;20;30\n",
        "label x y altitude ax ay az om ph ka\nDJI_1 1 2 3 0.1 0.2 0.3 10 20 30\n",
        (
            "#Label,X/Easting,Y/Northing,Z/Altitude,Accuracy_X_(m),Accuracy_Y_(m),Accuracy_Z_(m),Omega,Phi,Kappa\n"
            "DJI_1,1,2,3,0.1,0.2,0.3,10,20,30\n"
        ),
        'Name\tE\tN\tH\tstd_x\tstd_y\tstd_z\tomega\tphi\tkappa\n"DJI_1.tif"\t1\t2\t3\t0.1\t0.2\t0.3\t10\t20\t30\n',
    ],
)
def test_headings_are_recognised(tmp_path: Path, text: str) -> None:
    found = read(tmp_path, "a.csv", text)
    assert found.photo == ("DJI_1",)
    assert not found.is_geographic
    np.testing.assert_allclose(found.place[0], [1, 2, 3])
    np.testing.assert_allclose(np.diag(found.covariance[0]), [0.01, 0.04, 0.09])
    assert found.mount == "photo"
    np.testing.assert_allclose(np.degrees(found.angles[0]), [10, 20, 30])


@pytest.mark.parametrize(
    "text",
    [
        "photo;X;Y;Z;sX [mm];sY [cm];sZ;omega (gon);phi (rad);kappa\nP1;1,5;2,5;3;10;2;0,03;100;1,5;9\n",
        "# by N\nphoto\tX\tY\tZ\tsX\tsY\tsZ\tomega\tphi\tkappa\n# 1\nP1\t1.5\t2.5\t3\t.01\t.02\t.03\t90\t85.94367\t9\n",
        'photo,note,X,Y,Z,sX,sY,sZ,omega,phi,kappa\nP1,"left, upper",1.5,2.5,3,.01,.02,.03,90,85.94366926962348,9\n',
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_tables_of_other_countries_and_systems_mean_the_same(
    tmp_path: Path, text: str, encoding: str, end: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text.replace("\n", end).encode(encoding))
    parsed = read_epochs(path, "a.csv")
    assert not parsed.complaints
    np.testing.assert_allclose(parsed.value.place, [[1.5, 2.5, 3.0]])
    np.testing.assert_allclose(np.sqrt(np.diag(parsed.value.covariance[0])), [0.01, 0.02, 0.03])
    np.testing.assert_allclose(np.degrees(parsed.value.angles), [[90.0, np.degrees(1.5), 9.0]])


def test_fields_that_are_empty_keep_their_place(tmp_path: Path) -> None:
    found = read(tmp_path, "a.csv", "photo,X,Y,Z,sX,sY,sZ,omega,phi,kappa\nP1,1,2,3,,-,,10,20,30\n")
    assert np.isnan(found.covariance).all(axis=0)[range(3), range(3)].all()
    np.testing.assert_allclose(np.degrees(found.angles[0]), [10, 20, 30])


def test_heights_above_an_ellipsoid_are_in_metres(tmp_path: Path) -> None:
    assert read(tmp_path, "a.csv", "photo,lon,lat,h (ft)\nP1,9,53,1000\n").place[0, 2] == pytest.approx(304.8)


@pytest.mark.parametrize("text", ["53°30'00\"N;8°15'00\"E", "53 30 00 N;E 8 15 00", "53,5;8,25", "N53:30;8.25°"])
def test_places_in_degrees_minutes_and_seconds(tmp_path: Path, text: str) -> None:
    found = read(tmp_path, "a.csv", f"photo;lat;lon;h\nP1;{text};10\n")
    np.testing.assert_allclose(np.degrees(found.place[0, :2]), [8.25, 53.5], rtol=1e-15)


def test_degrees_that_are_not_told_from_fields_are_refused(tmp_path: Path) -> None:
    (said,) = complaints(tmp_path, "a.txt", "photo lat lon h\nP1 53 30 00 N 8 15 00 E 10\n")
    assert said.endswith(
        "10 fields, and the heading has 4; separate fields that have blanks in them, such as 53 30 00 N, by semicolons"
    )
    (said,) = complaints(tmp_path, "a.csv", "photo,lat,lon,h\nP1,8°15'E,53.5,10\n")
    assert "are longitude and latitude exchanged?" in said


def test_lengths_are_in_the_unit_of_the_heading(tmp_path: Path) -> None:
    text = "photo,X (ftUS),Y (ftUS),Z (ftUS),sX (ftUS),sY (m),sZ\nP1,3937,7874,393.7,3.937,1.2,3.937\n"
    found = read(tmp_path, "a.csv", text, ground_unit="m")
    np.testing.assert_allclose(found.place[0], [1200.0, 2400.0, 120.0])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance[0])), [1.2, 1.2, 1.2])
    found = read(tmp_path, "a.csv", text, ground_unit="US survey foot")
    np.testing.assert_allclose(found.place[0], [3937.0, 7874.0, 393.7])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance[0])), [3.937, 3.937, 3.937])


def test_columns_that_are_named(tmp_path: Path) -> None:
    text = "Kuva,Ita,Pohjoinen,Korkeus\nP1,1,2,3\n"
    (said,) = complaints(tmp_path, "a.csv", text)
    assert "no column is known as photo or time; the headings are: Kuva, Ita, Pohjoinen, Korkeus" in said
    columns = {"photo": "Kuva", "X": "Ita", "Y": "Pohjoinen", "Z": "Korkeus"}
    assert read(tmp_path, "a.csv", text, columns=columns).place.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    "heading",
    ["Bild;Rechtswert;Hochwert;Höhe", "Nom;Est;Nord;Altitude", "Foto;Este;Norte;Altura (m)", "sep=;\nname;E;N;H"],
)
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_headings_of_other_languages_and_spreadsheets(tmp_path: Path, heading: str, encoding: str) -> None:
    found = read(tmp_path, "a.csv", f"{heading}\nP1;1,5;2,5;3\n".encode(encoding))
    assert found.photo == ("P1",)
    assert found.place.tolist() == [[1.5, 2.5, 3.0]]


def test_longitude_and_latitude_in_german(tmp_path: Path) -> None:
    found = read(tmp_path, "a.csv", "Bild,Breite,Länge,Höhe\nP1,53,10,3\n")
    assert found.is_geographic
    np.testing.assert_allclose(np.degrees(found.place[0, :2]), [10.0, 53.0])


def test_times_of_photos(tmp_path: Path) -> None:
    found = read(tmp_path, "a.csv", "photo,time\nP1,2020-12-24T21:28:42.5\nP2,2020/12/24 21:28:43\n")
    assert found.has_week
    np.testing.assert_allclose(found.time - 2137 * 604800, [422922.5, 422923.0])
    assert not read(tmp_path, "a.csv", "photo,time\nP1,422922.5\n").has_week


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("", "a.csv", "the table is empty"),
        ("PK\x03\x04", "a.csv", "this is no text, but a workbook (.xlsx, .ods)"),
        ("photo,X,Y\nP1,1,2\n", "a.csv:1", "no column is known as Z"),
        ("photo,X,Y,Z\nP1,1,2\n", "a.csv:2", "a field is missing, 3 found"),
        ("photo,X,Y,Z\nP1,561971,479,5934123,680,60,313\n", "a.csv:2", "with decimal commas the separator has to be"),
        ("photo,X,Y,Z\nP1,1,,3\n", "a.csv:2", "a coordinate is missing"),
        ("photo,lon,lat,h\nP1,1,b,3\n", "a.csv:2:6", "'b' is not a number"),
        ("photo,lon,lat,h\nP1,1,100,3\n", "a.csv:1", "a latitude is beyond 90 degrees"),
        ("P1,1,2,3\nP2,1,2,3\n", "a.csv:1", "the first line is no heading, but has numbers"),
        ('<?xml version="1.0"?><kml>\n</kml>\n', "a.csv:1", "this is XML or JSON; export it as a table with a heading"),
        ("<!DOCTYPE html>\n<p>Not found</p>", "a.csv", "this is no text, but a web page (HTML)"),
        ("photo,X,Y,Z,omega,phi,kappa\nP1,1,2,3,0,0,399.9\n", "a.csv:1", "angles are beyond 360 degrees"),
        ("photo,time\nP1,2020-02-30T00:00:00\n", "a.csv:2:4", "is not a time"),
    ],
)
def test_faulty_tables(tmp_path: Path, text: str, place: str, words: str) -> None:
    (said,) = complaints(tmp_path, "a.csv", text)
    assert said.startswith(f"{place}: ")
    assert words in said


# images


def test_a_genuine_photo() -> None:
    pytest.importorskip("exifread")
    parsed = read_epochs(genuine("exif/lund_01.jpg"), "lund")
    assert parsed.complaints == ()
    # 55° 41' 53.4" N, 13° 11' 43.4" E, 37 m, as exiftool shows
    np.testing.assert_allclose(np.degrees(parsed.value.place[0, :2]), [13.1953889, 55.6981667], atol=1e-7)
    assert parsed.value.place[0, 2] == 37.0
    assert parsed.value.photo == ("lund_01",)


def test_what_dji_writes_into_xmp(tmp_path: Path) -> None:
    pytest.importorskip("exifread")
    xmp = (
        '<x:xmpmeta><rdf:Description drone-dji:AbsoluteAltitude="+142.35" drone-dji:GpsLatitude="53.55" '
        'drone-dji:GpsLongitude="9.9" drone-dji:GimbalRollDegree="+0.00" drone-dji:GimbalYawDegree="-90.10" '
        'drone-dji:GimbalPitchDegree="-89.90" drone-dji:RtkFlag="50" drone-dji:RtkStdLon="0.01" '
        'drone-dji:RtkStdLat="0.02" drone-dji:RtkStdHgt="0.03"/></x:xmpmeta>'
    )
    found = read(tmp_path, "DJI_1.JPG", b"\xff\xd8\xff\xd9" + xmp.encode())
    np.testing.assert_allclose(np.degrees(found.angles[0]), [0, -89.9, -90.1])
    np.testing.assert_allclose(np.diag(found.covariance[0]), [0.0001, 0.0004, 0.0009])
    assert (found.quality, found.mount, found.place[0, 2]) == (("fixed",), "gimbal", 142.35)
