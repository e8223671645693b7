"""Footprint, base, spacing and strips against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from orip.errors import InputError
from orip.planning.areas import checked_outline
from orip.planning.designed import level
from orip.planning.geometry import (
    Frame,
    Wanted,
    advance,
    best_azimuth,
    footprint,
    height_of_pixel,
    least_height,
    strips_along,
    strips_over,
)

FILM = Frame(153.0, 230.0, 230.0, 0.02)
DRONE = Frame(8.8, 8.8, 13.2, 13.2 / 5472)
SQUARE = np.array([[0.0, 0.0], [5000.0, 0.0], [5000.0, 5000.0], [0.0, 5000.0]])


def gaps(strips):
    base = strips[0].places[1, :2] - strips[0].places[0, :2]
    azimuth = strips[0].azimuth
    spacing = (strips[1].places[0, :2] - strips[0].places[0, :2]) @ [math.cos(azimuth), -math.sin(azimuth)]
    return np.linalg.norm(base), abs(spacing)


def test_a_film_camera_at_one_to_eight_thousand():
    strips = strips_over(SQUARE, FILM, Wanted(153.0 * 8.0, 0.6, 0.3), level(0.0), 0.3)
    assert np.allclose(gaps(strips), (736.0, 1288.0), rtol=1e-9, atol=0.0)


def test_a_drone_at_82_metres():
    assert DRONE.pixel * 82.0 / 8.8 == pytest.approx(0.0224780701754, rel=1e-9)
    assert height_of_pixel(DRONE, DRONE.pixel * 82.0 / 8.8) == pytest.approx(82.0, rel=1e-12)
    strips = strips_over(SQUARE / 10.0, DRONE, Wanted(82.0, 0.7, 0.7), level(35.0), math.pi / 2.0)
    assert np.allclose(gaps(strips), (24.6, 36.9), rtol=1e-9, atol=0.0)
    assert np.allclose(strips[0].places[:, 2], 117.0)
    corners = footprint(DRONE, np.array([0.0, 0.0, 117.0]), np.eye(3), np.array([13.2, 8.8]), 35.0)
    assert np.allclose(np.ptp(corners, axis=0), (123.0, 82.0), rtol=1e-9)


@pytest.mark.parametrize("crab", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("overlap", [0.0, 0.6, 0.95])
def test_overlap_of_photos_turned_against_the_strip_is_what_is_wanted(crab, overlap):
    base = advance(overlap, 82.0, 123.0, crab)
    # the photos are rectangles in a system of their own, in which the next one is moved by (b cos, b sin)
    common = (82.0 - base * math.cos(crab)) * (123.0 - base * math.sin(crab))
    assert common / (82.0 * 123.0) == pytest.approx(overlap, abs=1e-12)


def test_overlaps_hold_over_the_highest_ground():
    def hill(places):
        return 20.0 * np.exp(-(np.linalg.norm(places - 250.0, axis=1) ** 2) / 2e4)

    strips = strips_over(SQUARE / 10.0, DRONE, Wanted(82.0, 0.7, 0.6), hill, 0.0)
    x, y = np.meshgrid(np.linspace(0.0, 500.0, 120), np.linspace(0.0, 500.0, 120))
    heights = hill(np.column_stack([x.ravel(), y.ravel()]))
    clear = heights.mean() + 82.0 - heights.max()
    assert np.allclose(gaps(strips), (0.3 * clear, 0.4 * clear * 1.5), rtol=1e-9)


def test_a_flight_that_follows_a_slope_keeps_its_overlap():
    slope = 0.2

    def inclined(places):
        return slope * places[:, 1]

    half = 0.5 * math.hypot(8.8, 13.2) / 8.8
    # the corner of a photo that looks straight uphill shows the highest ground
    found = least_height(DRONE, inclined, np.zeros((1, 2)), 82.0)
    assert found == pytest.approx(82.0 * (1.0 - slope * half), rel=1e-9)
    strips = strips_over(SQUARE / 10.0, DRONE, Wanted(82.0, 0.7, 0.6, follow=True), inclined, 0.0)
    places = strips[0].places
    assert np.allclose(places[:, 2], 82.0 + slope * places[:, 1])
    # what two photos show of the slope in common, against what one of them shows: closed form along the strip
    tangent = 0.5 * 8.8 / 8.8
    shown = 82.0 * tangent * (1.0 / (1.0 + slope * tangent) + 1.0 / (1.0 - slope * tangent))
    assert 1.0 - gaps(strips)[0] / shown > 0.7


def test_strips_reach_the_border_and_not_much_more():
    for azimuth in (0.0, 0.4, 2.0):
        strips = strips_over(SQUARE / 10.0, DRONE, Wanted(82.0, 0.7, 0.7, margin=10.0), level(0.0), azimuth)
        ahead = np.array([math.sin(azimuth), math.cos(azimuth)])
        right = np.array([ahead[1], -ahead[0]])
        across = np.array([strip.places[0, :2] @ right for strip in strips])
        border = SQUARE @ right / 10.0
        assert across.min() <= border.min() - 10.0 + 1e-9
        assert across.max() >= border.max() + 10.0 - 1e-9
        assert across.min() > border.min() - 10.0 - 36.9 / 2.0 - 1e-6


def test_the_best_direction_is_along_the_area():
    corners = np.array([[0.0, 0.0], [600.0, 300.0], [550.0, 400.0], [-50.0, 100.0]])
    wanted = Wanted(82.0, 0.7, 0.7)

    def photos(azimuth):
        return sum(len(strip.places) for strip in strips_over(corners, DRONE, wanted, level(0.0), azimuth))

    best = best_azimuth(corners, lambda azimuth: len(strips_over(corners, DRONE, wanted, level(0.0), azimuth)))
    assert math.tan(best) == pytest.approx(2.0, rel=1e-6)
    assert len(strips_over(corners, DRONE, wanted, level(0.0), best)) == min(
        len(strips_over(corners, DRONE, wanted, level(0.0), azimuth)) for azimuth in np.linspace(0.0, math.pi, 60)
    )
    assert photos(best) > 0


def test_a_corridor_follows_its_line():
    line = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, 300.0]])
    strips = strips_along(line, 60.0, DRONE, Wanted(82.0, 0.7, 0.7), level(0.0))
    assert {round(math.degrees(strip.azimuth)) % 180 for strip in strips} == {0, 90}
    for strip in strips:
        offset = strip.places[:, 1] if round(math.degrees(strip.azimuth)) % 180 else strip.places[:, 0] - 400.0
        assert np.abs(offset).max() <= 30.0 + 36.9 / 2.0 + 1e-9


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "cross"),
        ([[0, 0], [1, 1], [2, 2]], "no size"),
        ([[0, 0], [1, 1]], "needs 3"),
        ([[0, 0], [0, 0], [1, 0], [1, 1]], "same"),
        ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], "cross"),
    ],
)
def test_areas_that_are_none_are_refused(corners, said):
    with pytest.raises(InputError, match=said):
        checked_outline(np.array(corners, dtype=float), "area", is_line=False)


def test_ground_above_the_flight_is_refused():
    with pytest.raises(InputError, match="follow"):
        strips_over(SQUARE / 10.0, DRONE, Wanted(50.0, 0.7, 0.7), lambda places: places[:, 0], 0.0)


def test_a_flight_of_a_million_photos_is_refused():
    with pytest.raises(InputError, match="photos"):
        strips_over(SQUARE * 10.0, DRONE, Wanted(8.0, 0.9, 0.9), level(0.0), 0.0)
