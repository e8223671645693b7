"""What is adjusted of an imported camera: what the other program has estimated, if the photos can determine it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange.imported import read_well, written
from exchange.test_metashape import READING as OF_METASHAPE
from exchange.test_metashape import document
from exchange.test_metric import aicon_files, photomodeler_text, pix4d_files
from exchange.test_opensfm import project_folder, reconstruction_of, tracks_of
from exchange.test_vision import bal, bundler, nvm

from orip.exchange import aicon, photomodeler, pix4d
from orip.exchange.metashape.source import read_metashape
from orip.exchange.opensfm.reconstruction import READING
from orip.exchange.opensfm.source import read_opensfm
from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.exchange.vision import bundler as vision
from orip.exchange.vision import nvm as visual_sfm
from orip.records.exchanged import ExchangedProject
from orip.structs import replace
from orip.workflow.project.bundle_state import read_bundle

PLANE = ("f", "cx", "cy")


def free(project: ExchangedProject) -> set[str]:
    return set(project.cameras[0].free)


def test_cameras_of_opensfm_are_adjusted_unless_it_was_told_to_hold_them(tmp_path: Path) -> None:
    """OpenSfM estimates its cameras; the import held them, and said so nowhere."""
    folder = project_folder(tmp_path)
    assert free(read_well(read_opensfm, folder)) == {"fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2"}
    written(folder / "config.yaml", "optimize_camera_parameters: yes\n")
    assert free(read_well(read_opensfm, folder))
    written(folder / "config.yaml", "feature_process_size: 2048\noptimize_camera_parameters: no  # fixed\n")
    assert not free(read_well(read_opensfm, folder))


def perspective(document: Any, focal: float) -> str:
    camera = {"projection_type": "perspective", "width": 4000, "height": 3000, "focal": focal, "k1": 0.0, "k2": 0.0}
    document[1]["cameras"] = {"cam": camera}
    for shot in document[1]["shots"].values():
        del shot["gps_position"], shot["gps_dop"]
    return json.dumps(document)


def test_a_wrong_focal_length_of_opensfm_is_found(tmp_path: Path) -> None:
    """A focal length 1 % too long stayed as it was, with "converged" and without a note."""
    given = block(READING, noise_px=0.3)
    given = replace(given, rays=replace(given.rays, image=given.rays.image - [10.0, -10.0]))  # from the frame's centre
    written(tmp_path / "reconstruction.json", perspective(reconstruction_of(given), 0.7575))
    written(tmp_path / "tracks.csv", tracks_of(given, 2))
    done = orip(tmp_path, "import", "opensfm", ".", "new", "--precision", "0.3")
    assert done.code == 0
    assert "1 camera adjusted (C, A3, A5)" in f"{done.out}{done.err}"
    assert "adjusted: C, A3, A5" in (tmp_path / "new" / "README.md").read_text(encoding="utf-8")
    assert orip(tmp_path / "new", "run", "--no-report").code == 0
    cameras = read_bundle(tmp_path / "new", None, "heads", "solutions").adjusted.cameras
    assert abs(cameras.values[0, 0] - 27.0) < 3.0 * cameras.sd[0, 0] < 0.1


def test_held_cameras_are_said_to_be_held(tmp_path: Path) -> None:
    folder = project_folder(tmp_path)
    done = orip(folder, "import", "opensfm", ".", "new", "--hold-cameras")
    assert "1 camera held" in f"{done.out}{done.err}"


def test_cameras_of_bundler_bal_and_visualsfm_are_adjusted_unless_they_were_fixed(tmp_path: Path) -> None:
    source = written(tmp_path / "bundle.out", bundler(block(vision.BUNDLER)))
    assert free(read_well(vision.read_bundler, source)) == {"fx", "fy", "k1", "k2"}
    source = written(tmp_path / "problem.txt", bal(block(vision.BAL)))
    assert free(read_well(vision.read_bal, source)) == {"fx", "fy", "k1", "k2"}
    text = nvm(block(visual_sfm.READING))
    assert free(read_well(visual_sfm.read_nvm, written(tmp_path / "a.nvm", text))) == {"f", "k1"}
    fixed = text.replace("NVM_V3", "NVM_V3 FixedK 3000 2010 3000 1490", 1)
    assert not free(read_well(visual_sfm.read_nvm, written(tmp_path / "b.nvm", fixed)))


def test_a_deviation_of_photomodeler_says_what_was_estimated(tmp_path: Path) -> None:
    lines = photomodeler_text(block(photomodeler.READING)).splitlines()
    # the sixth line of a photo: c, principal point, size, K1 K2 K3, P1 P2
    for row in range(10, len(lines), 6):
        if len(lines[row].split()) != 11:
            break
        lines[row] = f"{lines[row].split()[0]} 0.01 0 0 0 0 1e-6 0 0 0 0"
    source = written(tmp_path / "a.txt", "\n".join(lines) + "\n")
    assert free(read_well(photomodeler.read_photomodeler, source)) == {"f", "k1"}


def test_cameras_of_aicon_and_pix4d_are_adjusted(tmp_path: Path) -> None:
    assert {"f", "cx", "cy"} <= free(read_well(aicon.read_aicon, aicon_files(tmp_path / "a", block(aicon.READING))))
    found = read_well(pix4d.read_pix4d, pix4d_files(tmp_path / "p", block(pix4d.READING)))
    assert {"fx", "cx", "k1", "k3", "p2"} <= free(found)


def test_a_camera_of_metashape_without_covariances_is_adjusted_unless_it_is_fixed(tmp_path: Path) -> None:
    text = document(block(OF_METASHAPE))
    start, end = text.index("<covariance>"), text.index("</covariance>") + len("</covariance>")
    without = text[:start] + text[end:]
    project = read_well(read_metashape, written(tmp_path / "a.xml", without))
    assert set(PLANE) <= free(project)
    fixed = without.replace("<calibration", '<property name="fixed" value="true"/><calibration', 1)
    assert not free(read_well(read_metashape, written(tmp_path / "b.xml", fixed)))


def estimated(project: ExchangedProject, *names: str) -> ExchangedProject:
    return replace(project, cameras=tuple(replace(camera, free=names) for camera in project.cameras))


def unknown(project: ExchangedProject) -> tuple[tuple[str, ...], str]:
    imported = imported_block(project, "source", ExchangeSettings())
    return imported.cameras[0].camera.unknown, " ".join(imported.notes)


def level(project: ExchangedProject) -> ExchangedProject:
    """Return a block of vertical photos over level ground: their height and C move the image in the same way."""
    points = project.points.coordinates.copy()
    points[:, 2] = 0.0
    rotations = np.tile(np.diag([1.0, -1.0, -1.0]).ravel(), (len(project.photos), 1))
    centres = np.column_stack(
        [np.linspace(-30.0, 30.0, len(rotations)), np.zeros(len(rotations)), 100.0 + 0.0 * rotations[:, 0]]
    )
    photos = tuple(
        replace(photo, rotation=tuple(rotation), position=tuple(-rotation.reshape(3, 3) @ centre))
        for photo, rotation, centre in zip(project.photos, rotations, centres, strict=True)
    )
    away = points[project.rays.point] - centres[project.rays.photo]
    image = 3000.0 * np.column_stack([-away[:, 0] / away[:, 2], away[:, 1] / away[:, 2]]) + [2010.0, 1490.0]
    return replace(
        project,
        photos=photos,
        points=replace(project.points, coordinates=points),
        rays=replace(project.rays, image=image),
    )


def test_a_camera_over_level_ground_keeps_its_principal_distance() -> None:
    given = estimated(block(READING), "fx", "fy", "k1")
    flat = level(replace(given, readings=(replace(READING, form="matrix"),)))
    names, said = unknown(flat)
    assert names == ("A3",)
    assert "C of camera CAMERA1 held: the photos cannot determine that" in said
    names, said = unknown(given)
    assert names == ("C", "A3")
    assert "held" not in said


def test_three_photos_do_not_calibrate_a_camera() -> None:
    given = estimated(block(READING), "fx", "fy", "k1")
    few = given.rays.photo < 3
    rays = replace(
        given.rays, photo=given.rays.photo[few], point=given.rays.point[few], image=given.rays.image[few],
        deviation=given.rays.deviation[few], is_active=given.rays.is_active[few],
    )  # fmt: skip
    names, said = unknown(replace(given, photos=given.photos[:3], rays=rays))
    assert names == ()
    assert "too few" in said


def test_more_terms_than_a_few_rays_can_carry_are_held() -> None:
    given = estimated(block(READING), "fx", "fy", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
    # four points in six photos: 48 coordinates, and 48 unknowns less the 7 of the datum
    some = given.rays.point < 4
    rays = replace(
        given.rays, photo=given.rays.photo[some], point=given.rays.point[some], image=given.rays.image[some],
        deviation=given.rays.deviation[some], is_active=given.rays.is_active[some],
    )  # fmt: skip
    names, said = unknown(replace(given, rays=rays))
    assert names == ("C", "DX", "DY", "A3", "P1", "P2")
    assert "A5, A7 of camera CAMERA1 held" in said
