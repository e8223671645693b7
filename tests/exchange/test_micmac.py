"""MicMac and MMVII: cameras, orientations, points, tie points joined to tracks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, sample, written

from orip.exchange.conversion.cameras import convert_camera, lens_pixels, pixels_of_directions
from orip.exchange.conversion.poses import orip_poses
from orip.exchange.micmac import version1
from orip.exchange.micmac.source import READING, read_micmac
from orip.exchange.sources.text import Faults
from orip.records.exchanged import ExchangedProject

SeenBy = Callable[[int, np.ndarray], np.ndarray]
"""From the place of a camera and directions to pixels."""

SAMPLE = ("micmac", "MMVII-TestDir", "Input")

CAMERA = """<?xml version="1.0" ?>
<ExportAPERO><CalibrationInternConique>
  <KnownConv>eConvApero_DistM2C</KnownConv><PP>2010 1490</PP><F>3000</F><SzIm>4000 3000</SzIm>
  <CalibDistortion><ModRad><CDist>2010 1490</CDist><CoeffDist>0</CoeffDist></ModRad></CalibDistortion>
</CalibrationInternConique></ExportAPERO>
"""


def orientation(project: ExchangedProject, photo: int) -> str:
    rows = np.array(project.photos[photo].rotation).reshape(3, 3)
    matrix = "".join(f"<L{n}>{' '.join(map(repr, row))}</L{n}>" for n, row in enumerate(rows.tolist(), start=1))
    centre = " ".join(str(float(value)) for value in project.photos[photo].position)
    return (
        f"<ExportAPERO><OrientationConique><FileInterne>Ori-A/Cam.xml</FileInterne><Externe><Centre>{centre}</Centre>"
        f"<ParamRotation><CodageMatr>{matrix}</CodageMatr></ParamRotation></Externe></OrientationConique></ExportAPERO>\n"
    )


def project_folder(folder: Path) -> Path:
    """Write a project whose points are ties; the first three are known on the ground and measured as such, too."""
    project = block(READING)
    written(folder / "Ori-A" / "Cam.xml", CAMERA)
    for n, photo in enumerate(project.photos):
        written(folder / "Ori-A" / f"Orientation-{photo.name}.xml", orientation(project, n))
    points = "".join(
        f"<OneAppuisDAF><Pt>{' '.join(map(repr, xyz))}</Pt><NamePt>G{n}</NamePt><Incertitude>{n + 1} 1 1</Incertitude>"
        "</OneAppuisDAF>"
        for n, xyz in enumerate(project.points.coordinates[:3].tolist())
    )
    written(folder / "points-S3D.xml", f"<DicoAppuisFlottant>{points}</DicoAppuisFlottant>")
    image = {
        (photo, point): xy
        for photo, point, xy in zip(project.rays.photo, project.rays.point, project.rays.image.tolist(), strict=True)
    }
    marks = "".join(
        f"<OneMesureAF1I><NamePt>G{n}</NamePt><PtIm>{' '.join(map(repr, image[0, n]))}</PtIm></OneMesureAF1I>"
        for n in range(3)
    )
    written(
        folder / "points-S2D.xml",
        f"<SetOfMesureAppuisFlottants><MesureAppuiFlottant1Im><NameIm>0.jpg</NameIm>{marks}</MesureAppuiFlottant1Im>"
        "</SetOfMesureAppuisFlottants>",
    )
    for first in range(len(project.photos) - 1):
        pairs = [(*image[first, n], *image[first + 1, n]) for n in range(len(project.points.names))]
        text = "\n".join(" ".join(map(repr, pair)) for pair in pairs)
        written(folder / "Homol" / f"Pastis{first}.jpg" / f"{first + 1}.jpg.txt", text + "\n")
    return folder


def test_a_block_is_read_with_points_and_ties(tmp_path: Path) -> None:
    given = block(READING)
    project = read_well(read_micmac, project_folder(tmp_path))
    assert len(project.photos) == len(given.photos)
    tracks = project.points.is_track
    assert tracks.sum() == len(given.points.names)
    assert np.bincount(project.rays.point)[tracks].tolist() == [len(given.photos)] * len(given.points.names)
    found, is_declared = reprojected(project)
    assert is_declared
    # ties have no coordinates in the files: they are intersected
    assert found.rms < 1e-6
    assert [point.errors for point in project.control] == [(None, None, None), (2.0, 1.0, 1.0), (3.0, 1.0, 1.0)]


def test_a_track_that_meets_a_photo_twice_is_left_out(tmp_path: Path) -> None:
    path = project_folder(tmp_path) / "Homol" / "Pastis0.jpg" / "1.jpg.txt"
    first, second = (line.split() for line in path.read_text().splitlines()[:2])
    written(path, path.read_text() + " ".join([*first[:2], *second[2:]]) + "\n")
    project = read_well(read_micmac, tmp_path)
    assert project.points.is_track.sum() == len(block(READING).points.names) - 2
    assert "1 track meeting a photo twice, left out." in project.notes


@pytest.mark.parametrize(
    ("names", "largest"),
    # the figures are those of scripts that were written apart from the program
    [(("Saisies-MMV1", "Ori-Ground_mm3d"), 1e-12), (("Ori-MMV1",), 2e-11)],
)
def test_cameras_reproduce_what_micmac_says_they_must(names: tuple[str, ...], largest: float) -> None:
    folder = sample(*SAMPLE, *names)
    project = read_well(read_micmac, folder)
    assert verified(project, folder) < largest


def test_mmvii_reproduces_what_it_was_converted_from() -> None:
    project = read_well(read_micmac, sample(*SAMPLE, "Saisies-MMV1", "MMVII-PhgrProj"))
    # MMVII fits its distortion of normalised coordinates to the first version's
    assert verified(project, sample(*SAMPLE, "Saisies-MMV1", "Ori-Ground_mm3d")) < 0.07


@pytest.mark.parametrize("names", [("Saisies-MMV1", "Ori-Ground_mm3d"), ("Ori-MMV1",)])
def test_cameras_of_orip_reproduce_it_too(names: tuple[str, ...]) -> None:
    folder = sample(*SAMPLE, *names)
    project = read_well(read_micmac, folder)
    cameras = [convert_camera(camera, "C").camera for camera in project.cameras]

    def seen_by(camera: int, directions: np.ndarray) -> np.ndarray:
        return pixels_of_directions(cameras[camera], directions)

    # some thousand pixels of 1e-16 relative, from millimetres and back, through polynomials of the fifth degree
    assert verified(project, folder, seen_by) < 1e-10


def verified(project: ExchangedProject, folder: Path, seen_by: SeenBy | None = None) -> float:
    """Return the largest distance from the pixels of the files' own check pairs."""
    return max(float(np.hypot(*beside_pairs(project, folder, n, seen_by).T).max()) for n in range(len(project.photos)))


def beside_pairs(project: ExchangedProject, folder: Path, number: int, seen_by: SeenBy | None = None) -> np.ndarray:
    """Return by how much the pixels of a photo differ from those of its file's own check pairs, (10, 2)."""
    rotations, centres = orip_poses(project.photos, project.readings[0])
    photo = project.photos[number]
    given = version1.read_orientation(folder / f"Orientation-{photo.name}.xml", Faults(photo.name))
    assert given is not None
    assert len(given.pairs) == 10
    seen = (np.array([point for _, point in given.pairs]) - centres[number]) @ rotations[number]
    directions = seen[:, :2] / -seen[:, 2:]
    if seen_by is not None:
        pixels = seen_by(photo.camera, directions)
    else:
        pixels = lens_pixels(project.cameras[photo.camera], (36.0, 24.0), directions)
    return pixels - np.array([pixel for pixel, _ in given.pairs])


def test_a_fisheye_is_refused_by_name(tmp_path: Path) -> None:
    folder = sample(*SAMPLE, "Ori-MMV1")
    faults = Faults("camera")
    assert version1.read_calibration(folder / "AutoCal_Foc-11500_Cam-imx477imx477-1.xml", faults) is None
    assert "eModele_FishEye_10_5_5" in faults.complaints[0].message


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<F>3000</F>", "", "has no <F>"),
        ("<F>3000</F>", "<F>-1</F>", "above 0"),
        ("eConvApero_DistM2C", "eConvApero_DistC2M", "eConvApero_DistC2M"),
        ("ModRad", "ModGrid", "ModGrid"),
        ("<CoeffDist>0</CoeffDist>", "<CoeffDist>1e-9</CoeffDist>" * 6, "6 radial coefficients"),
        ("<PP>2010 1490</PP>", "<PP>2010</PP>", "2 numbers should be here, 1 found"),
    ],
)
def test_faults_of_a_camera_name_their_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    project_folder(tmp_path)
    path = tmp_path / "Ori-A" / "Cam.xml"
    assert old in CAMERA
    written(path, CAMERA.replace(old, new))
    parsed = read_micmac(tmp_path, "P")
    assert parsed.value is None
    assert said in parsed.complaints[0].message
    assert parsed.complaints[0].path == "P/Ori-A/Cam.xml"
    assert parsed.complaints[0].line in (2, 3, 4)


def test_of_several_folders_one_has_to_be_named(tmp_path: Path) -> None:
    project_folder(tmp_path)
    written(tmp_path / "Ori-B" / "Orientation-x.xml", "<a/>")
    parsed = read_micmac(tmp_path, "P")
    assert "Ori-A, Ori-B" in parsed.complaints[0].message


def test_a_calibration_with_a_name_that_no_file_can_have_is_missing(tmp_path: Path) -> None:
    folder = project_folder(tmp_path / "block")
    path = sorted(folder.rglob("Orientation-*.xml"))[0]
    text = path.read_text(encoding="utf-8")
    start, end = text.index("<FileInterne>") + len("<FileInterne>"), text.index("</FileInterne>")
    path.write_text(f"{text[:start]}{'1' * 5000}{text[end:]}", encoding="utf-8")
    found = read_micmac(folder, "block")
    assert found.value is None
    assert any("1111" in complaint.message for complaint in found.complaints)
