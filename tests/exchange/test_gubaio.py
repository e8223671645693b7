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


def test_a_film_camera_is_refused(tmp_path: Path) -> None:
    parsed = read_gubaio(folder_of(tmp_path, cam=CAM.replace("DIGITAL", "SCAN")), "G")
    assert any("DIGITAL" in complaint.message for complaint in parsed.complaints)


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
