"""The forecast of the sample drone_rtk as it was flown, against its own adjustment."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from cli.command_line import orip
from workflow.small_projects import REPOSITORY

from orip.api.project import open_project
from orip.planning.designed import terrain_of_points
from orip.planning.forecast import Design, design_block, forecast, tie_points
from orip.structs import replace

SHIFT = '\n[[antenna]]\nname = "RTK"\nshift = "strip"\nstrips = ["S3"]\n'


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan") / "drone_rtk"
    shutil.copytree(REPOSITORY / "sample_projects" / "drone_rtk", folder)
    with (folder / "orip.toml").open("a", encoding="utf-8") as text:
        text.write(SHIFT)
    project = open_project(folder)
    return project, project.solve()


def test_its_plan_was_flown(tmp_path):
    folder = tmp_path / "drone_rtk"
    shutil.copytree(REPOSITORY / "sample_projects" / "drone_rtk", folder)
    assert orip(folder, "plan", "make", "--json").document["photos"] == 48
    found = orip(folder, "plan", "flown", "--json").document
    assert (found["again"], found["gaps"]) == ([], 0)


def flown(sample, points):
    """Return the forecast from the log of the flight and the nominal angles of orip.toml alone."""
    project, _ = sample
    definition, control = project._state.project.definition, project._state.texts.control.value
    nominal = {photo.name: np.radians(photo.orientation[3:]) for photo in definition.photos}
    stations = tuple(
        replace(station, angles=tuple(nominal[station.photo]), angle_error=(-0.01,) * 3) for station in control.stations
    )
    if points is None:
        terrain = terrain_of_points(control.points, "DRONE.PNT")
        points = tie_points(np.array([13.2, 8.8]), 8.8, stations, terrain, 25)
    design = Design(
        definition.bundles[0], definition.cameras[0], stations, points, control, definition.antennas, "m",
        definition.crs,
    )  # fmt: skip
    return forecast(design_block(design))


def medians(solution):
    return np.concatenate(
        [np.nanmedian(solution.points.sd, axis=0), np.nanmedian(solution.photos.sd, axis=0), solution.cameras.sd[0, :1]]
    )


def test_where_the_points_are_it_is_within_10_percent(sample):
    record = sample[1]._record
    tied = np.flatnonzero([kind == "tie" for kind in record.point_kinds])
    found = flown(sample, record.points.values[tied])
    assert np.abs(medians(found.solution) / medians(record) - 1.0).max() < 0.1


def test_on_a_grid_photos_and_camera_are_within_10_percent(sample):
    ratio = medians(flown(sample, None).solution) / medians(sample[1]._record)
    assert np.abs(ratio[3:] - 1.0).max() < 0.1
    # points of the grid are seen by fewer photos at the border, where nobody measured
    assert np.abs(ratio[:3] - 1.0).max() < 0.2
