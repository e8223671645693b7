"""What is imported, written and imported again is the same; what has not changed stays as it was."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conversion.exchanged_blocks import block
from exchange import test_metashape, test_opensfm
from exchange.imported import read_well, reprojected, sample, with_frame
from reference.published_data import data_set

from orip.errors import InputError
from orip.exchange.conversion.cameras import convert_camera, export_camera, pixels_of_directions
from orip.exchange.conversion.image_axes import UnsuitableCameraError
from orip.exchange.conversion.poses import exchanged_poses, orip_poses
from orip.exchange.format import Conventions
from orip.exchange.formats import FORMATS, format_named
from orip.exchange.metashape.source import read_metashape
from orip.exchange.metashape.writer import write_metashape
from orip.exchange.micmac.source import read_micmac
from orip.exchange.micmac.writer import write_micmac
from orip.exchange.opensfm.source import read_opensfm
from orip.exchange.opensfm.writer import write_opensfm
from orip.exchange.sources.xml_tree import XmlEdit
from orip.exchange.vision.bundler import read_bal, write_bal
from orip.records.camera import Camera
from orip.records.control import ControlPoint
from orip.records.exchanged import ExchangedCamera, ExchangedProject, ExchangedRays, PoseReading
from orip.structs import replace

LENS = ExchangedCamera(
    "Lens 1", 4000, 3000, "opencv",
    {"fx": 3000.0, "fy": 3000.0, "cx": 2010.0, "cy": 1490.0,
     "k1": -0.1, "k2": 0.02, "k3": -0.003, "p1": 1e-4, "p2": -2e-4},
    sensor_mm=(24.0, 18.0),
)  # fmt: skip
READING = PoseReading("y_up", "to_ground", "matrix", "radian", "centre")


def in_conventions(conventions: Conventions) -> ExchangedProject:
    """Return a block with a real lens and control in the conventions of a format.

    Measurements are made with the lens, and corrected for what the format has no place for.
    """
    given = replace(block(READING), cameras=(LENS,))
    camera = convert_camera(LENS, "C").camera
    assert conventions.lens is not None
    exported = export_camera(
        camera, LENS.name, conventions.lens, conventions.lens_axes, conventions.ray_axes,
        terms=conventions.terms, accepts_any_fit=True,
    )  # fmt: skip
    rotations, centres = orip_poses(given.photos, READING)
    numbers, positions = exchanged_poses(rotations, centres, conventions.reading)
    photos = [
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        for n, photo in enumerate(given.photos)
    ]
    rays = given.rays
    seen = np.einsum("nji,nj->ni", rotations[rays.photo], given.points.coordinates[rays.point] - centres[rays.photo])
    pixels = pixels_of_directions(camera, seen[:, :2] / -seen[:, 2:])
    inside = (np.abs(pixels - [2000.0, 1500.0]) < [2000.0, 1500.0]).all(axis=1)  # the formula has no sense outside
    image = exported.rays_of_pixels(pixels[inside], corrects_distortion=True)
    shift = exported.principal_point if conventions.counts_from_principal_point else np.zeros(2)
    return replace(
        given,
        cameras=(exported.about_principal_point() if conventions.counts_from_principal_point else exported.camera,),
        photos=tuple(photos),
        rays=ExchangedRays(
            rays.photo[inside], rays.point[inside], image - shift, rays.deviation[inside], rays.is_active[inside]
        ),
        readings=(conventions.reading,),
        control=(ControlPoint("A & B", (1.0, 2.0, None), (-0.5, -0.5, None)),),
    )


BOTH_WAYS = [
    found.name
    for found in FORMATS
    if found.read is not None and found.conventions is not None and found.conventions.lens is not None
]
DIGITS = {"patb": 5e-5}
"""Of orientations, where a format has fixed decimals: five of a projection centre 100 units above."""
ORIENTATIONS_ALONE = ("micmac", "metashape")


@pytest.mark.parametrize("name", BOTH_WAYS)
def test_what_is_written_is_read_again(tmp_path: Path, name: str) -> None:
    found = format_named(name)
    assert found.write is not None
    assert found.read is not None
    assert found.conventions is not None
    given = in_conventions(found.conventions)
    files = found.write(given, None)
    for file, data in files.items():
        (tmp_path / file).write_bytes(data)
    source = tmp_path / next(iter(files)) if found.is_file or name == "bundler" else tmp_path
    assert found.recognises(source)
    again = read_well(found.read, source)
    if not again.cameras[0].columns:
        again = with_frame(again, LENS.columns, LENS.rows)
    # BAL has no names; its photos are in order
    place = {photo.name: n for n, photo in enumerate(again.photos)} if name != "bal" else {}
    order = [place.get(photo.name, n) for n, photo in enumerate(given.photos)]
    for expected, seen in zip(
        orip_poses(given.photos, given.readings[0]), orip_poses(again.photos, again.readings[0]), strict=True
    ):
        assert seen[order] == pytest.approx(expected, abs=DIGITS.get(name, 1e-10))
    if given.cameras[0].ray_axes.unit == "pixel":
        expected_camera, camera = (convert_camera(one.cameras[0], "C").camera for one in (given, again))
        assert _at_edge(camera) == pytest.approx(_at_edge(expected_camera), abs=1e-7)
    if name in ORIENTATIONS_ALONE:
        return
    assert len(again.rays.photo) == len(given.rays.photo)
    reprojection, _ = reprojected(again)
    assert reprojection.rms < (0.005 if name in DIGITS else 1e-6)


def test_points_and_control_are_read_again(tmp_path: Path) -> None:
    for name in ("opensfm", "blocks"):
        found = format_named(name)
        assert found.write is not None
        assert found.read is not None
        assert found.conventions is not None
        given = in_conventions(found.conventions)
        files = found.write(given, None)
        (tmp_path / name).mkdir()
        for file, data in files.items():
            (tmp_path / name / file).write_bytes(data)
        again = read_well(found.read, tmp_path / name / next(iter(files)) if found.is_file else tmp_path / name)
        read = {tuple(xyz) for xyz in again.points.coordinates[again.points.is_track].tolist()}
        assert read >= {tuple(xyz) for xyz in given.points.coordinates[given.rays.point].tolist()}
        if name == "opensfm":
            assert again.rays.image == pytest.approx(given.rays.image, abs=1e-9)
        else:
            assert again.control[0].name == "A & B"
            assert again.control[0].coordinates == (1.0, 2.0, None)
            assert again.control[0].errors == (-0.5, -0.5, None)
            # the file goes from point to point
            expected, read_rays = (np.array(sorted(one.rays.image.tolist())) for one in (given, again))
            assert read_rays == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", ["bundler", "bal", "nvm", "bingo", "patb"])
def test_a_camera_that_a_format_does_not_hold_is_refused_by_name(name: str) -> None:
    conventions = format_named(name).conventions
    assert conventions is not None
    assert conventions.lens is not None
    camera = convert_camera(replace(LENS, parameters={**LENS.parameters, "p1": 2e-3}), "K1").camera
    with pytest.raises(UnsuitableCameraError, match=r"camera K1: .* --exact-distortion"):
        export_camera(
            camera, "K1", conventions.lens, conventions.lens_axes, conventions.ray_axes, terms=conventions.terms
        )


def control_block(conventions: Conventions) -> ExchangedProject:
    """Return a block whose first points are control and check points, and whose photos have long names."""
    given = in_conventions(conventions)
    names = ("A 1", "check-point", *given.points.names[2:])
    is_track = given.points.is_track.copy()
    is_track[:2] = False
    control = (
        ControlPoint("A 1", (1.0, 2.0, 3.0), (0.01, 0.01, 0.02)),
        ControlPoint("check-point", (4.0, 5.0, 6.0), (-0.03, -0.03, -0.05)),
    )
    photos = tuple(replace(photo, name=f"DJI_20260101_{n} east.JPG") for n, photo in enumerate(given.photos))
    return replace(given, points=replace(given.points, names=names, is_track=is_track), photos=photos, control=control)


@pytest.mark.parametrize("name", ["bingo", "patb"])
def test_names_that_a_format_cannot_have_come_back_from_a_table(tmp_path: Path, name: str) -> None:
    found = format_named(name)
    assert found.write is not None
    assert found.read is not None
    assert found.conventions is not None
    given = control_block(found.conventions)
    for file, data in found.write(given, None).items():
        (tmp_path / file).write_bytes(data)
    again = read_well(found.read, tmp_path)
    assert [photo.name for photo in again.photos] == [photo.name for photo in given.photos]
    assert {"A 1", "check-point"} <= set(again.points.names)
    first = again.control[0]
    assert (first.name, first.coordinates) == ("A 1", (1.0, 2.0, 3.0))
    if name == "bingo":
        assert first.errors == (0.01, 0.01, 0.02)
        assert again.control[1].errors == (-0.03, -0.03, -0.05)
        assert "T5" in again.points.names
    else:
        assert len(again.control) == 1  # PAT-B has no check points


def test_several_cameras_are_refused_by_the_writer_of_patb() -> None:
    found = format_named("patb")
    assert found.write is not None
    assert found.conventions is not None
    given = in_conventions(found.conventions)
    with pytest.raises(InputError, match="have one camera, and here are 2"):
        found.write(replace(given, cameras=given.cameras * 2), None)


def test_names_with_blanks_are_read_from_the_list_of_bundler(tmp_path: Path) -> None:
    found = format_named("bundler")
    assert found.write is not None
    assert found.conventions is not None
    given = in_conventions(found.conventions)
    photos = tuple(replace(photo, name=f"left side/{photo.name}") for photo in given.photos)
    for file, data in found.write(replace(given, photos=photos), None).items():
        (tmp_path / file).write_bytes(data)
    assert found.read is not None
    again = read_well(found.read, tmp_path / "bundle.out")
    assert [photo.name for photo in again.photos] == [photo.name for photo in photos]


def test_a_copy_of_a_problem_keeps_its_order_and_its_measurements() -> None:
    path = data_set("bal") / "problem-49-7776-pre.txt"
    project = read_well(read_bal, path)
    cameras = tuple(
        replace(camera, lens="agisoft", parameters={"f": camera.parameters["fx"],
                                                    "k1": camera.parameters["k1"], "k2": camera.parameters["k2"]})
        for camera in project.cameras
    )  # fmt: skip
    given = replace(project, cameras=cameras)
    # values print with other digits than repr has; no line is changed that still says the same
    assert write_bal(given, path)["problem.txt"] == path.read_bytes()
    moved = (replace(given.photos[3], position=(1.0, 2.0, 3.0)), *reversed(given.photos[:3]), *given.photos[4:])
    after = write_bal(replace(given, photos=moved), path)["problem.txt"].split(b"\n")
    before = path.read_bytes().split(b"\n")
    changed = [n for n, (one, other) in enumerate(zip(before, after, strict=True)) if one != other]
    first = 1 + len(project.rays.photo) + 3 * 9 + 3
    assert changed == [first, first + 1, first + 2]
    assert after[first] == b"1.0"


def _at_edge(camera: Camera) -> np.ndarray:
    return pixels_of_directions(camera, np.array([[0.6, 0.4], [-0.6, 0.4], [-0.3, -0.45], [0.0, 0.0]]))


def test_a_copy_of_opensfm_keeps_what_has_not_changed(tmp_path: Path) -> None:
    folder = test_opensfm.project_folder(tmp_path)
    before = (folder / "reconstruction.json").read_bytes()
    project = read_well(read_opensfm, folder)
    assert write_opensfm(project, folder)["reconstruction.json"] == before
    moved = replace(project.photos[0], position=(1.0, 2.0, 3.0))
    covariance = np.broadcast_to(np.eye(3) * 0.25, (len(project.points.names), 3, 3))
    kept = np.arange(1, len(project.points.names))
    points = replace(
        project.points,
        names=project.points.names[1:],
        coordinates=project.points.coordinates[kept],
        is_track=project.points.is_track[kept],
        covariance=covariance[kept],
    )
    changed = replace(project, photos=(moved, *project.photos[1:]), points=points)
    after = json.loads(write_opensfm(changed, folder)["reconstruction.json"])[1]
    original = json.loads(before)[1]
    assert after["shots"]["0.jpg"]["translation"] == [1.0, 2.0, 3.0]
    assert after["shots"]["1.jpg"] == original["shots"]["1.jpg"]
    assert after["cameras"] == original["cameras"]
    assert sorted(after["points"]) == sorted(set(original["points"]) - {"0"})
    assert after["points"]["1"]["covariance"] == [[0.25, 0.0, 0.0], [0.0, 0.25, 0.0], [0.0, 0.0, 0.25]]
    assert after["points"]["1"]["color"] == [1.0, 2.0, 3.0]


FISHEYE = ExchangedCamera(
    "Fish 1", 4000, 3000, "equidistant",
    {"fx": 1503.0, "fy": 1500.0, "cx": 2010.0, "cy": 1490.0, "k1": 0.04, "k2": -0.012, "k3": 0.006, "k4": -0.0014},
    sensor_mm=(24.0, 18.0),
)  # fmt: skip


@pytest.mark.parametrize("name", ["opensfm", "metashape", "alicevision"])
def test_a_fisheye_is_written_and_read_again(tmp_path: Path, name: str) -> None:
    found = format_named(name)
    assert found.write is not None
    assert found.read is not None
    assert found.conventions is not None
    conventions = found.conventions
    assert conventions.fisheye_lens is not None
    camera = convert_camera(FISHEYE, "C").camera
    exported = export_camera(camera, "Fish 1", conventions.fisheye_lens, conventions.lens_axes, conventions.ray_axes)
    assert exported.worst_px == 0.0
    given = replace(in_conventions(conventions), cameras=(exported.camera,))
    files = found.write(given, None)
    for file, data in files.items():
        (tmp_path / file).write_bytes(data)
    source = tmp_path / next(iter(files)) if found.is_file else tmp_path
    again = convert_camera(read_well(found.read, source).cameras[0], "C")
    assert again.is_exact
    wide = np.array([[3.0, 1.0], [-1.0, 2.5], [0.0, 0.0], [0.2, -0.1]])
    assert pixels_of_directions(again.camera, wide) == pytest.approx(pixels_of_directions(camera, wide), abs=1e-8)


def test_formats_without_fisheyes_refuse_them_by_name() -> None:
    camera = convert_camera(FISHEYE, "K1").camera
    for name in ("micmac", "blocks"):
        conventions = format_named(name).conventions
        assert conventions is not None
        assert conventions.lens is not None
        assert conventions.fisheye_lens is None
        with pytest.raises(UnsuitableCameraError, match="camera K1 has a fisheye lens"):
            export_camera(camera, "1", conventions.lens, conventions.lens_axes, conventions.ray_axes)


def test_fisheyes_of_opensfm_stay_what_they_are(tmp_path: Path) -> None:
    folder = test_opensfm.project_folder(tmp_path)
    document = json.loads((folder / "reconstruction.json").read_text())
    fisheye = {"projection_type": "fisheye", "width": 4000, "height": 3000, "focal": 0.4, "k1": 0.02, "k2": -0.01}
    document[1]["cameras"]["cam"] = fisheye
    (folder / "reconstruction.json").write_text(json.dumps(document))
    project = read_well(read_opensfm, folder)
    assert json.loads(write_opensfm(project, folder)["reconstruction.json"]) == document
    bent = replace(project.cameras[0], parameters={**project.cameras[0].parameters, "k3": 0.001})
    written = json.loads(write_opensfm(replace(project, cameras=(bent,)), folder)["reconstruction.json"])
    assert written[1]["cameras"]["cam"]["projection_type"] == "fisheye_opencv"
    assert written[1]["cameras"]["cam"]["k3"] == 0.001


def test_shots_of_opensfm_have_their_precision(tmp_path: Path) -> None:
    folder = test_opensfm.project_folder(tmp_path)
    project = read_well(read_opensfm, folder)
    covariance = (1.0, 0.1, 0.2, 0.1, 2.0, 0.3, 0.2, 0.3, 3.0)
    pose = tuple(float(n) for n in range(36))
    precise = replace(
        project.photos[0], position_covariance=covariance, pose_covariance=pose, angle_deviation=(0.1, 0.2, 0.3)
    )
    for original in (folder, None):
        files = write_opensfm(replace(project, photos=(precise, *project.photos[1:])), original)
        shots = json.loads(files["reconstruction.json"])[-1]["shots"]
        assert shots["0.jpg"]["position_covariance"] == [[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]]
        assert shots["0.jpg"]["omega_phi_kappa_sd"] == [0.1, 0.2, 0.3]
        # by rows, as OpenSfM's reader takes an array of 6 by 6
        assert np.ravel(shots["0.jpg"]["covariance"]).tolist() == list(pose)
        assert "position_covariance" not in shots["1.jpg"]


def test_a_copy_of_metashape_changes_the_numbers_alone(tmp_path: Path) -> None:
    text = test_metashape.document(block(test_metashape.READING))
    path = tmp_path / "cameras.xml"
    path.write_text(text, encoding="utf-8")
    project = read_well(read_metashape, path)
    assert write_metashape(project, path)["cameras.xml"] == path.read_bytes()
    assert write_metashape(project, tmp_path)["cameras.xml"] == path.read_bytes()
    moved = replace(project.photos[1], position=(1.0, 2.0, 3.0), position_covariance=(4.0, 0, 0, 0, 4.0, 0, 0, 0, 4.0))
    camera = replace(project.cameras[0], parameters={**project.cameras[0].parameters, "f": 3001.0, "k1": 0.25})
    changed = replace(project, photos=(project.photos[0], moved, *project.photos[2:]), cameras=(camera,))
    after = write_metashape(changed, path)["cameras.xml"]
    before, lines = text.split("\n"), after.decode().split("\n")
    assert len(before) == len(lines)
    # the calibration is on one line and its end on the next, each camera has a line
    assert [n for n, line in enumerate(lines) if line != before[n]] == [4, 5, 8]
    assert "<f>3001.0</f>" in lines[4]
    assert lines[5].startswith("<k1>0.25</k1></calibration>")
    path.write_bytes(after)
    again = read_well(read_metashape, path)
    assert again.photos[1].position == pytest.approx((1.0, 2.0, 3.0), abs=1e-12)
    assert again.photos[1].position_deviation == pytest.approx((2.0, 2.0, 2.0))
    assert again.cameras[0].parameters["k1"] == 0.25


def test_labels_that_repeat_are_not_written(tmp_path: Path) -> None:
    text = test_metashape.document(block(test_metashape.READING))
    path = tmp_path / "cameras.xml"
    path.write_text(text.replace('label="1.jpg"', 'label="0.jpg"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"label '0\.jpg' is that of several"):
        write_metashape(read_well(read_metashape, path), path)


def test_terms_without_a_place_are_refused() -> None:
    found = format_named("blocks")
    assert found.write is not None
    assert found.conventions is not None
    given = in_conventions(found.conventions)
    camera = replace(given.cameras[0], parameters={**given.cameras[0].parameters, "b1": 0.5})
    with pytest.raises(InputError, match="no place for its terms b1"):
        found.write(replace(given, cameras=(camera,)), None)


def test_formats_that_are_written_say_how() -> None:
    for found in FORMATS:
        assert (found.write is None) == (found.conventions is None), found.name


def _as_micmac(project: ExchangedProject) -> ExchangedProject:
    """Return a project as an export has it that nothing was adjusted in: through orip's cameras and poses and back."""
    found = format_named("micmac").conventions
    assert found is not None
    assert found.lens is not None
    cameras = [convert_camera(camera, "C").camera for camera in project.cameras]
    exported = [
        export_camera(camera, source.name, found.lens, found.lens_axes, found.ray_axes).camera
        for camera, source in zip(cameras, project.cameras, strict=True)
    ]
    numbers, positions = exchanged_poses(*orip_poses(project.photos, project.readings[0]), found.reading)
    photos = [
        replace(photo, rotation=tuple(numbers[n].tolist()), position=tuple(positions[n].tolist()))
        for n, photo in enumerate(project.photos)
    ]
    return replace(project, cameras=tuple(exported), photos=tuple(photos))


def test_a_copy_of_micmac_changes_the_numbers_alone() -> None:
    folder = sample("micmac", "MMVII-TestDir", "Input", "Saisies-MMV1", "Ori-Ground_mm3d")
    project = _as_micmac(read_well(read_micmac, folder))
    moved = replace(project.photos[0], position=(1.0, 2.0, 3.0), position_deviation=(0.1, 0.2, 0.3))
    files = write_micmac(replace(project, photos=(moved, *project.photos[1:])), folder)
    name = "Orientation-IMGP4167.JPG.xml"
    before = (folder / name).read_text()
    begin, end = before.index("<Verif>"), before.index("</Verif>") + len("</Verif>")
    old = before.replace(before[begin:end], "")
    for tag, text in (("Centre", "1.0 2.0 3.0"), ("IncCentre", "0.1 0.2 0.3")):
        begin, end = old.index(f"<{tag}>"), old.index(f"</{tag}>")
        old = f"{old[:begin]}<{tag}>{text}{old[end:]}"
    assert files[name].decode() == old
    assert {other for other in files if files[other] != (folder / other).read_bytes()} == {name}
    wider = replace(project.cameras[0], parameters={**project.cameras[0].parameters, "p1": 1e-7})
    files = write_micmac(replace(project, cameras=(wider,)), folder)
    # radial model has no place for it: the camera is a new file of the same name, without pairs in the orientations
    assert b"ModPhgrStd" in files["AutoCal_Foc-28000_Cam-PENTAX_K5.xml"]
    assert not any(b"<Verif>" in data for data in files.values())


def test_only_what_is_changed_in_xml_changes() -> None:
    data = "<?xml version='1.0'?>\n<a x='>'><b>1 2</b><c/><b y=\"/>\"> 3.0 4 </b>ä</a>\n".encode()
    edit = XmlEdit(data)
    first, second = edit.root.all("a/b")
    assert (edit.numbers(first), edit.numbers(second)) == ((1.0, 2.0), (3.0, 4.0))
    assert not edit.replace(first, (1.0, 2.0 + 1e-12))
    assert edit.result() == data
    assert edit.replace(second, (3.0, 5.0))
    edit.remove(next(edit.root.all("a/c")))
    edit.insert(next(edit.root.all("a")), "<d/>")
    assert edit.result().decode() == "<?xml version='1.0'?>\n<a x='>'><b>1 2</b><b y=\"/>\">3.0 5.0</b>ä<d/></a>\n"
