"""PhotoModeler, AICON, Pix4D and IGN."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, written
from reference.published_data import data_set

from orip.exchange import aicon, ign, photomodeler, pix4d
from orip.exchange.conversion.lens_table import directions_of_image
from orip.exchange.conversion.poses import orip_poses
from orip.records.exchanged import ExchangedProject

PIXEL_MM = 0.006


def rows_of(project: ExchangedProject) -> list[tuple[str, str, float, float]]:
    """Return photo, point, column and row of each ray."""
    return [
        (project.photos[photo].name, project.points.names[point], *xy)
        for photo, point, xy in zip(project.rays.photo, project.rays.point, project.rays.image.tolist(), strict=True)
    ]


def numbers(*values: float) -> str:
    return " ".join(str(float(value)) for value in values)


def photomodeler_text(project: ExchangedProject) -> str:
    camera = numbers(18.0, 2010 * PIXEL_MM, 1490 * PIXEL_MM, 24.0, 18.0, 0, 0, 0, 0, 0)
    lines = ["Title", "0.0005 20 4000 3000", numbers(*[1.0] * 9), camera, numbers(*[0.0] * 10)]
    for n, photo in enumerate(project.photos):
        omega, phi, kappa = photo.rotation
        pose = numbers(*photo.position, kappa, phi, omega)
        lines += [f"{n} a b/{photo.name}", f"{n} {pose}", f"{n} 0 0 0 0 0 0", "", f"{n} {camera}", f"{n} {camera}"]
    points = [
        f"{name} {numbers(*xyz)} 0.1 0.1 0.1"
        for name, xyz in zip(project.points.names, project.points.coordinates, strict=True)
    ]
    names = [photo.name for photo in project.photos]
    marks = [f"{names.index(photo)} {point} {numbers(x, y, 0.1, 0.2)}" for photo, point, x, y in rows_of(project)]
    return "\n".join([*lines, "", "7 1 2 3 0.1 0.2 0.3", "", *points, "", *marks, "", "1 2 3"]) + "\n"


def test_photomodeler_reads_a_block_as_it_was_written(tmp_path: Path) -> None:
    source = written(tmp_path / "a.txt", photomodeler_text(block(photomodeler.READING)))
    assert photomodeler.is_photomodeler(source)
    project = read_well(photomodeler.read_photomodeler, source)
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert project.control[0].errors == (0.1, 0.2, 0.3)
    assert set(project.rays.deviation.tolist()) == {0.2}
    assert project.photos[0].name == "a b/0.jpg"


def test_the_sample_of_photomodeler_has_the_published_figure() -> None:
    path = data_set("dbat-camcal-selfcal") / "models" / "camcal-pmexport.txt"
    project = read_well(photomodeler.read_photomodeler, path)
    assert (len(project.photos), len(project.rays.photo)) == (21, 2074)
    rotations, centres = orip_poses(project.photos, project.readings[0])
    lengths = []
    for n in range(len(project.photos)):
        rows = np.flatnonzero(project.rays.photo == n)
        seen = (project.points.coordinates[project.rays.point[rows]] - centres[n]) @ rotations[n]
        camera = project.cameras[project.photos[n].camera]
        millimetres = (project.rays.image[rows] - [1136, 852]) * [7.25319 / 2272, -5.43764 / 1704]
        measured = directions_of_image(camera, millimetres)
        residuals = (measured - seen[:, :2] / -seen[:, 2:]) * 7.465 * [2272 / 7.25319, 1704 / 5.43764]
        lengths += np.hypot(*residuals.T).tolist()
    # as PhotoModeler has it: measurements freed of distortion minus projected points
    assert np.sqrt(np.mean(np.square(lengths))) == pytest.approx(0.5997, abs=1e-4)


def aicon_files(folder: Path, project: ExchangedProject) -> Path:
    camera = "3 CAM1 -18 0.06 0.06 0 0 0\n0\n0 0\n0 0\n24 18 4000 3000\n"
    photos = [
        f"{n} 3 {numbers(*photo.position, *photo.rotation)} 0 {int(n != 4)} 3" for n, photo in enumerate(project.photos)
    ]
    points = [
        f"{name} {numbers(*xyz)} 0.01 0.01 0.01 6 1 {int(name == '5')}"
        for name, xyz in zip(project.points.names, project.points.coordinates, strict=True)
    ]
    rays = [
        f"{photo[:-4]} {point} {numbers((x - 2000) * PIXEL_MM, (1500 - y) * PIXEL_MM, 0.0005, 0.0004)} 0 0 0 "
        f"{int(point != '9')} 0"
        for photo, point, x, y in rows_of(project)
    ]
    texts = {".eor": photos, ".obc": points, ".phc": rays, ".scale": ['1 "bar one" 3 5 100.25 0.02 1']}
    written(folder / "net.ior", camera.replace("3 CAM1", "3"))
    for suffix, lines in texts.items():
        written(folder / f"net{suffix}", "\n".join(lines) + "\n")
    return folder


def test_aicon_reads_a_block_as_it_was_written(tmp_path: Path) -> None:
    folder = aicon_files(tmp_path, block(aicon.READING))
    assert aicon.is_aicon(folder)
    assert aicon.is_aicon(folder / "net.eor")
    project = read_well(aicon.read_aicon, folder)
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert len(project.photos) == 5
    assert (~project.rays.is_active).sum() == 5
    assert [(bar.name, bar.start, bar.end, bar.distance, bar.error) for bar in project.distances] == [
        ("bar_one", "3", "5", 100.25, 0.02)
    ]
    assert "1 point;" in project.notes[0]


def test_scale_bars_that_are_wrong_are_said(tmp_path: Path) -> None:
    folder = aicon_files(tmp_path, block(aicon.READING))
    written(folder / "net.scale", '1 "bar one" 3 5 100,25 0.02 1\n1 "bar two" 3\n')
    assert [(one.path, one.line) for one in aicon.read_aicon(folder, "A").complaints] == [
        ("A/net.scale", 1),
        ("A/net.scale", 2),
    ]


def pix4d_files(folder: Path, project: ExchangedProject) -> Path:
    lines = ["fileName imageWidth imageHeight", "camera model m = K [R|-Rt] X", ""]
    for photo in project.photos:
        rows = np.array(photo.rotation).reshape(3, 3)
        centre = np.array(photo.position) - np.array([1000.0, 2000.0, 0.0])
        lines += [f"{photo.name} 4000 3000", "3000 0 2010", "0 3000 1490", "0 0 1", "0 0 0", "0 0", numbers(*centre)]
        lines += [numbers(*row) for row in rows]
    written(folder / "site_calibrated_camera_parameters.txt", "\n".join(lines) + "\n")
    written(folder / "site_offset.xyz", "1000.000 2000.000 0.000\n")
    written(folder / "site_wkt.prj", 'PROJCS["x"]\n')
    return folder


def test_pix4d_reads_poses_as_they_were_written(tmp_path: Path) -> None:
    given = block(pix4d.READING)
    project = read_well(pix4d.read_pix4d, pix4d_files(tmp_path / "1_initial" / "params", given).parent.parent)
    for expected, found in zip(
        orip_poses(given.photos, given.readings[0]), orip_poses(project.photos, project.readings[0]), strict=True
    ):
        assert np.allclose(found, expected, rtol=0.0, atol=1e-10)
    assert len(project.cameras) == 1
    assert project.crs == 'PROJCS["x"]'


def ign_files(folder: Path, project: ExchangedProject) -> Path:
    rows = [f"{photo.name} {numbers(*photo.position, *photo.rotation)} CAM" for photo in project.photos]
    written(folder / "x.OPK", "\n".join(["NOM\tX\tY\tZ\tO\tP\tK\tCAMERA", *rows]))
    written(folder / "cam.txt", "Name = CAM\nPPAx = 2010\nPPAy = 1490\nfocal = 3000\nwidth = 4000\nheight = 3000\n")
    rays = [f'"{point}" {photo} {x!r} {y!r}' for photo, point, x, y in rows_of(project)]
    written(folder / "x.mes", "\n".join(["", *rays, '"9" 0.jpg 0 0']))
    written(folder / "x.app", '"1" 13 1.5 2.5 3.5\n"2" 3 1 2 3\n')
    return folder


def test_ign_reads_a_block_as_it_was_written(tmp_path: Path) -> None:
    folder = ign_files(tmp_path, block(ign.READING))
    assert ign.is_ign(folder)
    project = read_well(ign.read_ign, folder)
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert project.control[0].coordinates == (1.5, 2.5, 3.5)
    assert any("2 (3)" in note for note in project.notes)
    assert any("1 measurement at 0, 0" in note for note in project.notes)


def test_errors_of_aicon_are_millimetres_and_no_pixels(tmp_path: Path) -> None:
    """The files have 0.0005 and 0.0004 mm; a pixel is 0.006 mm."""
    aicon_files(tmp_path / "net", block(aicon.READING))
    assert orip(tmp_path, "import", "aicon", "net", "p").code == 0
    text = (tmp_path / "p" / "MAIN.MEA").read_text(encoding="utf-8")
    said = [float(error) for error in re.findall(r"([0-9.e-]+)px", text)]
    assert said == pytest.approx([0.0005 / PIXEL_MM] * len(said))
    assert len(said) >= 300
    assert orip(tmp_path / "p", "run", "--no-report").code == 0


def test_what_orip_run_would_refuse_is_refused_by_the_import_in_one_sentence(tmp_path: Path) -> None:
    folder = aicon_files(tmp_path / "net", block(aicon.READING))
    path = folder / "net.phc"
    path.write_text(path.read_text(encoding="utf-8").replace("0.0005 0.0004", "5e-9 4e-9"), encoding="utf-8")
    said = orip(tmp_path, "import", "aicon", "net", "p")
    assert said.code == 3
    (line,) = (line for line in said.err.splitlines() if line.startswith("error"))
    assert "point 0 in photo 0, point 1 in photo 0, point 2 in photo 0 and 297 more: an a-priori error of" in line
    assert not (tmp_path / "p").exists()
