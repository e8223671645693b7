"""Projects opened from Python: the same figures as the commands, and nothing written before a solution is saved."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip as command
from msgspec.structs import asdict
from support.sample_projects import sample
from workflow.small_projects import film_project, first_project, replace_in, two_bundles

import orip
from orip.records.names import record_key

SAMPLES = ("dcs260_calibration", "small_frame_block", "zurich_city_hall")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def outputs(folder: Path) -> dict[str, str]:
    """Return what a solution is written to, without the report and the drive table."""
    names = {"result.json", "residuals.csv", "INTERIOR_RESULT.OUT", "BUNDLE_RESULT.OUT", "BUNDLE_ERROR.OUT"}
    return {path.name: path.read_text() for path in folder.iterdir() if path.name in names}


@pytest.mark.parametrize("name", SAMPLES)
def test_samples_have_the_figures_of_the_command(name: str, tmp_path: Path) -> None:
    by_command = sample(tmp_path / "command", name)
    assert command(by_command, "run").code == 0
    folder = sample(tmp_path / "python", name)
    before = contents(folder)
    solution = orip.open_project(folder).solve()
    assert contents(folder) == before
    assert solution.to_json() == (by_command / "result.json").read_text()
    solution.save()
    assert outputs(folder) == outputs(by_command)
    assert len(outputs(folder)) == 5


@pytest.mark.parametrize("options", [{"snoop": True, "sigma0": "posteriori", "alpha": 0.01}, {"prune": True}])
def test_options_are_those_of_the_command(options: dict[str, object], tmp_path: Path) -> None:
    folder = sample(tmp_path, "small_frame_block")
    solution = orip.open_project(folder).solve("main", **options)
    words = ["--snoop", "--sigma0", "posteriori", "--alpha", "0.01"] if "snoop" in options else ["--prune"]
    for step in (["init"], ["measure"], ["solve", *words, "--no-report"]):
        assert command(folder, *step).code == 0
    assert solution.to_json() == (folder / "result.json").read_text()


def test_a_stored_solution(tmp_path: Path) -> None:
    folder = first_project(tmp_path)
    project = orip.open_project(folder)
    with pytest.raises(orip.InputError, match="bundle MAIN has not been adjusted yet"):
        project.solution()
    solution = project.solve()
    solution.save()
    stored = orip.open_project(folder).solution()
    assert project.solution().to_json() == stored.to_json() == solution.to_json()
    assert np.array_equal(stored.points.covariances, solution.points.covariances)
    with pytest.raises(orip.InputError, match="normal equations are not stored"):
        stored.covariance("P1", "photo left")
    before = contents(folder)
    stored.save()
    solution.save()
    assert contents(folder) == before


def test_status_is_that_of_the_folder(tmp_path: Path) -> None:
    project = orip.open_project(first_project(tmp_path))
    assert [step.state for step in project.status] == ["missing"] * 3
    solution = project.solve()
    assert [step.state for step in project.status] == ["missing"] * 3
    solution.save()
    assert [step.state for step in project.status] == ["up to date"] * 3


def test_changed_texts_are_applied_and_written_with_the_solution(tmp_path: Path) -> None:
    folder = first_project(tmp_path)
    orip.open_project(folder).solve().save()
    replace_in(folder / "orip.toml", "c = 35.0", "c = 35.2")
    replace_in(folder / "FIRST.PNT", "1012.40", "1012.41")
    project = orip.open_project(folder)
    assert project.cameras["C35"].parameters[0] == 35.2
    assert [step.state for step in project.status] == ["out of date", "up to date", "out of date"]
    solution = project.solve()
    assert solution.cameras["C35"]["C"] == 35.2
    solution.save()
    assert [step.state for step in project.status] == ["up to date"] * 3
    result = (folder / "result.json").read_text()
    assert command(folder, "run").code == 0
    assert (folder / "result.json").read_text() == result


def test_several_bundles(tmp_path: Path) -> None:
    project = orip.open_project(two_bundles(tmp_path))
    assert project.bundles == ("AGAIN", "MAIN")
    with pytest.raises(orip.UsageError, match="2 bundles; name one of them"):
        project.solve()
    with pytest.raises(orip.UsageError, match="no bundle 'OTHER'"):
        project.photo_points("OTHER")
    for name in project.bundles:
        project.solve(name).save()
    assert [step.state for step in project.status] == ["up to date"] * 4
    assert json.loads((tmp_path / "AGAIN_result.json").read_text())["bundle"] == "AGAIN"


@pytest.mark.parametrize("write", [first_project, film_project], ids=["pixels", "film"])
def test_arrays_of_a_project_make_the_same_block(write: object, tmp_path: Path) -> None:
    assert_same_as_block(orip.open_project(write(tmp_path)))


def test_arrays_of_a_self_calibration_make_the_same_block(tmp_path: Path) -> None:
    assert_same_as_block(orip.open_project(sample(tmp_path, "dcs260_calibration")))


def assert_same_as_block(project: orip.Project) -> None:
    """Adjust a project's arrays as a block, and compare with the project itself."""
    wanted = project.solve()
    (camera,) = project.cameras.values()
    (bundle,) = project._state.records.bundles
    definition = project._state.definitions.bundle(bundle)
    values = dict(zip(wanted.cameras[camera.name].parameter_names, camera.parameters, strict=True))
    given = orip.Camera(
        camera.name,
        values.pop("C"),
        (values.pop("DX"), values.pop("DY")),
        readout=values.pop("READOUT"),
        distortion=values,
        frame=camera.frame,
        sensor=asdict(camera.sensor) if camera.sensor else None,
        unknown=camera.unknown,
    )
    used = {record_key(name) for name in wanted.photos}
    photos = [photo for photo in project.photos.values() if record_key(photo.name) in used]
    orientation = np.array([photo.orientation for photo in photos], dtype=float)
    block = orip.Block(
        [given],
        orip.Photos([photo.name for photo in photos], camera.name, orientation),
        project.photo_points(),
        project.control_points(),
        ground_unit=project.ground_unit,
        enp_stop=definition.enp_stop,
        max_iterations=definition.max_iterations,
        start_down_weight=definition.start_down_weight,
        max_standard_residual=definition.max_standard_residual,
    )
    found = block.adjust()
    assert found.points.names == wanted.points.names
    # the same operations in the same order except for photo coordinates, which film measures in another system first
    same = {"rtol": 1e-12, "atol": 1e-12}
    np.testing.assert_allclose(found.points.coordinates, wanted.points.coordinates, **same)
    np.testing.assert_allclose(found.points.deviations, wanted.points.deviations, rtol=1e-12)
    np.testing.assert_allclose(found.photos.orientations, wanted.photos.orientations, **same)
    np.testing.assert_allclose(found.residuals.residual, wanted.residuals.residual, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.sigma0, wanted.sigma0, rtol=1e-12)
    assert found.check_points == wanted.check_points
    assert len(found.iterations) == len(wanted.iterations)


def test_everything_that_is_wrong_in_the_texts_is_one_error(tmp_path: Path) -> None:
    folder = first_project(tmp_path)
    replace_in(folder / "orip.toml", "c = 35.0", "c = -35.0")
    replace_in(folder / "FIRST.PNT", "1012.40", "1012,40")
    replace_in(folder / "FIRST.MEA", "3746.1", "374x.1")
    with pytest.raises(orip.InputError) as found:
        orip.open_project(folder)
    assert {complaint.path for complaint in found.value.complaints} == {"orip.toml", "FIRST.PNT", "FIRST.MEA"}
    assert str(found.value) == "\n".join(map(str, found.value.complaints))
    said = command(folder, "run")
    assert said.code == found.value.exit_code
    assert all(complaint.message[:40] in said.err for complaint in found.value.complaints)
    with pytest.raises(orip.UsageError, match=r"does not exist$"):
        orip.open_project(folder / "nowhere")


def test_the_api_speaks_of_no_option_of_a_command(tmp_path: Path) -> None:
    with pytest.raises(orip.InputError, match=r"this is not an orip project$"):
        orip.open_project(tmp_path)
