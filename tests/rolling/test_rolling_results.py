"""What is said of photos of rolling shutters: readout and motions in solution, listing, report and result.json."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from numpy.typing import ArrayLike

import orip
from orip.api.control_tables import stations
from orip.bundle.known_motions import without_motion
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import solve_block
from orip.files.control.stations_text import parse_stations, stations_text
from orip.files.listings.bundle_estimates import camera_lines, motion_lines
from orip.files.result.json_text import result_document
from orip.files.text.shown import Parsed
from orip.records.block import Block
from orip.records.camera import READOUT
from orip.records.control import NOT_GIVEN, ControlElement, StationMotion
from orip.records.definition import Antenna
from orip.records.results.solution import Solution
from orip.report.photos import motion_table
from orip.structs import replace
from rolling.rolling_flights import PIXEL, SWINGING, C, Flown, flown

UNKNOWN = ("C", "READOUT")


@cache
def made(**settings: float) -> Flown:
    return flown(5, -0.04, 9.0, unknown=UNKNOWN, **settings)


def solution(block: Block) -> Solution:
    return solution_of(solve_block(block, lambda _: None, lambda: False))


def test_motions_are_those_of_the_flight() -> None:
    found = solution(made().block).motions
    assert [row.photo for row in found] == [photo.name for photo in made().block.photos]
    speeds = [np.hypot(row.VX, row.VY) for row in found]
    assert np.allclose(speeds, 9.0, rtol=0.15)
    assert all(np.isnan(row.VX_sd) and np.isnan(row.WZ_sd) for row in found)
    # the readout is known to some percent
    assert np.allclose([PIXEL * row.pixels for row in found], made().motion, rtol=0.1)


def test_motions_of_unknown_rates_have_standard_deviations_and_are_listed() -> None:
    swinging = flown(5, 0.04, 9.0, swing=SWINGING, unknown=UNKNOWN, rate_error=2.0)
    found = solution(swinging.block)
    assert all(np.isnan(row.VY_sd) and 0.0 < row.WX_sd < 2.0 for row in found.motions)
    lines = motion_lines(found)
    assert sum(line.split()[:1] == ["P1"] for line in lines) == 1
    assert any("±" in cell for cell in motion_table(found).columns[4].cells)
    kinds = {kind for kind in found.residuals.kind if kind == "motion"}
    assert kinds == {"motion"}
    document = json.loads(json.dumps(result_document(found)))
    first = document["motions"]["P1"]
    assert first["VX"]["sd"] is None
    assert first["WX"]["sd"] == pytest.approx(found.motions[0].WX_sd)


def test_the_readout_is_listed_where_a_camera_has_one() -> None:
    (camera,) = result_document(solution(made().block))["cameras"].values()
    assert camera["READOUT"]["value"] == pytest.approx(-0.04, abs=5.0 * camera["READOUT"]["sd"])
    assert any(line.split()[:1] == ["READOUT"] for line in camera_lines(solution(made().block)))
    plain = replace(made().block, cameras=(replace(made().block.cameras[0], unknown=("C",)),))
    assert not any("READOUT" in line for line in camera_lines(solution(plain)))
    assert motion_table(solution(plain)) is None


def test_a_weighted_readout_is_between_what_is_given_and_what_is_seen() -> None:
    free = solution(made().block).cameras
    given = free.values[0, READOUT] + 0.002
    block = replace(
        made().block, elements=(ControlElement("CAM", "CAMERA", "READOUT", given, float(free.sd[0, READOUT])),)
    )
    weighted = solution(block).cameras
    assert weighted.values[0, READOUT] == pytest.approx(given - 0.001, abs=2e-4)
    assert weighted.sd[0, READOUT] == pytest.approx(free.sd[0, READOUT] / np.sqrt(2.0), rel=0.05)


def test_photos_without_motion_are_said() -> None:
    block = made().block
    still = replace(
        block, stations=tuple(replace(s, time=np.nan) if s.photo in ("P2", "P9") else s for s in block.stations)
    )
    (said,) = without_motion(still)
    assert said.where == "camera CAM"
    assert "2 photos of 18 have no known motion (P2, P9)" in said.text
    assert not list(without_motion(block))


def test_a_lever_arm_and_a_readout_together() -> None:
    block = replace(made().block, antennas=(Antenna("GNSS", unknown=("LX", "LY", "LZ"), lever_arm_error=(0.1,) * 3),))
    found = solution(block)
    assert found.sigma0 == pytest.approx(1.0, abs=0.15)


def arrays(block: Block | None = None, **camera: object) -> orip.Block:
    """Return a flight as arrays, measured in pixels."""
    block = block or made().block
    points, sensor = block.photo_points, block.cameras[0].sensor
    assert sensor is not None
    pixels = np.column_stack([points.xy[:, 0] / PIXEL + sensor.columns / 2, sensor.rows / 2 - points.xy[:, 1] / PIXEL])
    size = {"columns": sensor.columns, "rows": sensor.rows, "width": sensor.width, "height": sensor.height}
    control = block.control_points
    return orip.Block(
        [orip.Camera("CAM", C, **{"sensor": size, **camera})],
        orip.Photos(
            [photo.name for photo in block.photos], "CAM",
            np.hstack([block.photo_orientation[:, :3], np.degrees(block.photo_orientation[:, 3:])]),
        ),
        orip.PhotoPoints(
            [block.photos[row].name for row in points.photo], [block.point_names[row] for row in points.point], pixels
        ),
        orip.ControlPoints(
            [point.name for point in control], [point.coordinates for point in control],
            [point.errors for point in control],
        ),
        stations=stations_of(block),
        measurement_precision="0.5px",
    )  # fmt: skip


def stations_of(block: Block) -> orip.Stations:
    """Return the stations of a flight as arrays."""
    given = block.stations
    moved = [station.motion or StationMotion() for station in given]
    return orip.Stations(
        [station.photo for station in given], [station.position for station in given], 0.02,
        time=[station.time for station in given], strip=[station.strip for station in given],
        velocity=[motion.velocity for motion in moved], velocity_error=[motion.velocity_error for motion in moved],
        rate=np.degrees([motion.rate for motion in moved]), rate_error=np.degrees([m.rate_error for m in moved]),
    )  # fmt: skip


def test_motions_of_stations_from_arrays_are_those_of_the_file() -> None:
    """One station has no motion, one only a velocity, and one only an angular rate."""
    block = flown(5, -0.04, 9.0, swing=SWINGING, unknown=UNKNOWN, known=(0.05, 0.3)).block
    first, second, third, *others = block.stations
    assert second.motion is not None
    assert third.motion is not None
    some = (
        replace(first, motion=None),
        replace(second, motion=replace(second.motion, rate=NOT_GIVEN, rate_error=NOT_GIVEN)),
        replace(third, motion=replace(third.motion, velocity=NOT_GIVEN, velocity_error=NOT_GIVEN)),
        *others,
    )
    block = replace(block, stations=some)
    text = stations_text(block.stations)
    read = parse_stations(Parsed(text.splitlines()), "FLIGHT.STA").value
    found = stations(stations_of(block)).value
    assert stations_text(found) == text
    for one, other in zip(found, read, strict=True):
        assert (one.motion is None) == (other.motion is None)
    for one, other in zip(found, block.stations, strict=True):
        said, wanted = one.motion or StationMotion(), other.motion or StationMotion()
        for column in ("velocity", "velocity_error", "rate", "rate_error"):
            np.testing.assert_allclose(getattr(said, column), getattr(wanted, column), rtol=1e-12)
    # adjusted with them, the readout is that of the flight; without them the swinging shows in the residuals
    by_stations = arrays(block, unknown=UNKNOWN, readout=-0.03).adjust()
    assert by_stations.cameras["CAM"]["READOUT"] == pytest.approx(-0.04, abs=0.004)
    assert [motion.photo for motion in by_stations.motions] == [photo.name for photo in block.photos]
    assert np.isnan(by_stations.motions[0].WX_sd)
    assert 0.0 < by_stations.motions[2].WX_sd <= 0.3
    still = replace(block, stations=tuple(replace(station, motion=None) for station in block.stations))
    assert arrays(still, unknown=UNKNOWN, readout=-0.03).adjust().sigma0 > 1.5 * by_stations.sigma0


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        ({"velocity": [[1.0, 0.0, 0.0]]}, "stations.velocity"),
        ({"velocity": [[1.0, 0.0, 0.0]], "velocity_error": -0.1}, "stations.velocity_error"),
        ({"rate": [[1.0, 0.0]], "rate_error": 0.1}, "stations.rate"),
        ({"rate": [[1.0, np.nan, 0.0]], "rate_error": 0.1}, "stations.rate"),
    ],
)
def test_motions_that_cannot_be_are_named_by_their_column(motion: dict[str, ArrayLike], said: str) -> None:
    (complaint, *_) = stations(orip.Stations(["P1"], [[0.0, 0.0, 0.0]], 0.1, **motion)).complaints
    assert said in str(complaint)


def test_readouts_of_blocks_from_arrays() -> None:
    found = arrays(unknown=UNKNOWN, readout=-0.03).adjust()
    assert found.cameras["CAM"]["READOUT"] == pytest.approx(-0.04, abs=0.01)


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        ({"readout": 30.0}, "it is in seconds from the first row or column to the last one"),
        ({"readout": -48.2}, "in milliseconds, write readout = -0.0482"),
        ({"readout": 0.03, "sensor": None}, "has a readout, but no sensor whose rows it is of"),
        ({"unknown": ["READOUT"], "sensor": None}, "has a readout, but no sensor whose rows it is of"),
        ({"readout": float("nan")}, "nan"),
    ],
)
def test_readouts_that_cannot_be(camera: dict[str, object], said: str) -> None:
    with pytest.raises(orip.errors.InputError, match=said):
        arrays(**camera)
