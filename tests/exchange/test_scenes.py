"""Scenes of openMVG (``sfm_data.json``) and of AliceVision and Meshroom (``.sfm``)."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip
from conversion.exchanged_blocks import block
from exchange.imported import read_well, reprojected, written

from orip.exchange.formats import guessed_source
from orip.exchange.vision.alicevision import read_alicevision
from orip.exchange.vision.openmvg import READING, read_openmvg
from orip.records.exchanged import ExchangedProject

WIDTH, HEIGHT = 4000, 3000
NEW, PLAIN = 1 << 31, 1 << 30
PINHOLE = {"focal_length": 3000.0, "principal_point": [2009.5, 1489.5]}


def observations(project: ExchangedProject, point: int) -> list[tuple[int, list[float]]]:
    """Return photos and image coordinates of a point, from the centre of the first pixel."""
    rows = np.flatnonzero(project.rays.point == point)
    return [(int(project.rays.photo[row]), (project.rays.image[row] - 0.5).tolist()) for row in rows]


def openmvg_document(project: ExchangedProject, camera: dict[str, Any], kind: str) -> dict[str, Any]:
    """Return what openMVG writes of a block whose rotations are from ground to camera."""
    size = {"width": WIDTH, "height": HEIGHT}
    return {
        "sfm_data_version": "0.3",
        "root_path": "/data/images",
        "views": [
            {"key": n, "value": {"polymorphic_id": PLAIN, "ptr_wrapper": {"id": NEW + n + 1, "data": {
                "local_path": "", "filename": photo.name, **size, "id_view": n, "id_intrinsic": 7, "id_pose": 10 + n}}}}
            for n, photo in enumerate(project.photos)
        ],
        "intrinsics": [
            {"key": 7, "value": {"polymorphic_id": NEW + 1, "polymorphic_name": kind,
                                 "ptr_wrapper": {"id": NEW + 99, "data": {**size, **camera}}}}
        ],
        "extrinsics": [
            {"key": 10 + n, "value": {"rotation": np.reshape(photo.rotation, (3, 3)).tolist(),
                                      "center": list(map(float, photo.position))}}
            for n, photo in enumerate(project.photos)
        ],
        "structure": [
            {"key": point, "value": {"X": xyz, "observations": [
                {"key": photo, "value": {"id_feat": point, "x": image}}
                for photo, image in observations(project, point)]}}
            for point, xyz in enumerate(project.points.coordinates.tolist())
        ],
        "control_points": [],
    }  # fmt: skip


def openmvg_text(project: ExchangedProject) -> str:
    return json.dumps(openmvg_document(project, PINHOLE, "pinhole"), indent=4)


def texts(values: Any) -> list[str]:
    return [repr(float(value)) for value in values]


def alicevision_camera(kind: str = "pinhole", distortion: Any = (), **more: Any) -> dict[str, Any]:
    """Return a camera of f = 3000 px: 24 mm on 32 mm of 4000 pixels."""
    return {
        "intrinsicId": "7", "width": str(WIDTH), "height": str(HEIGHT), "sensorWidth": "32", "sensorHeight": "24",
        "serialNumber": "", "type": kind, "initializationMode": "estimated", "initialFocalLength": "24",
        "focalLength": "24", "pixelRatio": "1", "pixelRatioLocked": "true", "principalPoint": ["9.5", "-10.5"],
        "distortionParams": texts(distortion) or "", "locked": "false", **more,
    }  # fmt: skip


def alicevision_document(
    project: ExchangedProject, camera: dict[str, Any], version: tuple[int, int, int]
) -> dict[str, Any]:
    """Return what AliceVision writes of a block whose rotations are from ground to camera."""
    return {
        "version": list(map(str, version)),
        "featuresFolders": ["../features"],
        "views": [
            {"viewId": str(1000 + n), "poseId": str(10 + n), "intrinsicId": "7", "path": photo.name,
             "width": str(WIDTH), "height": str(HEIGHT), "metadata": ""}
            for n, photo in enumerate(project.photos)
        ],
        "intrinsics": [camera],
        "poses": [
            {"poseId": str(10 + n), "pose": {"transform": {
                "rotation": texts(np.ravel(np.reshape(photo.rotation, (3, 3)), order="F")),
                "center": texts(photo.position)}, "locked": "0"}}
            for n, photo in enumerate(project.photos)
        ],
        "structure": [
            {"landmarkId": str(point), "descType": "dspsift", "color": ["1", "2", "3"], "X": texts(xyz),
             "observations": [{"observationId": str(1000 + photo), "featureId": str(point), "x": texts(image)}
                              for photo, image in observations(project, point)]}
            for point, xyz in enumerate(project.points.coordinates.tolist())
        ],
    }  # fmt: skip


def alicevision_text(project: ExchangedProject) -> str:
    return json.dumps(alicevision_document(project, alicevision_camera(), (1, 2, 8)), indent=4)


def radial(x: np.ndarray, *k: float) -> np.ndarray:
    s = (x**2).sum(axis=1, keepdims=True)
    return x * (1.0 + sum(value * s ** (n + 1) for n, value in enumerate(k)))


def brown(x: np.ndarray, k1: float, k2: float, k3: float, t1: float, t2: float) -> np.ndarray:
    (u, v), s = x.T, (x**2).sum(axis=1)
    decentring = [t2 * (s + 2.0 * u * u) + 2.0 * t1 * u * v, t1 * (s + 2.0 * v * v) + 2.0 * t2 * u * v]
    return radial(x, k1, k2, k3) + np.column_stack(decentring)


def fisheye(x: np.ndarray, *k: float) -> np.ndarray:
    r = np.hypot(*x.T)[:, None]
    angle = np.arctan(r)
    return x / r * (angle + sum(value * angle ** (2 * n + 3) for n, value in enumerate(k)))


def field_of_view(x: np.ndarray, omega: float) -> np.ndarray:
    r = np.hypot(*x.T)[:, None]
    return x / r * np.arctan(2.0 * r * np.tan(omega / 2.0)) / omega


def measured(distort: Callable[..., np.ndarray], terms: Any, ratio: float = 1.0) -> ExchangedProject:
    """Return the block as a camera of these formulas shows it: x = R (X - C), f 3000, its principal point as above.

    Nothing of orip's conversion has a part in the image coordinates.
    """
    given = block(READING)
    for photo in range(len(given.photos)):
        rows = np.flatnonzero(given.rays.photo == photo)
        rotation = np.reshape(given.photos[photo].rotation, (3, 3))
        seen = (given.points.coordinates[given.rays.point[rows]] - given.photos[photo].position) @ rotation.T
        assert (seen[:, 2] > 0.0).all()
        ideal = distort(seen[:, :2] / seen[:, 2:], *terms)
        given.rays.image[rows] = ideal * [3000.0, 3000.0 * ratio] + [2009.5, 1489.5] + 0.5
    return given


BROWN = (-0.1, 0.02, -0.003, 3e-4, -5e-4)
FISHEYE = (0.01, -0.004, 0.002, -0.0005)

OPENMVG = [
    ("pinhole", "", radial, ()),
    ("pinhole_radial_k1", "disto_k1", radial, BROWN[:1]),
    ("pinhole_radial_k3", "disto_k3", radial, BROWN[:3]),
    ("pinhole_brown_t2", "disto_t2", brown, BROWN),
    ("fisheye", "fisheye", fisheye, FISHEYE),
]


@pytest.mark.parametrize(("kind", "key", "distort", "terms"), OPENMVG)
def test_a_scene_of_openmvg_shows_its_points_where_they_were_measured(
    tmp_path: Path, kind: str, key: str, distort: Callable[..., np.ndarray], terms: tuple[float, ...]
) -> None:
    given = measured(distort, terms)
    camera = PINHOLE | ({key: list(terms)} if key else {})
    text = json.dumps(openmvg_document(given, camera, kind))
    path = written(tmp_path / "sfm_data.json", text)
    assert guessed_source(path)[0].name == "openmvg"
    project = read_well(read_openmvg, path)
    assert (len(project.photos), len(project.rays.photo)) == (len(given.photos), len(given.rays.photo))
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert set(project.cameras[0].free) == {"f", "cx", "cy", *(["k1", "k2", "k3", "p2", "p1"] if terms == BROWN else
                                                              ["k1", "k2", "k3", "k4"][:len(terms)])}  # fmt: skip


PIXELS = {"principalPoint": ["2009.5", "1489.5"], "pxInitialFocalLength": "3000", "focalLength": None}
ALICEVISION = [
    ((1, 0, 0), alicevision_camera("radial3", BROWN[:3], pxFocalLength="3000", **PIXELS), radial, BROWN[:3], 1.0),
    ((1, 2, 0), alicevision_camera("brown", BROWN, pxFocalLength=["3000", "3300"], **PIXELS), brown, BROWN, 1.1),
    ((1, 2, 1), alicevision_camera("brown", BROWN, pxFocalLength=["3000", "3300"]), brown, BROWN, 1.1),
    ((1, 2, 4), alicevision_camera("radial1", BROWN[:1], pixelRatio=repr(1 / 1.1)), radial, BROWN[:1], 1.1),
    ((1, 2, 6), alicevision_camera("radial3", BROWN[:3], pixelRatio="1.1"), radial, BROWN[:3], 1.1),
    ((1, 2, 6), alicevision_camera("fisheye4", FISHEYE), fisheye, FISHEYE, 1.0),
    ((1, 2, 6), alicevision_camera("fisheye1", (0.5,)), field_of_view, (0.5,), 1.0),
    ((1, 2, 8), alicevision_camera(distortionType="none"), radial, (), 1.0),
    ((1, 2, 8), alicevision_camera("pinhole", BROWN, distortionType="brown"), brown, BROWN, 1.0),
    ((1, 2, 11), alicevision_camera("pinhole", BROWN[:3], distortionType="radialk3", pixelRatio="1.1",
                                    focalLength="26.4"), radial, BROWN[:3], 1.1),
]  # fmt: skip


@pytest.mark.parametrize(("version", "camera", "distort", "terms", "ratio"), ALICEVISION)
def test_a_scene_of_alicevision_shows_its_points_where_they_were_measured(
    tmp_path: Path,
    version: tuple[int, int, int],
    camera: dict[str, Any],
    distort: Callable[..., np.ndarray],
    terms: tuple[float, ...],
    ratio: float,
) -> None:
    given = measured(distort, terms, ratio)
    path = written(tmp_path / "cameras.sfm", json.dumps(alicevision_document(given, camera, version)))
    assert guessed_source(path)[0].name == "alicevision"
    project = read_well(read_alicevision, path)
    assert len(project.rays.photo) == len(given.rays.photo)
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    assert len(project.cameras[0].free) == 4 + len(terms)


def test_what_alicevision_holds_of_a_camera_stays_held(tmp_path: Path) -> None:
    for locks, free in (
        ({"locked": "1"}, set()),
        ({"offsetLocked": "true"}, {"fx", "fy", "k1"}),
        ({"scaleLocked": "true", "distortionLocked": "true"}, {"cx", "cy"}),
    ):
        document = alicevision_document(block(READING), alicevision_camera("radial1", (0.0,), **locks), (1, 2, 8))
        project = read_well(read_alicevision, written(tmp_path / "a.sfm", json.dumps(document)))
        assert set(project.cameras[0].free) == free


def changed_openmvg(tmp_path: Path, change: Callable[[Any], object]) -> Path:
    document = openmvg_document(block(READING), PINHOLE, "pinhole")
    change(document)
    return written(tmp_path / "sfm_data.json", json.dumps(document, indent=4))


def camera_of(document: Any) -> Any:
    return document["intrinsics"][0]["value"]


FAULTS: list[tuple[Callable[[Any], object], str]] = [
    (lambda d: d["extrinsics"].clear(), "no photo is oriented"),
    (lambda d: d["intrinsics"].clear(), "there is no camera 7 in the file"),
    (lambda d: d["views"].append(d["views"][0]), "number 0 is there twice"),
    (lambda d: d["views"][0].update(key=-1), "a whole number from 0 to 4294967294"),
    (lambda d: d["views"][0].update(key=10**40), "a whole number from 0 to 4294967294"),
    (lambda d: d["extrinsics"][0]["value"].update(rotation=[[1, 0, 0]]), "3 rows of 3 numbers"),
    (lambda d: camera_of(d)["ptr_wrapper"]["data"].update(focal_length=0), "focal length has to be above 0"),
    (lambda d: camera_of(d)["ptr_wrapper"]["data"].update(disto_k3=[1, 2]), "3 finite numbers should be here"),
    (lambda d: d["structure"][0]["value"].update(X=[1, 2, "3"]), "3 finite numbers should be here"),
]


@pytest.mark.parametrize(("change", "message"), FAULTS)
def test_what_is_wrong_in_a_scene_is_said(tmp_path: Path, change: Callable[[Any], object], message: str) -> None:
    said = orip(tmp_path, "import", str(changed_openmvg(tmp_path, change)), "new")
    assert said.code == 3
    assert message in " ".join(said.err.split())


def test_a_panorama_is_refused_by_name(tmp_path: Path) -> None:
    def spherical(document: Any) -> None:
        camera_of(document).update(polymorphic_name="spherical")
        del camera_of(document)["ptr_wrapper"]["data"]["focal_length"]

    said = orip(tmp_path, "import", str(changed_openmvg(tmp_path, spherical)), "new")
    assert said.code == 3
    assert "spherical" in said.err
    for camera, named in (
        (alicevision_camera("equirectangular"), "equirectangular"),
        (alicevision_camera(undistortionType="radialk3"), "undistortion radialk3"),
    ):
        document = alicevision_document(block(READING), camera, (1, 2, 8))
        said = orip(tmp_path, "import", str(written(tmp_path / "a.sfm", json.dumps(document))), "new")
        assert said.code == 3
        assert named in said.err


def test_photos_that_are_not_oriented_are_counted(tmp_path: Path) -> None:
    project = read_well(read_openmvg, changed_openmvg(tmp_path, lambda document: document["extrinsics"].pop()))
    assert len(project.photos) == 5
    assert project.notes == ("1 photo not oriented, left out.", "60 measurements in photos not oriented, left out.")


def test_priors_of_photos_are_said_to_be_left_out(tmp_path: Path) -> None:
    def prior(document: Any) -> None:
        data = document["views"][1]["value"]["ptr_wrapper"]["data"]
        data.update(use_pose_center_prior=True, center_weight=[1.0, 1.0, 1.0], center=[1.0, 2.0, 3.0])

    project = read_well(read_openmvg, changed_openmvg(tmp_path, prior))
    assert project.notes[0].startswith("1 position of photos (priors of views) left out")


def test_a_ratio_of_pixels_whose_meaning_is_not_known_is_refused(tmp_path: Path) -> None:
    document = alicevision_document(block(READING), alicevision_camera(pixelRatio="1.1"), (1, 2, 10))
    said = orip(tmp_path, "import", str(written(tmp_path / "a.sfm", json.dumps(document))), "new")
    assert said.code == 3
    assert "1.2.9 and 1.2.10 is not known" in " ".join(said.err.split())


def test_control_points_of_openmvg_are_control(tmp_path: Path) -> None:
    def mark(document: Any) -> None:
        document["control_points"] = [document["structure"].pop(0) for _ in range(4)]

    path = changed_openmvg(tmp_path, mark)
    project = read_well(read_openmvg, path)
    assert [point.name for point in project.control] == ["0", "1", "2", "3"]
    assert len(project.points.marks) == 4
    assert orip(tmp_path, "import", str(path), "new").code == 0
    assert orip(tmp_path / "new", "run", "--no-report").code == 0


def test_the_pose_of_a_rig_is_refused(tmp_path: Path) -> None:
    document = alicevision_document(block(READING), alicevision_camera(), (1, 2, 8))
    document["views"][0] |= {"rigId": "1", "subPoseId": "0", "isPoseIndependant": "false"}
    said = orip(tmp_path, "import", str(written(tmp_path / "a.sfm", json.dumps(document))), "new")
    assert said.code == 3
    assert "the pose is that of a rig" in " ".join(said.err.split())


@pytest.mark.parametrize(("name", "text"), [("sfm_data.json", openmvg_text), ("cameras.sfm", alicevision_text)])
def test_a_scene_is_adjusted_and_written_in_one_command(
    tmp_path: Path, name: str, text: Callable[[ExchangedProject], str]
) -> None:
    source = written(tmp_path / name, text(block(READING, noise_px=0.3)))
    done = orip(tmp_path, "adjust", str(source), "new")
    assert done.code == 0, done.err
    again = orip(tmp_path / "new", "export", guessed_source(source)[0].name, f"../again-{name}")
    assert again.code == 0, again.err
    assert guessed_source(tmp_path / f"again-{name}")[0].name == guessed_source(source)[0].name
