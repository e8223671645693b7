"""Files of GUBAIO, as a thesis prints them."""

from __future__ import annotations

from pathlib import Path

import pytest
from exchange.imported import read_well, written
from reference.published_data import REFERENCE_DATA

from orip.exchange.gubaio import is_gubaio, read_gubaio

THESIS = REFERENCE_DATA.parent / "seeds" / "004_33396dcb2c273ad8.txt"
DCS260 = {"gubaio.img": (2829, 3017), "gubaio.gcp": (3022, 3055), "gubaio.cam": (3060, 3071)}
ZURICH = {"gubaio.img": (3268, 3668), "gubaio.gcp": (3670, 3733), "gubaio.cam": (3735, 3746)}

IMG = """[IMAGE]
name = st1
sensor = dcs
InitialPersCenter = 0 0 .8
InitialRotation = 0 0 0
Points
 1  532.043478 185.565217
 7  100.5 200.5
PointsEnd
ImageEnd
"""
GCP = """FullControl
1 118.13 235.51 14.61
FullControlEnd
TiePoint
7 114 235 16
TiePointEnd
CheckPoint
102 118.13 235.49 10.37
 110 230 10
CheckPointEnd
"""
CAM = """[SENSOR]
name = dcs
type = DIGITAL
SensorElement = 5.0052 7.5078
SensorPixels = 1024 1536
CameraConstants = 0.03 0.2 8
RadialDistortion = 1e-4 0.0 0.0
END
"""


def folder_of(folder: Path, img: str = IMG, gcp: str = GCP, cam: str = CAM) -> Path:
    for name, content in {"gubaio.img": img, "gubaio.gcp": gcp, "gubaio.cam": cam}.items():
        written(folder / name, content)
    return folder


def printed(folder: Path, parts: dict[str, tuple[int, int]]) -> Path:
    """Write files as they are printed; lines of the page around them are left out."""
    if not THESIS.exists():
        pytest.skip("the thesis is not in ../shared/seeds beside the repository")
    lines = THESIS.read_text(encoding="utf-8").splitlines()
    for name, (first, last) in parts.items():
        kept = [line for line in lines[first:last] if not line.startswith(("```", "1."))]
        written(folder / name, "\n".join(kept) + "\n")
    return folder


def test_photos_points_and_cameras_are_read(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    assert is_gubaio(folder)
    project = read_well(read_gubaio, folder)
    assert project.rays.image.tolist() == [[532.043478, 185.565217], [100.5, 200.5]]
    assert [(point.name, point.kind) for point in project.control if point.errors[0]] == [("102", "check")]
    assert [point.name for point in project.control] == ["1", "102"]
    camera = project.cameras[0]
    assert (camera.columns, camera.rows, camera.sensor_mm) == (1536, 1024, (7.5078, 5.0052))
    # corrections are added to what is computed there, and taken from what is measured here
    assert camera.parameters["k1"] == -1e-4
    assert project.photos[0].rotation == ()


MARKS = {"1": (-106.0, 106.0), "2": (-106.0, -106.0), "3": (106.0, -106.0), "4": (106.0, 106.0)}
FILM = "[SENSOR]\nname = dcs\ntype = SCAN\n{marks}ScanResolution = 25\nCameraConstants = 0.014 0.022 303.1\nEND\n"


def film(folder: Path, kind: str = "SCAN", marks: dict[str, tuple[float, float]] = MARKS) -> Path:
    """Write a photo whose scan is turned, stretched and moved: column 4500 + 39 x + y, row 4600 + 0.5 x - 41 y."""
    listed = "".join(f"{name} {x} {y}\n" for name, (x, y) in marks.items())
    seen = "".join(f"{name} {4500 + 39 * x + y} {4600 + 0.5 * x - 41 * y}\n" for name, (x, y) in MARKS.items())
    img = IMG.replace("sensor = dcs\n", f"sensor = dcs\n{seen}").replace("532.043478 185.565217", "4890 4605")
    return folder_of(folder, img=img, cam=FILM.format(marks=listed).replace("SCAN", kind))


@pytest.mark.parametrize(("kind", "columns"), [("SCAN", 9280), ("FRAME", 46400)])
def test_points_on_film_are_millimetres_from_the_fiducial_centre(tmp_path: Path, kind: str, columns: int) -> None:
    """Column 4890 and row 4605 are 39 · 10 and 0.5 · 10 from the centre: x = 10, y = 0."""
    project = read_well(read_gubaio, film(tmp_path, kind))
    assert project.rays.image[0].tolist() == pytest.approx([10.0, 0.0], abs=1e-9)
    assert project.cameras[0].parameters["f"] == 303.1
    assert project.cameras[0].columns == columns  # 232 mm, for a point at x = -115.4
    assert "Fiducial marks of 1 photo fit by 0.0 µm (RMS)." in project.notes


def test_film_without_enough_fiducial_marks_is_refused_with_what_is_missing(tmp_path: Path) -> None:
    parsed = read_gubaio(film(tmp_path / "a", marks={"1": (-106.0, 106.0)}), "G")
    assert parsed.complaints[0].message.startswith("sensor dcs of type SCAN has 1 fiducial mark; 3 or more are needed")
    parsed = read_gubaio(
        folder_of(tmp_path / "b", cam=FILM.format(marks="".join(f"{n} 1 {n}\n" for n in range(3)))), "G"
    )
    assert parsed.complaints[0].message.startswith("photo st1 has 0 fiducial marks of its sensor before its points")
    turned = dict(zip(MARKS, [MARKS["2"], MARKS["1"], MARKS["3"], MARKS["4"]], strict=True))
    parsed = read_gubaio(film(tmp_path / "c", marks=turned), "G")
    assert "off the places that the sensor gives them" in parsed.complaints[0].message
    parsed = read_gubaio(folder_of(tmp_path / "d", cam=CAM.replace("DIGITAL", "LINE")), "G")
    assert "is of type 'LINE'; known are DIGITAL, SCAN and FRAME" in parsed.complaints[0].message


def test_the_malformed_numbers_of_the_thesis_are_refused(tmp_path: Path) -> None:
    parsed = read_gubaio(printed(tmp_path, DCS260), "G")
    assert len(parsed.complaints) == 2
    assert ["-.062.821" in parsed.complaints[0].message, "-.101.54" in parsed.complaints[1].message] == [True, True]


def test_the_first_example_of_the_thesis_is_read_once_they_are_mended(tmp_path: Path) -> None:
    folder = printed(tmp_path, DCS260)
    path = folder / "gubaio.gcp"
    written(path, path.read_text().replace("-.062.821", "-.062821").replace("-.101.54", "-.10154"))
    project = read_well(read_gubaio, folder)
    assert (len(project.photos), len(project.rays.photo), len(project.control)) == (5, 125, 25)


def test_the_second_example_of_the_thesis_is_read(tmp_path: Path) -> None:
    project = read_well(read_gubaio, printed(tmp_path, ZURICH))
    assert (len(project.photos), len(project.rays.photo)) == (15, 227)
    assert [point.kind for point in project.control if point.errors[0]] == ["check"] * 3
    assert len(project.control) == 21


@pytest.mark.parametrize(
    ("img", "said"),
    [
        (IMG.replace("ImageEnd\n", ""), "the last photo has no ImageEnd"),
        (IMG.replace("ImageEnd\n", "") + IMG, "a photo has 2 name and 2 sensor"),
        (IMG.replace("sensor = dcs\n", ""), "a photo has 0 sensor"),
        (IMG + IMG, "photo st1 is here again, after line 2"),
    ],
)
def test_photos_that_are_not_whole_or_there_twice_are_refused(tmp_path: Path, img: str, said: str) -> None:
    (fault,) = read_gubaio(folder_of(tmp_path, img), "G").complaints
    assert fault.message.startswith(said)
