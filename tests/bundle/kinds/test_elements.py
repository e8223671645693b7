"""Observed unknowns of cameras, photos, points and theodolite sets."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import OFF, directions_from, noisy, redefined, rows, solution, solved
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

from orip.errors import InputError
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import ControlElement
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace

MADE = aerial_block("elements", 6)


def observed(name, group, kind, value, error, block=None):
    block = noisy(MADE, 1) if block is None else block
    return replace(redefined(block, **OFF), elements=(ControlElement(name, group, kind, float(value), error),))


def true_angle(kind, photo=4):
    return float(np.degrees(MADE.orientations[photo, PHOTO_PARAMETERS.index(kind)]))


@pytest.mark.parametrize("kind", ["X0", "Y0", "Z0"])
def test_a_precise_projection_centre_draws_the_photo_to_it(kind):
    place = PHOTO_PARAMETERS.index(kind)
    value = MADE.orientations[4, place] + 0.5
    found = solution(observed("P5", "PHOTO", kind, value, 1e-4))
    assert found.photos.values[4, place] == pytest.approx(value, abs=1e-3)
    row = rows(found, "element")
    assert found.residuals.photo[row[0]] == "P5"
    assert found.residuals.component[row[0]] == kind
    assert found.residuals.residual[row] == pytest.approx(found.photos.values[4, place] - value, abs=1e-9)


@pytest.mark.parametrize("kind", ["OMEGA", "PHI", "KAPPA"])
def test_a_precise_angle_draws_the_photo_to_it(kind):
    value = true_angle(kind) + 0.02
    found = solution(observed("p5", "PHOTO", kind, value, 1e-6))
    assert found.photos.values[4, PHOTO_PARAMETERS.index(kind)] == pytest.approx(value, abs=1e-5)
    assert found.photos.sd[4, PHOTO_PARAMETERS.index(kind)] == pytest.approx(1e-6 * found.sigma0, rel=0.01)


def test_an_angle_beyond_the_turn_is_the_same_angle():
    value = true_angle("KAPPA") + 0.01
    near, far = (solution(observed("P5", "PHOTO", "KAPPA", value + turn, 1e-3)) for turn in (0.0, 360.0))
    assert np.allclose(near.points.values, far.points.values, atol=1e-9)
    assert far.residuals.residual[rows(far, "element")] == pytest.approx(near.residuals.residual[rows(near, "element")])


def test_a_single_angle_of_photos_at_phi_90_is_refused_and_all_photos_are_named():
    made = synthetic_block("terrestrial", "elements")
    block = replace(made.block, elements=tuple(ControlElement(f"P{n}", "PHOTO", "KAPPA", 0.0, 0.1) for n in (1, 2)))
    with pytest.raises(InputError, match=r"KAPPA of photo P1 and KAPPA of photo P2 are observed.*all three angles"):
        solution(block)


def test_a_single_angle_at_phi_90_without_weight_is_no_obstacle():
    made = synthetic_block("terrestrial", "elements")
    assert solved(observed("P1", "PHOTO", "KAPPA", -90.0, -0.1, made.block)).converged


@pytest.mark.parametrize("split", [0.0, 25.0])
def test_three_angles_at_phi_90_are_one_rotation(split):
    """Exactly at the pole only the sum of omega and kappa counts; the residuals are turns about the ground axes."""
    made = synthetic_block("terrestrial", "elements")
    omega, phi, kappa = np.degrees(made.orientations[0, 3:])
    turn = np.radians(0.3)
    angles = (omega + split + 0.3, phi, kappa - np.sign(phi) * split)
    given = Rotation.from_rotvec([turn, 0.0, 0.0]) * Rotation.from_euler("XYZ", [omega, phi, kappa], degrees=True)

    def found_with(error):
        elements = (
            ControlElement("P1", "PHOTO", kind, float(value), error)
            for kind, value in zip(("OMEGA", "PHI", "KAPPA"), angles, strict=True)
        )
        return replace(redefined(made.block, **OFF), elements=tuple(elements))

    assert solved(found_with(1e-6)).state.rotations[0] == pytest.approx(given.as_matrix(), abs=1e-6)
    loose = solution(found_with(10.0))
    assert loose.residuals.residual[rows(loose, "element")] == pytest.approx([-0.3, 0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize("kind", ["X", "Y", "Z"])
def test_a_precise_coordinate_draws_the_point_to_it(kind):
    place = "XYZ".index(kind)
    value = MADE.points[1, place] + 0.2
    found = solution(observed("102", "POINT", kind, value, 1e-4))
    assert found.points.values[1, place] == pytest.approx(value, abs=1e-3)
    assert found.residuals.point[rows(found, "element")[0]] == "102"


@pytest.mark.parametrize(("kind", "unknown"), [("C", ("C",)), ("DX", ("C", "DX", "DY")), ("A3", ("A3",))])
def test_an_observed_camera_parameter_keeps_it_near_its_value(kind, unknown):
    place = CAMERA_PARAMETERS.index(kind)
    block = noisy(MADE, 1)
    block = replace(block, cameras=(replace(block.cameras[0], unknown=unknown),))
    free = solution(redefined(block, **OFF))
    sd = float(free.cameras.sd[0, place])
    value = free.cameras.values[0, place] + sd
    held = solution(observed("cam", "CAMERA", kind, value, 1e-3 * sd, block))
    assert held.cameras.values[0, place] == pytest.approx(value, abs=1e-3 * sd)
    # an observation as good as the photos' own answer is met half way
    even = solution(observed("CAM", "CAMERA", kind, value, sd / free.sigma0, block))
    assert even.cameras.values[0, place] == pytest.approx(value - sd / 2.0, abs=0.02 * sd)


def test_the_zero_direction_of_a_theodolite_set():
    block = directions_from(MADE, noisy(MADE, 1), "102", ("111", "123"), zero=40.0, error=0.05)
    found = solution(observed("S", "THEODOLITE", "R", 40.3, 1e-4, block))
    row = rows(found, "element")
    assert found.residuals.component[row[0]] == "R"
    assert found.residuals.residual[row] == pytest.approx([0.0], abs=1e-3)
    # the directions are a third of a degree off, against the photos that know better
    direction = [row for row in rows(found, "direction") if found.residuals.component[row] == "direction"]
    assert np.allclose(found.residuals.residual[direction], -0.3, atol=0.02)


@pytest.mark.parametrize(
    ("name", "group", "kind", "value"),
    [
        ("P5", "PHOTO", "Z0", 0.0),
        ("P5", "PHOTO", "KAPPA", 77.0),
        ("102", "POINT", "X", 0.0),
        ("CAM", "CAMERA", "C", 99.0),
    ],
)
def test_a_disregarded_element_is_listed_without_influence(name, group, kind, value):
    without = solution(redefined(noisy(MADE, 1), **OFF))
    found = solution(observed(name, group, kind, value, -0.1))
    (row,) = rows(found, "element")
    assert abs(found.residuals.residual[row]) > 10.0
    assert np.isnan(found.residuals.weight_factor[row])
    assert np.array_equal(found.points.values, without.points.values)
    assert (found.redundancy, found.sigma0) == (without.redundancy, without.sigma0)


def test_an_element_gives_redundancy_and_redundancy_numbers_still_sum_up():
    without = solution(redefined(noisy(MADE, 1), **OFF))
    found = solution(observed("P5", "PHOTO", "Z0", MADE.orientations[4, 2], 0.05))
    assert found.redundancy == without.redundancy + 1
    assert abs(np.nansum(found.residuals.redundancy_number) - found.redundancy) < 1e-8


def test_projection_centres_can_stand_in_for_control():
    block = replace(redefined(noisy(MADE, 1), **OFF), control_points=())
    elements = tuple(
        ControlElement(photo.name, "PHOTO", kind, float(value), 0.02)
        for photo, row in zip(block.photos, MADE.orientations, strict=True)
        for kind, value in zip(("X0", "Y0", "Z0"), row[:3], strict=True)
    )
    found = solution(replace(block, elements=elements))
    assert found.singular == ()
    assert found.status == "converged"
    assert np.abs(found.points.values - MADE.points).max() < 1.0
