"""Rigs of other programs: read, adjusted as rigs and written back, with the same reprojections."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip
from exchange.imported import read_well, reprojected
from exchange.rigs.rig_projects import relative_poses, rig_project, with_mountings
from exchange.samples.round_trip import local_through_orip

from orip.exchange.colmap.reader import READING
from orip.exchange.formats import format_named
from orip.records.exchanged import ExchangedProject
from orip.structs import replace

SAME_PX = 1e-6


def source(folder: Path, name: str) -> Path:
    """Write the rig as another program has it, with noise; Metashape has measurements of marks alone."""
    project = with_mountings(rig_project(READING))
    if name == "metashape":
        marks = replace(project.points, is_track=np.zeros(len(project.points.names), dtype=np.bool_))
        project = replace(project, points=marks)
    write = format_named(name).write
    assert write is not None
    folder.mkdir()
    for file, data in write(local_through_orip(project, name), None).items():
        (folder / file).write_bytes(data)
    return folder / "cameras.xml" if name == "metashape" else folder


def read(path: Path, name: str) -> ExchangedProject:
    found = format_named(name).read
    assert found is not None
    return read_well(found, path)


def exposures(name: str) -> set[frozenset[str]]:
    """Return those that a format has: in Metashape one without the first camera, the master, is none."""
    found = members(rig_project(READING))
    return {one for one in found if len(one) == 3} if name == "metashape" else found


def members(project: ExchangedProject) -> set[frozenset[str]]:
    return {frozenset(project.photos[n].name for n in one.photos) for one in project.exposures if len(one.photos) > 1}


def require_one_body(project: ExchangedProject) -> None:
    """Require that each camera has the same pose against the first in all exposures."""
    poses = relative_poses(project)
    assert len(poses) == 8
    for camera in "12":
        turns, shifts = zip(*(pose for name, pose in poses.items() if name.endswith(camera)), strict=True)
        assert np.abs(np.array(turns) - turns[0]).max() < 1e-9
        assert np.abs(np.array(shifts) - shifts[0]).max() < 1e-8


FORMATS = ["colmap", "opensfm", "metashape"]


@pytest.mark.parametrize("name", FORMATS)
def test_a_rig_is_read_as_it_was_written(tmp_path: Path, name: str) -> None:
    given, found = rig_project(READING), read(source(tmp_path / "given", name), name)
    (rig,) = found.rigs
    assert [one.camera for one in rig.mountings] == [0, 1, 2]
    assert members(found) == exposures(name)
    old, new = relative_poses(given), relative_poses(found)
    for (turn, shift), (turned, shifted) in zip(sorted_poses(old), sorted_poses(new), strict=True):
        assert np.abs(turn - turned).max() < 1e-12
        assert np.abs(shift - shifted).max() < 1e-11
    if name == "metashape":  # marks have no coordinates there: they are intersected
        given = replace(given, points=replace(given.points, coordinates=np.full((80, 3), np.nan)))
    assert reprojected(found)[0].rms == pytest.approx(reprojected(given)[0].rms, abs=SAME_PX)


def sorted_poses(poses: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[tuple[np.ndarray, np.ndarray]]:
    return sorted(poses.values(), key=lambda pose: tuple(np.round(pose[0].ravel(), 6)) + tuple(np.round(pose[1], 6)))


@pytest.mark.parametrize("name", FORMATS)
def test_a_rig_is_adjusted_and_goes_back(tmp_path: Path, name: str) -> None:
    path, project = source(tmp_path / "given", name), tmp_path / "project"
    said = orip(tmp_path, "import", str(path), "project")
    assert said.code == 0, said.told
    document = tomllib.loads((project / "orip.toml").read_text(encoding="utf-8"))
    (rig,) = document["rig"]
    assert [set(one) for one in rig["camera"]] == [{"name"}] * 3
    assert (
        sorted(len(one["photos"]) for one in document["exposure"]) == [3] * 4
        if name == "metashape"
        else [2, 3, 3, 3, 3]
    )
    assert orip(project, "run").code == 0
    result = json.loads((project / "result.json").read_text(encoding="utf-8"))
    (mounted,) = result["mountings"].values()
    assert len(mounted) == 3
    said = orip(project, "export", name, "back")
    assert said.code == 0, said.told
    back = project / "back"
    if name == "opensfm":
        (back / "tracks.csv").write_bytes((path / "tracks.csv").read_bytes())
    found = read(back / "cameras.xml" if name == "metashape" else back, name)
    assert members(found) == exposures(name)
    require_one_body(found)
    if name == "metashape":
        places = [[result["points"][one][axis]["value"] for axis in "XYZ"] for one in found.points.names]
        found = replace(found, points=replace(found.points, coordinates=np.array(places)))
    assert reprojected(found)[0].rms == pytest.approx(adjusted_rms(project), abs=SAME_PX)
    if name == "colmap":
        assert rms_of_colmap(back) == pytest.approx(adjusted_rms(project), abs=SAME_PX)


def adjusted_rms(project: Path) -> float:
    """Return the root mean square of the lengths of the residuals in pixels."""
    head, *rows = (project / "residuals.csv").read_text(encoding="utf-8").splitlines()
    names = head.split(",")
    kind, residual = names.index("kind"), names.index("residual")
    values = [float(row.split(",")[residual]) for row in rows if row.split(",")[kind] == "photo"]
    pixel = 36.0 / 4000.0
    return float(np.sqrt(2.0 * np.mean(np.square(values)))) / pixel


def rms_of_colmap(folder: Path) -> float:
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(str(folder))
    assert (model.num_rigs(), model.num_reg_images()) == (1, 15)
    return rms_of_model(model)


def rms_of_model(model: Any) -> float:
    squares = [
        float(np.square(image.project_point(model.points3D[one.point3D_id].xyz) - one.xy).sum())
        for image in model.images.values()
        for one in image.points2D
        if one.has_point3D()
    ]
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize("name", FORMATS)
def test_photos_that_are_no_rig_any_more_go_back_one_by_one(tmp_path: Path, name: str) -> None:
    path, project = source(tmp_path / "given", name), tmp_path / "project"
    assert orip(tmp_path, "import", str(path), "project").code == 0
    text = (project / "orip.toml").read_text(encoding="utf-8")
    start, end = text.index("[[rig]]"), text.index("[[bundle]]")
    (project / "orip.toml").write_text(text[:start] + text[end:] if start < end else text[:start], encoding="utf-8")
    assert orip(project, "run").code == 0
    said = orip(project, "export", name, "back")
    if name == "metashape":
        assert said.code == 3
        assert "of the multi-camera system in the original have no place of their own" in " ".join(said.err.split())
        return
    assert said.code == 0, said.told
    if name == "opensfm":
        (project / "back" / "tracks.csv").write_bytes((path / "tracks.csv").read_bytes())
    found = read(project / "back", name)
    assert found.rigs == ()
    assert reprojected(found)[0].rms == pytest.approx(adjusted_rms(project), abs=SAME_PX)


def test_rigs_of_colmap_end_where_its_own_adjustment_does(tmp_path: Path) -> None:
    """Two rigs of three cameras that COLMAP has simulated and written; both programs estimate mountings and lenses."""
    pycolmap = pytest.importorskip("pycolmap")
    pycolmap.set_random_seed(3)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 2, 3, 5
    options.num_points3D, options.camera_model_id = 150, pycolmap.CameraModelId.SIMPLE_RADIAL
    model = pycolmap.synthesize_dataset(options)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.5
    pycolmap.synthesize_noise(noise, model)
    (tmp_path / "given").mkdir()
    model.write_binary(str(tmp_path / "given"))
    given = read(tmp_path / "given", "colmap")
    assert (len(given.rigs), len(given.exposures)) == (2, 10)
    assert reprojected(given)[0].rms == pytest.approx(rms_of_model(model), abs=SAME_PX)
    assert orip(tmp_path, "import", "given", "project").code == 0
    assert orip(tmp_path / "project", "run").code == 0
    assert orip(tmp_path / "project", "export", "colmap", "back").code == 0
    back = pycolmap.Reconstruction(str(tmp_path / "project" / "back"))
    config = pycolmap.BundleAdjustmentConfig()
    for number in model.images:
        config.add_image(number)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjustment = pycolmap.BundleAdjustmentOptions()
    adjustment.print_summary = False
    solver = adjustment.ceres.solver_options
    solver.function_tolerance, solver.gradient_tolerance, solver.max_num_iterations = 1e-14, 0.0, 50
    adjustment.ceres.solver_options = solver
    pycolmap.create_default_ceres_bundle_adjuster(adjustment, config, model).solve()
    assert rms_of_model(back) == pytest.approx(rms_of_model(model), abs=1e-9)
    for number, rig in model.rigs.items():
        for sensor, pose in rig.non_ref_sensors.items():
            found = back.rigs[number].non_ref_sensors[sensor]
            assert np.abs(found.rotation.matrix() - pose.rotation.matrix()).max() < 1e-6
