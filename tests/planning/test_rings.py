"""Networks round an object: the convergent rays of its points against counts by hand and by all choices."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
from cli.command_line import orip
from planning.planned_blocks import CAMERA
from planning.planned_projects import document, project, stations

from orip.errors import InputError
from orip.geometry.rotation import looking_along
from orip.planning.plan import frame_of
from orip.planning.rings import Object, convergent_rays, object_of, plan_rings
from orip.records.control import ControlPoint
from orip.records.plan import PlanSettings

FRAME = frame_of(CAMERA, "height")
WALL = np.array([[x, 0.02 * (number % 3), z] for number, (x, z) in enumerate(
    (x, z) for x in (-3.0, -1.0, 1.0, 3.0) for z in (0.5, 2.0, 3.5))])  # fmt: skip


def middle(settings: PlanSettings, points: np.ndarray | None = None):
    seen = Object(np.zeros((1, 3)) if points is None else points, np.zeros(3), 1.0)
    return seen, plan_rings(settings, CAMERA, seen)


@pytest.mark.parametrize(
    ("elevation", "stations", "convergence", "expected"),
    [
        (0.0, 12, 30.0, 6),  # rays from opposite sides are one line
        (0.0, 12, 31.0, 3),
        (0.0, 7, 10.0, 7),
        (60.0, 8, 22.0, 8),  # neighbours enclose 2 asin(cos 60 sin 22.5) = 22.06 degrees
        (60.0, 8, 22.1, 4),
        (90.0, 4, 1.0, 1),
    ],
)
def test_rays_to_the_middle_are_those_that_geometry_counts(elevation, stations, convergence, expected):
    wanted = PlanSettings(kind="rings", elevations=(elevation,), stations=stations, rolls=(0.0, 90.0))
    seen, plan = middle(wanted)
    assert convergent_rays(seen.points, plan.stations, FRAME, convergence).tolist() == [expected]


def test_points_outside_a_frame_have_no_ray_from_it():
    wanted = PlanSettings(kind="rings", elevations=(90.0,), stations=1, rolls=(0.0,), distance=10.0)
    half = 10.0 * 0.5 * np.array([13.2, 8.8]) / 8.8
    points = np.array([[0.99 * half[0], 0.0, 0.0], [1.01 * half[0], 0.0, 0.0], [0.0, 1.01 * half[1], 0.0],
                       [0.0, 0.0, 20.0]])  # fmt: skip
    _, plan = middle(wanted, points)
    assert convergent_rays(points, plan.stations, FRAME, 10.0).tolist() == [1, 0, 0, 0]


def best_of_all(point: np.ndarray, places: np.ndarray, least: float, wanted: int) -> bool:
    """Return whether some choice of that many places has rays that all enclose enough."""
    rays = point - places
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    far = np.abs(rays @ rays.T) <= math.cos(math.radians(least)) + 1e-9
    return any(all(far[a, b] for a, b in combinations(chosen, 2)) for chosen in combinations(range(len(rays)), wanted))


def test_rays_that_are_wanted_are_held_with_the_fewest_stations():
    wanted = PlanSettings(kind="rings", size=(1.0, 1.0, 0.6), elevations=(15.0, 55.0), stations=2, rolls=(0.0, 90.0),
                          rays=6, convergence=25.0, tie_points=27)  # fmt: skip
    seen = object_of(wanted, ())
    plan = plan_rings(wanted, CAMERA, seen)
    assert plan.rays >= 6
    places = np.unique(np.array([one.position for one in plan.stations]), axis=0)
    # the sphere round the object fills the frame: all points are in all photos
    assert all(best_of_all(point, places, 25.0, 6) for point in seen.points)
    count = len(plan.stations) // 4
    one_less = PlanSettings(kind="rings", size=(1.0, 1.0, 0.6), elevations=(15.0, 55.0), stations=count - 1)
    fewer = plan_rings(one_less, CAMERA, seen).stations
    assert convergent_rays(seen.points, fewer, FRAME, 25.0).min() < 6


def test_rays_that_no_number_of_stations_gives_are_refused():
    with pytest.raises(InputError, match="rays = 9 is not reached with 60 stations"):
        middle(PlanSettings(kind="rings", elevations=(85.0,), rays=9, convergence=30.0))


def test_a_wall_given_by_its_points_is_photographed_from_its_front_and_above_the_ground(tmp_path):
    made = project(
        tmp_path / "p", kind='"rings"', object='"control"', axis="[0.0, -1.0, 0.0]", lowest="0.3",
        elevations="[35.0, 60.0]", rays="5", convergence="12.0", pixel="", corners="", position_error="",
    )  # fmt: skip
    text = (made / "orip.toml").read_text().replace(', crs = "EPSG:25832"', "") + 'datum = "free"\n'
    (made / "orip.toml").write_text(text)
    rows = "".join(f"W{n + 1} {x} {y} {z} 0.01 0.01 0.01\n" for n, (x, y, z) in enumerate(WALL.tolist()))
    (made / "PLANNED.PNT").write_text(rows)
    found = document(made, "plan", "make")
    assert found["rays"] >= 5
    places = np.array([one.position for one in stations(made)])
    assert (places[:, 1] < -1.0).all()
    assert (places[:, 2] >= 0.3).all()
    forecast = document(made, "plan", "forecast")
    # the wall's points and nothing else, known to millimetres by 0.3 pixels
    assert max(forecast["point_sd_largest"]) < 0.005
    assert orip(made, "plan", "show").code == 0


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -2.0), (3.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_rings_are_about_their_axis(axis):
    wanted = PlanSettings(kind="rings", axis=axis, elevations=(30.0,), stations=9, rolls=(0.0,), distance=5.0)
    _, plan = middle(wanted)
    places = np.array([one.position for one in plan.stations])
    unit = np.array(axis) / np.linalg.norm(axis)
    assert np.allclose(places @ unit, 2.5)
    assert np.allclose(np.linalg.norm(places, axis=1), 5.0)
    assert np.allclose((places - 2.5 * unit).sum(axis=0), 0.0)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"axis": (0.0, 0.0, 0.0)}, "no direction"),
        ({"distance": 0.5}, "within the object"),
        ({"lowest": 100.0}, "below lowest"),
    ],
)
def test_rings_that_cannot_be_are_refused(changed, said):
    with pytest.raises(InputError, match=said):
        middle(PlanSettings(kind="rings", **changed))


@pytest.mark.parametrize("points", [[], [(0.0, 0.0, 0.0)] * 4])
def test_points_that_are_no_object_are_refused(points):
    control = [ControlPoint(f"P{number}", place, (1.0,) * 3) for number, place in enumerate(points)]
    with pytest.raises(InputError, match="three points"):
        object_of(PlanSettings(kind="rings", object="control"), control)


def test_cameras_on_rings_look_at_the_object():
    for direction in ([0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [0.0, 1.0, 0.0]):
        rotation = looking_along(np.array(direction), 0.4)
        assert np.allclose(-rotation[:, 2], direction)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
