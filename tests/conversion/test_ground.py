"""Geocentric and touching systems, and control on a map, in one system of east, north and up."""

from __future__ import annotations

import numpy as np
import pytest
from conversion.exchanged_blocks import block

from orip.exchange.conversion.ground import LocalGround, from_local_ground, in_local_ground, local_ground
from orip.exchange.conversion.poses import orip_poses
from orip.records.control import ControlPoint, Station, StationReference
from orip.records.exchanged import ExchangedProject, GroundFrame, PoseReading
from orip.structs import replace

READING = PoseReading("y_down", "to_ground", "matrix", "radian", "centre")
BERLIN = LocalGround(np.array([np.radians(13.4), np.radians(52.52), 80.0]))


def geocentric_block() -> ExchangedProject:
    return replace(from_local_ground(block(READING), BERLIN), frame=GroundFrame("geocentric"))


def test_a_block_goes_to_the_earth_and_back() -> None:
    given, there = block(READING), geocentric_block()
    assert np.linalg.norm(there.points.coordinates, axis=1) == pytest.approx(np.full(60, 6.365e6), rel=1e-3)
    ground = local_ground(there)
    assert ground is not None
    back = in_local_ground(there, ground)
    # the new origin is rounded; its axes differ from those of the first one by the angle between the places
    distance = np.linalg.norm(np.diff(given.points.coordinates, axis=0), axis=1)
    assert np.linalg.norm(np.diff(back.points.coordinates, axis=0), axis=1) == pytest.approx(distance, abs=1e-7)
    whole = in_local_ground(there, BERLIN)
    assert whole.points.coordinates == pytest.approx(given.points.coordinates, abs=1e-8)
    for found, expected in zip(orip_poses(whole.photos, READING), orip_poses(given.photos, READING), strict=True):
        assert found == pytest.approx(expected, abs=1e-8)


def test_the_origin_is_the_same_when_a_result_is_read_again() -> None:
    there = geocentric_block()
    moved = [replace(photo, position=tuple(x + 0.01 for x in photo.position)) for photo in there.photos]
    first, second = local_ground(there), local_ground(replace(there, photos=tuple(moved)))
    assert first is not None
    assert second is not None
    assert first.geographic.tolist() == second.geographic.tolist()


def test_control_on_a_map_and_positions_in_degrees_come_together() -> None:
    # longitude 15 is the central meridian of zone 33: easting 500 000, and east is grid east
    project = replace(
        block(READING),
        frame=GroundFrame("topocentric", (15.0, 0.0, 10.0)),
        control=(
            ControlPoint("A", (500_000.0, 0.0, 12.0), (0.01, 0.01, 0.02)),
            ControlPoint("B", (500_099.96, 0.0, None), (0.01, 0.01, None)),
        ),
        control_crs="EPSG:32633",
        stations=(Station("0.jpg", (15.0, 0.0, 110.0), (1.0, 1.0, 2.0)),),
        station_reference=StationReference("EPSG:4979"),
    )
    ground = local_ground(project)
    assert ground is not None
    found = in_local_ground(project, ground)
    assert found.control[0].coordinates == pytest.approx((0.0, 0.0, 2.0), abs=1e-6)
    x, y, z = found.control[1].coordinates
    # the scale of UTM on its central meridian is 0.9996
    assert (x, y) == pytest.approx((100.0 * (1.0 + 10.0 / 6378137.0), 0.0), abs=1e-4)
    assert z is None
    assert found.stations[0].position == pytest.approx((0.0, 0.0, 100.0), abs=1e-6)
    assert found.control_crs == ""
    assert found.frame.kind == "plain"
    assert found.points is project.points


def test_a_plain_project_has_no_local_system() -> None:
    assert local_ground(block(READING)) is None


def test_control_in_feet_of_the_us_survey_is_that_in_metres() -> None:
    # NAD83(2011) / New York Long Island, in metres and in US survey feet; neither has heights
    places = np.array([[304_800.0, 60_960.0, 90.0], [304_900.0, 61_060.0, 95.0]])
    found = []
    for crs, unit in (("EPSG:6538", 1.0), ("EPSG:6539", 1200.0 / 3937.0)):
        control = tuple(
            ControlPoint(str(n), (x / unit, y / unit, z), (None, None, None)) for n, (x, y, z) in enumerate(places)
        )
        project = replace(
            block(READING), frame=GroundFrame("topocentric", (-73.94, 40.71, 0.0)), control=control, control_crs=crs
        )
        ground = local_ground(project)
        assert ground is not None
        local = in_local_ground(project, ground)
        assert any("(ftUS)) are in US survey foot, and it has no heights" in note for note in local.notes) == (unit < 1)
        found.append(np.array([point.coordinates for point in local.control]))
    assert found[1] == pytest.approx(found[0], abs=1e-6)
