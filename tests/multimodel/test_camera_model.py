"""The camera model of the real-time loop against that of the adjustment, and against itself there and back."""

from __future__ import annotations

import numpy as np
import pytest
from support.drive_tables import LENS, PLAIN_CAMERA, cameras

from orip.interior.additional_parameters import additional_with_partials
from orip.interior.distortion import corrected_with_partials, distorted_with_partials
from orip.multimodel.photo_loop import camera_model
from orip.records.drive_table import DriveCamera
from orip.structs import replace

FRAME = np.stack(np.meshgrid(np.linspace(-10.0, 10.0, 9), np.linspace(-12.0, 12.0, 9)), axis=-1).reshape(-1, 2)
CAMERAS = cameras()
EXACT = 1e-12
"""mm: sums of a dozen terms of some ten millimetres, rounded to 2e-15 mm each, with something to spare."""


def additional(camera, xy):
    if camera.additional is None:
        return 0.0
    found = camera.additional
    return additional_with_partials(found.name, xy, found.base, np.array(found.values)).value


@pytest.mark.parametrize("name", CAMERAS)
def test_is_that_of_the_adjustment(name):
    camera = CAMERAS[name]
    model, coefficients = camera_model(camera).image, camera.parameters[3:]
    principal_point = np.array(camera.parameters[1:3])
    if camera.distortion_at == "ideal":
        ideal = FRAME
        expected = principal_point + np.stack(distorted_with_partials(coefficients, *ideal.T)[:2], axis=1)
        expected += additional(camera, principal_point + ideal)
        found = np.stack(model.measured(*ideal.T), axis=1)
    else:
        expected = np.stack(corrected_with_partials(coefficients, *(FRAME - principal_point).T)[:2], axis=1)
        expected -= additional(camera, FRAME)
        found = np.stack(model.ideal(*FRAME.T), axis=1)
    assert np.abs(found - expected).max() < EXACT


@pytest.mark.parametrize("name", CAMERAS)
def test_there_and_back(name):
    model = camera_model(CAMERAS[name]).image
    back = np.stack(model.measured(*model.ideal(*FRAME.T)), axis=1)
    forth = np.stack(model.ideal(*model.measured(*FRAME.T)), axis=1)
    # Newton's method ends at 1e-9 mm at the latest
    assert np.abs(back - FRAME).max() < 1e-9
    assert np.abs(forth - FRAME).max() < 1e-9


@pytest.mark.parametrize("name", CAMERAS)
def test_numbers_are_as_arrays(name):
    model = camera_model(CAMERAS[name]).image
    for function in (model.ideal, model.measured):
        many = np.stack(function(*FRAME.T), axis=1)
        one = [function(x, y) for x, y in FRAME.tolist()]
        assert np.abs(many - one).max() < EXACT


@pytest.mark.parametrize("form", ["ideal", "measured"])
def test_beyond_the_turning_point_nothing_is_shown(form):
    """R - R³/300 rises up to R = 10 mm; the other form is its mirror image."""
    a3 = -1.0 / 300.0 if form == "ideal" else 1.0 / 300.0
    camera = replace(PLAIN_CAMERA, parameters=(50.0, 0.0, 0.0, 0.0, a3, *(0.0,) * 7), distortion_at=form)
    model = camera_model(camera).image
    closed, inverse = (model.measured, model.ideal) if form == "ideal" else (model.ideal, model.measured)
    assert closed(9.99, 0.0)[0] == pytest.approx(9.99 - 9.99**3 / 300.0, abs=EXACT)
    assert np.isnan(closed(10.01, 0.0)).all()
    assert np.isnan(closed(0.0, 17.0)).all()
    # the largest value is 10 - 10/3
    (below_turning,) = (root for root in np.roots([-1.0 / 300.0, 0.0, 1.0, -6.6]).real if 0.0 < root < 10.0)
    assert inverse(0.0, 6.6)[1] == pytest.approx(below_turning, abs=1e-9)
    assert np.isnan(inverse(6.67, 0.0)).all()
    assert np.isnan(inverse(np.array([6.67, 50.0]), np.zeros(2))).all()


def test_a_cubic_that_never_falls_has_no_reach():
    rising = DriveCamera("CAM", (50.0, 0.0, 0.0, 0.0, 1e-3, *(0.0,) * 7), (0.0, 0.0), "ideal")
    assert camera_model(rising).image.reach_square == np.inf
    assert camera_model(PLAIN_CAMERA).image.reach_square == np.inf


def test_no_frame_is_no_frame_line():
    assert camera_model(DriveCamera("CAM", LENS, (0.0, 24.0), "ideal")).half_frame == (np.inf, 12.0)
