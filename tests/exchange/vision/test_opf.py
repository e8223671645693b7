"""Pix4D's Open Photogrammetry Format: projects written as the specification says (https://pix4d.github.io/opf-spec)."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip
from exchange.imported import read_well, reprojected, written

from orip.exchange.conversion.cameras import convert_camera
from orip.exchange.formats import guessed_source
from orip.exchange.vision.opf import read_opf
from orip.records.exchanged import ExchangedCamera
from orip.structs import replace

SENSOR, FIRST_ID = 9843086184167632639, 10_000_000_000_000_000_001
PLACE = np.array([691_000.0, 5_330_000.0, 520.0])
SHIFT = [-691_000.5, -5_330_000.25, -500.125]
ANGLES = [[3.0, -2.0, 10.0], [-4.0, 5.0, 100.0], [8.0, 1.0, -75.0], [-3.0, -6.0, 170.0], [1.0, 9.0, 40.0]]
PERSPECTIVE: dict[str, Any] = {
    "type": "perspective", "principal_point_px": [2010.0, 1490.0], "focal_length_px": 3000.0,
    "radial_distortion": [-0.1, 0.02, -0.003], "tangential_distortion": [3e-4, -5e-4],
}  # fmt: skip
FISHEYE: dict[str, Any] = {
    "type": "fisheye", "principal_point_px": [2010.0, 1490.0], "is_symmetric_affine": True,
    "affine": [4700.0, 0.0, 0.0, 4700.0], "polynomial": [0.0, 1.0, 0.0, -0.05], "is_p0_zero": True,
}  # fmt: skip

SEQUOIA: dict[str, Any] = FISHEYE | {"polynomial": [0.0, 1.0, 0.0152646, -0.161096]}
"""The polynomial of the specification's own examples (Parrot Sequoia in examples/input-cameras.json)."""


def turned(omega: float, phi: float, kappa: float) -> np.ndarray:
    """Return Rx(omega) Ry(phi) Rz(kappa), degrees."""
    (so, sp, sk), (co, cp, ck) = np.sin(np.radians([omega, phi, kappa])), np.cos(np.radians([omega, phi, kappa]))
    x = np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
    return np.asarray(x @ y @ z)


def seen(point: np.ndarray, centre: np.ndarray, angles: list[float], internals: dict[str, Any]) -> np.ndarray:
    """Return where a camera shows a point: the formulas of Pix4D's knowledge base, for y down and z forward."""
    x, y, z = np.diag([1.0, -1.0, -1.0]) @ turned(*angles).T @ (point - centre)
    assert z > 0.0
    u, v = x / z, y / z
    middle = np.array(internals["principal_point_px"])
    if internals["type"] == "fisheye":
        r = np.hypot(u, v)
        t = 2.0 / np.pi * np.arctan(r)
        rho = sum(value * t**n for n, value in enumerate(internals["polynomial"]))
        c, d, e, f = internals["affine"]
        return np.asarray(np.array([[c, d], [e, f]]) @ (rho / r * np.array([u, v])) + middle)
    (k1, k2, k3), (t1, t2) = internals["radial_distortion"], internals["tangential_distortion"]
    s = u * u + v * v
    radial = 1.0 + k1 * s + k2 * s**2 + k3 * s**3
    du, dv = 2.0 * t1 * u * v + t2 * (s + 2.0 * u * u), 2.0 * t2 * u * v + t1 * (s + 2.0 * v * v)
    return np.array([radial * u + du, radial * v + dv]) * internals["focal_length_px"] + middle


def processing_points() -> np.ndarray:
    rng = np.random.default_rng(4)
    middle = PLACE + SHIFT
    return middle + np.column_stack([rng.uniform(-40.0, 40.0, (12, 2)), rng.uniform(-6.0, 6.0, 12)])


def centres() -> np.ndarray:
    return PLACE + SHIFT + np.array([[0, 0, 100], [20, 5, 101], [-18, 10, 99], [4, -22, 102], [-9, -14, 98.0]])


def first_mark() -> np.ndarray:
    """Return where the first photo shows the first point."""
    return seen(processing_points()[0], centres()[0], ANGLES[0], PERSPECTIVE)


def documents(
    internals: dict[str, Any] = PERSPECTIVE, crs: str = "EPSG:25832", scale: float = 1.0, *, swaps: bool = False
) -> dict[str, Any]:
    """Return the documents of a project by their kinds; coordinates of the base system are those of the processing one.

    Points 0 to 6 are control points, 7 and 8 check points, 9 and 10 manual tie points, 11 one of the check.
    """
    before = internals | {"principal_point_px": [2000.0, 1500.0]}
    points, cameras = processing_points(), [FIRST_ID + n for n in range(len(ANGLES))]

    def marks(n: int) -> list[dict[str, Any]]:
        return [
            {"camera_id": key, "position_px": seen(points[n], centre, angles, internals).tolist(), "accuracy": 0.5}
            for key, centre, angles in zip(cameras, centres(), ANGLES, strict=True)
        ]

    def base(place: np.ndarray) -> list[float]:
        x, y, z = ((place - SHIFT) / scale).tolist()
        return [y, x, z] if swaps else [x, y, z]

    def gcp(n: int) -> dict[str, Any]:
        place = {"crs": {"definition": crs}, "coordinates": base(points[n]), "sigmas": [0.02, 0.03, 0.05]}
        return {"id": f"P{n}", "geolocation": place, "marks": marks(n), "is_checkpoint": n > 6}

    found: dict[str, Any] = {
        "camera-list": {"cameras": [{"id": key, "uri": f"images/DJI%20{n}.JPG"} for n, key in enumerate(cameras)]},
        "input-cameras": {
            "sensors": [{
                "id": SENSOR, "name": "FC6540", "bands": [], "image_size_px": [4000, 3000], "pixel_size_um": 2.5,
                "internals": before, "shutter_type": "global"}],
            "captures": [{
                "id": 100 + n, "reference_camera_id": key, "rig_model_source": "not_applicable",
                "time": "2020-09-25T09:12:53Z", "cameras": [{"id": key, "sensor_id": SENSOR}],
                "geolocation": {"crs": {"definition": crs}, "coordinates": base(centre), "sigmas": [0.02, 0.03, 0.05]}}
                for n, (key, centre) in enumerate(zip(cameras, centres(), strict=True))],
        },
        "projected-input-cameras": {
            "sensors": [],
            "captures": [{
                "id": 100 + n, "geolocation": {"position": centre.tolist(), "sigmas": [0.02, 0.03, 0.05]},
                "orientation": {"angles_deg": angles, "sigmas_deg": [2.0, 3.0, 5.0]}}
                for n, (centre, angles) in enumerate(zip(centres(), ANGLES, strict=True))],
        },
        "scene-reference-frame": {
            "crs": {"definition": crs},
            "base_to_canonical": {"shift": SHIFT, "scale": [scale] * 3, "swap_xy": swaps},
        },
        "input-control-points": {
            "gcps": [gcp(n) for n in range(9)],
            "mtps": [{"id": f"P{n}", "marks": marks(n), "is_checkpoint": n == 11} for n in range(9, 12)],
        },
        "projected-control-points": {"projected_gcps": [
            {"id": f"P{n}", "coordinates": points[n].tolist(), "sigmas": [0.02, 0.03, 0.05]} for n in range(9)]},
        "calibrated-cameras": {
            "sensors": [{"id": SENSOR, "internals": internals}],
            "cameras": [
                {"id": key, "sensor_id": SENSOR, "position": centre.tolist(), "orientation_deg": angles}
                for key, centre, angles in zip(cameras, centres(), ANGLES, strict=True)],
        },
        "calibrated-control-points": {"points": [
            {"id": f"P{n}", "coordinates": points[n].tolist()} for n in range(12)]},
        "constraints": {
            "scale_constraints": [{
                "id": "bar", "id_from": "P0", "id_to": "P1", "sigma": 0.01,
                "distance": float(np.linalg.norm(points[1] - points[0]))}],
            "orientation_constraints": [],
        },
    }  # fmt: skip
    return {kind: {"format": f"application/opf-{kind}+json", "version": "1.0"} | one for kind, one in found.items()}


ITEMS = {"calibrated-cameras": "calibration", "calibrated-control-points": "calibration"}


def track_points() -> np.ndarray:
    """Return points about the middle of the block, in numbers that single precision has."""
    rng = np.random.default_rng(5)
    places = np.column_stack([rng.uniform(-40.0, 40.0, (20, 2)), rng.uniform(-6.0, 6.0, 20)])
    return places.astype(np.float32).astype(np.float64)


def write_tracks(folder: Path, change: Callable[[Any], object] = lambda _: None) -> None:
    """Write the points of tracks with their matches in all photos but the first for odd ones, last point first."""
    middle = PLACE + SHIFT
    points, ranges, cameras, images = track_points(), np.zeros((20, 2), dtype="<u4"), [], []
    for n in reversed(range(20)):
        photos = range(n % 2, len(ANGLES))
        packed = len(cameras) | len(photos) << 40
        ranges[n] = packed & 0xFFFFFFFF, packed >> 32
        cameras += list(photos)
        images += [seen(points[n] + middle, centres()[photo], ANGLES[photo], PERSPECTIVE) for photo in photos]
    arrays: list[tuple[np.ndarray, str]] = [
        (points.astype("<f4"), "VEC3"), (np.array(cameras, dtype="<u4"), "SCALAR"), (ranges, "VEC2"),
        (np.array(images, dtype="<f4"), "VEC2"),
    ]  # fmt: skip
    data = [b"\0" * 8 + array.tobytes() for array, _ in arrays]
    x, y, z = middle.tolist()
    extension = {"cameraUids": [FIRST_ID + n for n in range(5)], "cameraIds": 1, "pointIndexRanges": 2,
                 "imagePoints": {"pixelCoordinates": 3}}  # fmt: skip
    document = {
        "asset": {"version": "2.0", "extensions": {"OPF_asset_version": {"version": "1.0"}}},
        "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "matrix": [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, x, z, -y, 1]}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0}, "mode": 0, "extensions": {"OPF_mesh_primitive_matches": extension}}]}],
        "accessors": [
            {"bufferView": n, "count": len(array), "type": kind, "componentType": 5126 if n in (0, 3) else 5125}
            for n, (array, kind) in enumerate(arrays)],
        "bufferViews": [{"buffer": n, "byteOffset": 8, "byteLength": len(part) - 8} for n, part in enumerate(data)],
        "buffers": [{"uri": f"array%20{n}.bin", "byteLength": len(part)} for n, part in enumerate(data)],
    }  # fmt: skip
    change(document)
    written(folder / "tracks.gltf", json.dumps(document, indent=1))
    for n, part in enumerate(data):
        (folder / f"array {n}.bin").write_bytes(part)


def tracked_folder(folder: Path) -> Path:
    """Write a project with tie tracks and return its file."""
    write_tracks(folder)
    return project_folder(folder, has_tracks=True)


def project_folder(folder: Path, found: dict[str, Any] | None = None, *, has_tracks: bool = False) -> Path:
    """Write a project and return its file."""
    parts = documents() if found is None else found
    for kind, document in parts.items():
        written(folder / "opf files" / f"{kind}.json", json.dumps(document, indent=1))
    items = [
        {"id": kind, "type": ITEMS.get(kind, kind.replace("-", "_")), "sources": [], "resources": [
            {"uri": f"opf%20files/{kind}.json", "format": f"application/opf-{kind}+json"}]}
        for kind in parts
    ]  # fmt: skip
    for kind in ["point_cloud", *(["calibration"] if has_tracks else [])]:
        uri = "tracks.gltf" if kind == "calibration" else "dense.gltf"
        items.append({"id": uri, "type": kind, "sources": [], "resources": [
            {"uri": uri, "format": "model/gltf+json"}]})  # fmt: skip
    head = {"format": "application/opf-project+json", "version": "1.0", "id": "1", "name": "Block", "description": ""}
    return written(folder / "project.opf", json.dumps(head | {"items": items}, indent=1))


@pytest.mark.parametrize("internals", [PERSPECTIVE, FISHEYE, SEQUOIA])
@pytest.mark.parametrize(("scale", "swaps"), [(1.0, False), (1.0, True), (0.25, False)])
def test_marks_are_where_the_project_shows_its_points(
    tmp_path: Path, internals: dict[str, Any], scale: float, swaps: bool
) -> None:
    path = project_folder(tmp_path, documents(internals, scale=scale, swaps=swaps))
    assert guessed_source(path)[0].name == guessed_source(tmp_path)[0].name == "opf"
    project = read_well(read_opf, path)
    assert [photo.name for photo in project.photos] == [f"images/DJI {n}.JPG" for n in range(5)]
    assert len(project.rays.photo) == 55
    assert project.rays.deviation.tolist() == [0.5] * 55
    found, is_declared = reprojected(project)
    assert is_declared
    assert found.rms < 1e-6
    ground = (processing_points() - SHIFT) / scale
    np.testing.assert_allclose(project.points.coordinates, ground[:11], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose([point.coordinates for point in project.control], ground[:9], rtol=0.0, atol=1e-8)
    assert (project.crs, project.ground_unit) == ("EPSG:25832", "m")


def test_control_and_stations_have_the_deviations_of_the_project(tmp_path: Path) -> None:
    project = read_well(read_opf, project_folder(tmp_path))
    assert project.checks == {"P7", "P8"}
    errors = {point.name: point.errors for point in project.control}
    assert errors["P0"] == (0.02, 0.03, 0.05)
    assert errors["P8"] == (-0.02, -0.03, -0.05)
    assert [station.position_error for station in project.stations] == [(0.02, 0.03, 0.05)] * 5
    np.testing.assert_allclose([station.position for station in project.stations], centres() - SHIFT, atol=1e-8)
    np.testing.assert_allclose(np.degrees([station.angles for station in project.stations]), ANGLES, atol=1e-12)
    np.testing.assert_allclose(np.degrees(project.stations[0].angle_error), [2.0, 3.0, 5.0], atol=1e-12)
    (bar,) = project.distances
    assert (bar.start, bar.end, bar.error) == ("P0", "P1", 0.01)
    assert project.points.names == tuple(f"P{n}" for n in range(11))
    assert set(project.cameras[0].free) == {"cx", "cy"}
    assert project.cameras[0].sensor_mm == pytest.approx((10.0, 7.5))
    assert project.notes == (
        "The project has no tie points: only the marks of control and manual tie points.",
        "The format gives the accuracy of a mark no unit: pixels are read for 55 marks.",
        "1 manual tie point for checks alone, left out.",
    )


@pytest.mark.parametrize("swaps", [False, True])
def test_without_projected_coordinates_those_of_the_base_system_are_used(tmp_path: Path, swaps: bool) -> None:
    whole = documents(swaps=swaps)
    given = read_well(read_opf, project_folder(tmp_path / "a", whole))
    for kind in ("projected-input-cameras", "projected-control-points"):
        del whole[kind]
    found = read_well(read_opf, project_folder(tmp_path / "b", whole))
    for one in (given, found):
        assert (len(one.control), len(one.stations)) == (9, 5)
    for name in ("control", "stations"):
        pairs = zip(getattr(given, name), getattr(found, name), strict=True)
        places = [(a.coordinates, b.coordinates) if name == "control" else (a.position, b.position) for a, b in pairs]
        np.testing.assert_allclose(*np.array(places).transpose(1, 0, 2), rtol=0.0, atol=1e-8)
    assert found.control[0].errors == ((0.03, 0.02, 0.05) if swaps else (0.02, 0.03, 0.05))


def test_places_in_another_system_are_counted(tmp_path: Path) -> None:
    whole = documents()
    for kind in ("projected-input-cameras", "projected-control-points"):
        del whole[kind]
    whole["scene-reference-frame"]["crs"]["definition"] = "EPSG:25833"
    notes = " ".join(read_well(read_opf, project_folder(tmp_path, whole)).notes)
    assert "9 control points in another system than the scene, left out" in notes
    assert "5 positions of photos in another system than the scene, left out" in notes


def test_feet_are_the_unit_of_a_system_in_feet(tmp_path: Path) -> None:
    found = documents(crs="EPSG:6434")
    assert read_well(read_opf, project_folder(tmp_path, found)).ground_unit == "US survey foot"


def test_photos_that_are_not_calibrated_are_counted(tmp_path: Path) -> None:
    found = documents()
    found["calibrated-cameras"]["cameras"].pop()
    found["calibrated-cameras"]["cameras"][0]["rolling_shutter"] = [0.0, 0.0, 0.1]
    project = read_well(read_opf, project_folder(tmp_path, found))
    assert (len(project.photos), len(project.stations), len(project.rays.photo)) == (4, 4, 44)
    notes = " ".join(project.notes)
    for said in ("rolling shutter of 1 photo", "11 marks in photos not calibrated", "1 photo not calibrated"):
        assert said in notes


def test_a_fisheye_of_the_examples_of_the_specification_is_fitted() -> None:
    """Sensor 18493134 of examples/input-cameras.json and calibrated-cameras.json: 1280 x 960 px of 3.75 micrometres."""
    turn, terms = 2.0 / np.pi, SEQUOIA["polynomial"]
    plane = {"fx": 1676.296432 * turn, "fy": 1676.296432 * turn, "cx": 634.45, "cy": 481.23}
    powers = {"q1": terms[2] * turn, "q2": terms[3] * turn**2}
    camera = ExchangedCamera("Sequoia", 1280, 960, "angle_polynomial", plane | powers, sensor_mm=(4.8, 3.6))
    converted = convert_camera(camera, "C")
    assert converted.camera.projection == "equidistant"
    assert 0.0 < converted.worst_px < 0.06  # the term of the second power is no odd one
    without = replace(camera, parameters=plane | {"q2": powers["q2"]})
    assert convert_camera(without, "C").is_exact


@pytest.mark.parametrize(
    "internals", [FISHEYE | {"polynomial": [0.1, 1.0, 0.015, -0.16]}, {**FISHEYE, "type": "spherical"}]
)
def test_a_camera_that_has_no_equal_is_refused_by_name(tmp_path: Path, internals: dict[str, Any]) -> None:
    found = documents()
    found["calibrated-cameras"]["sensors"][0]["internals"] = internals
    said = orip(tmp_path, "import", str(project_folder(tmp_path / "a", found)), "new")
    assert said.code == 3
    assert f"{internals['type']} of Pix4D" in said.err


FAULTS: list[tuple[Callable[[Any], object], str]] = [
    (lambda d: d["calibrated-cameras"]["cameras"].clear(), "no photo is calibrated"),
    (lambda d: d.pop("calibrated-cameras"), "the project has no calibrated_cameras"),
    (lambda d: d["calibrated-cameras"]["sensors"].clear(), f"there is no calibrated sensor {SENSOR}"),
    (lambda d: d["camera-list"]["cameras"].pop(0), f"there is no camera {FIRST_ID} in camera_list"),
    (lambda d: d["camera-list"]["cameras"][0].update(uri="images/DJI%201.JPG"), "is that of another camera, too"),
    (lambda d: d["input-cameras"]["sensors"].clear(), f"there is no sensor {SENSOR} in input_cameras"),
    (lambda d: d["calibrated-cameras"]["cameras"][0].update(id=-1), "a whole number from 0 to 18446744073709551615"),
    (lambda d: d["calibrated-cameras"]["cameras"][1].update(id=FIRST_ID), f"id {FIRST_ID} is there twice"),
    (lambda d: d["calibrated-cameras"].update(version="2.0"), "version '2.0' is not read"),
    (lambda d: d["calibrated-cameras"].update(format="text"), "not 'text'"),
    (lambda d: d["scene-reference-frame"]["crs"].update(definition="EPSG:4326"), "in longitude and latitude"),
    (lambda d: d["scene-reference-frame"]["crs"].update(definition="nothing"), "is not known to PROJ"),
    (lambda d: d["scene-reference-frame"]["base_to_canonical"].update(scale=[1, 0, 1]), "two equal scales"),
    (lambda d: d["input-control-points"]["mtps"][0].update(id="P0"), "a control point of this name is there already"),
    (
        lambda d: d["calibrated-cameras"]["sensors"][0]["internals"].update(focal_length_px=0),
        "the focal length has to be above 0",
    ),
]


@pytest.mark.parametrize(("change", "message"), FAULTS)
def test_what_is_wrong_in_a_project_is_said(tmp_path: Path, change: Callable[[Any], object], message: str) -> None:
    found = json.loads(json.dumps(documents()))
    change(found)
    said = orip(tmp_path, "import", str(project_folder(tmp_path / "a", found)), "new")
    assert said.code == 3
    assert message in " ".join(said.err.split())


def test_tie_tracks_are_where_the_project_shows_them(tmp_path: Path) -> None:
    project = read_well(read_opf, tracked_folder(tmp_path))
    assert list(project.points.tracks) == [str(n) for n in range(20)]
    places = project.points.coordinates[project.points.is_track]
    np.testing.assert_allclose(places, track_points() + PLACE, rtol=0.0, atol=1e-8)
    rows = np.flatnonzero(project.points.is_track[project.rays.point])
    assert len(rows) == 90
    pairs = {(int(project.rays.point[row]), int(project.rays.photo[row])) for row in rows}
    assert pairs == {(n, photo) for n in range(20) for photo in range(n % 2, 5)}
    for row in rows.tolist():
        photo = int(project.rays.photo[row])
        point = project.points.coordinates[project.rays.point[row]] + SHIFT
        shown = seen(point, centres()[photo], ANGLES[photo], PERSPECTIVE)
        # a pixel of single precision below 4096 is rounded by at most 2^-13; the place by a millionth of this
        np.testing.assert_allclose(project.rays.image[row], shown, rtol=0.0, atol=2.0**-13 + 1e-6)
    assert not any("tie points" in note for note in project.notes)


TRACK_FAULTS: list[tuple[Callable[[Any], object], str]] = [
    (lambda d: d["accessors"][0].update(count=21), "has 248 bytes, 260 are needed"),
    (lambda d: d["accessors"][1].update(count=89), "do not fit one another"),
    (lambda d: d["accessors"][2].update(type="SCALAR"), "a packed array of VEC2 of component type 5125"),
    (lambda d: d["nodes"][0].update(mesh=1), "the number of one of meshes should be here"),
    (lambda d: d["buffers"][3].update(uri="absent.bin"), "there is no such file"),
    (lambda d: d["asset"]["extensions"]["OPF_asset_version"].update(version="1.0-draft7"), "'1.0-draft7' is not read"),
]


@pytest.mark.parametrize(("change", "message"), TRACK_FAULTS)
def test_what_is_wrong_with_tracks_is_said(tmp_path: Path, change: Callable[[Any], object], message: str) -> None:
    write_tracks(tmp_path / "a", change)
    said = orip(tmp_path, "import", str(project_folder(tmp_path / "a", has_tracks=True)), "new")
    assert said.code == 3
    assert message in " ".join(said.err.split())


def test_tracks_in_photos_that_are_not_calibrated_are_counted(tmp_path: Path) -> None:
    found = documents()
    found["calibrated-cameras"]["cameras"].pop()
    write_tracks(tmp_path)
    project = read_well(read_opf, project_folder(tmp_path, found, has_tracks=True))
    assert len(project.rays.photo) == 70 + 44
    assert "20 measurements of tie points in photos not calibrated, left out." in project.notes


@pytest.mark.parametrize("files", [project_folder, tracked_folder])
def test_a_project_is_adjusted(tmp_path: Path, files: Callable[[Path], Path]) -> None:
    source = files(tmp_path / "a")
    assert orip(tmp_path, "import", str(source), "new").code == 0
    done = orip(tmp_path / "new", "run", "--no-report")
    assert done.code == 0, done.err
    assert "could not be determined" not in done.out
