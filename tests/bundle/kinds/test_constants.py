"""What is held stays as it was given, and what is disregarded is listed without influence."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import noisy, rows, solution, started_off
from support.synthetic_block import DISTORTED, synthetic_block

from orip.bundle.solve import solve_block
from orip.errors import NotSolvableError
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.photo import PHOTO_PARAMETERS
from orip.structs import replace

HELD = [
    ("X0",),
    ("X0", "Y0", "Z0"),
    ("KAPPA",),
    ("OMEGA",),
    ("PHI",),
    ("OMEGA", "KAPPA"),
    ("OMEGA", "PHI", "KAPPA"),
    ("Z0", "PHI"),
    PHOTO_PARAMETERS,
]


@pytest.mark.parametrize("held", HELD, ids=" ".join)
@pytest.mark.parametrize("scene", ["strip", "convergent"])
def test_constant_photo_elements_keep_their_values(scene, held):
    made = synthetic_block(scene, "held", noise_mm=0.005, start_error=0.005, constant=[(), held, held])
    found = solution(made.block)
    assert found.status in ("converged", "doubtful")
    places = [PHOTO_PARAMETERS.index(kind) for kind in held]
    given = made.block.photo_orientation[1:3]
    degrees = np.hstack([given[:, :3], np.degrees(given[:, 3:])])
    assert np.allclose(found.photos.values[1:3, places], degrees[:, places], rtol=0.0, atol=1e-9)
    assert np.isnan(found.photos.sd[1:3, places]).all()
    others = [place for place in range(6) if place not in places]
    assert np.isfinite(found.photos.sd[1:3, others]).all()
    assert np.isfinite(found.photos.sd[0]).all()
    # held at the truth they do no harm
    assert found.sigma0 == pytest.approx(1.0, abs=0.25)
    true = np.hstack([made.orientations[1:3, :3], np.degrees(made.orientations[1:3, 3:])])
    assert (np.abs(found.photos.values[1:3] - true)[:, others] < 5.0 * found.photos.sd[1:3][:, others] + 1e-9).all()


def test_unknowns_count_without_the_held_elements():
    free = solution(synthetic_block("convergent", "held", noise_mm=0.005).block)
    held = solution(synthetic_block("convergent", "held", noise_mm=0.005, constant=[("KAPPA", "X0"), ("PHI",)]).block)
    assert held.unknowns == free.unknowns - 3
    assert held.redundancy == free.redundancy + 3


@pytest.mark.parametrize("unknown", [("C",), ("DX", "DY"), ("C", "A3", "P1"), ("A3", "A5", "B1", "B2")], ids=" ".join)
def test_camera_parameters_that_are_not_unknown_keep_their_values(unknown):
    made = synthetic_block("convergent", "camera", noise_mm=0.005, unknown=unknown, distortion=DISTORTED)
    found = solution(made.block)
    held = [place for place, kind in enumerate(CAMERA_PARAMETERS) if kind not in unknown]
    free = [place for place, kind in enumerate(CAMERA_PARAMETERS) if kind in unknown]
    assert np.array_equal(found.cameras.values[0, held], made.cameras[0, held])
    assert np.isnan(found.cameras.sd[0, held]).all()
    assert (np.abs(found.cameras.values[0, free] - made.cameras[0, free]) < 4.0 * found.cameras.sd[0, free]).all()


def test_constant_control_keeps_its_coordinates():
    made = synthetic_block("terrestrial", "control", noise_mm=0.005, control="constant")
    found = solution(made.block)
    held = made.block.constant_points
    assert np.array_equal(found.points.values[held], made.points[held])
    assert np.isnan(found.points.sd[held]).all()
    assert np.isfinite(found.points.sd[~held]).all()


def test_a_single_constant_coordinate_of_a_point():
    made = aerial_block("control", 6)
    block = noisy(made, 1)
    constant = block.constant_points.copy()
    constant[1, 2] = True
    found = solution(replace(block, constant_points=constant))
    assert found.points.values[1, 2] == made.points[1, 2]
    assert np.isnan(found.points.sd[1]).tolist() == [False, False, True]


def test_all_constant_leaves_nothing_to_adjust():
    made = synthetic_block("convergent", "all", control="constant", constant=[PHOTO_PARAMETERS] * 8)
    block = replace(made.block, constant_points=np.ones((len(made.points), 3), dtype=bool))
    with pytest.raises(NotSolvableError, match="nothing to adjust"):
        solve_block(block, lambda _: None, lambda: False)


def with_negative_errors(block, name, wrong):
    return replace(
        block,
        control_points=tuple(
            replace(
                point,
                errors=tuple(-error for error in point.errors),
                coordinates=tuple(value + wrong for value in point.coordinates),
            )
            if point.name == name
            else point
            for point in block.control_points
        ),
    )


def test_a_check_point_is_compared_and_has_no_influence():
    made = aerial_block("check", 6)
    block = noisy(made, 1)
    name = block.control_points[2].name
    found = solution(with_negative_errors(block, name, 7.0))
    without = solution(
        replace(block, control_points=tuple(point for point in block.control_points if point.name != name))
    )
    assert np.array_equal(found.points.values, without.points.values)
    assert (found.sigma0, found.redundancy) == (without.sigma0, without.redundancy)
    (check,) = found.check_points
    assert check.name == name
    assert [check.dX, check.dY, check.dZ] == pytest.approx([-7.0] * 3, abs=0.4)
    mine = [row for row in rows(found, "control") if found.residuals.point[row] == name]
    assert np.isnan(found.residuals.weight_factor[mine]).all()
    assert found.residuals.residual[mine] == pytest.approx([check.dX, check.dY, check.dZ])


def test_one_disregarded_coordinate_of_a_control_point():
    made = aerial_block("check", 6)
    block = noisy(made, 1)
    first = block.control_points[0]
    x, y, _ = first.errors
    wrong = replace(first, errors=(x, y, -0.05), coordinates=(*first.coordinates[:2], first.coordinates[2] + 9.0))
    found = solution(replace(block, control_points=(wrong, *block.control_points[1:])))
    control = rows(found, "control")[:3]
    assert np.isnan(found.residuals.weight_factor[control]).tolist() == [False, False, True]
    assert found.residuals.residual[control[2]] == pytest.approx(-9.0, abs=0.4)
    assert found.check_points == ()


@pytest.mark.parametrize("components", [[True, True], [True, False]])
def test_disregarded_photo_points_are_listed_without_influence(components):
    made = aerial_block("check", 6)
    block = noisy(made, 1)
    points = block.photo_points
    used, xy = points.used.copy(), points.xy.copy()
    used[10] = ~np.array(components)
    xy[10, np.array(components)] += 1.0
    found = solution(replace(block, photo_points=replace(points, used=used, xy=xy)))
    same = solution(replace(block, photo_points=replace(points, used=used)))
    assert np.array_equal(found.points.values, same.points.values)
    lost = np.flatnonzero(components)
    assert np.isnan(found.residuals.weight_factor[20 + lost]).all()
    assert np.allclose(found.residuals.residual[20 + lost], same.residuals.residual[20 + lost] - 1.0, atol=1e-9)
    assert found.observations == solution(block).observations - len(lost)


@pytest.mark.parametrize("name", ["a", "b", "c"])
@pytest.mark.parametrize("start_error", [0.0, 0.05])
def test_photos_that_look_along_x_converge_to_the_truth(name, start_error):
    made = synthetic_block("terrestrial", name, noise_mm=0.005, start_error=start_error, start_down_weight=4)
    found = solution(made.block)
    assert found.status == "converged"
    assert len(found.iterations) < 12
    assert np.nanmin(found.residuals.weight_factor) == 1.0
    assert np.abs(found.photos.values[:, 4]) == pytest.approx(90.0, abs=0.2)
    assert (np.abs(found.points.values - made.points) < 5.0 * found.points.sd + 1e-9).all()
    assert (np.abs(found.photos.values[:, :3] - made.orientations[:, :3]) < 5.0 * found.photos.sd[:, :3]).all()


def test_without_noise_photos_along_x_have_their_deviations_about_the_ground_axes():
    found = solution(synthetic_block("terrestrial", "exact", start_error=0.02).block)
    assert np.abs(found.photos.values[:, 4]) == pytest.approx(90.0, abs=1e-4)
    assert all(found.photo_rotation_sd_about_axes)
    assert np.isfinite(found.photos.sd).all()


def test_a_point_behind_its_camera_is_left_out_and_named():
    made = synthetic_block("terrestrial", "behind", noise_mm=0.005)
    block = made.block
    # a point of the other wall, measured by mistake: some mm from the centre of the photo
    behind = int(np.flatnonzero(made.points[:, 0] < 0.0)[3])
    points = block.photo_points
    more = replace(
        points,
        photo=np.append(points.photo, 0),
        point=np.append(points.point, behind),
        xy=np.vstack([points.xy, [[5.0, 5.0]]]),
        error=np.vstack([points.error, [[0.005, 0.005]]]),
        used=np.vstack([points.used, [[True, True]]]),
    )
    without, found = solution(block), solution(replace(block, photo_points=more))
    assert found.status == "converged"
    assert np.allclose(found.points.values, without.points.values, atol=1e-7)
    assert (found.observations, found.redundancy) == (without.observations, without.redundancy)
    last = 2 * len(points.photo)
    assert np.isnan(found.residuals.weight_factor[[last, last + 1]]).all()
    (named,) = [diagnosis for diagnosis in found.diagnosis if diagnosis.code == "behind"]
    assert named.where == f"photo P1 point {block.point_names[behind]}"


def test_a_point_that_starts_behind_its_camera_comes_to_lie_in_front():
    made = aerial_block("behind", 6)
    block = started_off(made, noisy(made, 1), 2)
    start = block.point_start.copy()
    start[5, 2] = 1300.0
    found = solution(replace(block, point_start=start))
    assert found.status == "converged"
    # all of its rays are left out at first, and nothing moves it
    if found.singular:
        assert {unknown.name for unknown in found.singular} == {block.point_names[5]}
    else:
        assert np.abs(found.points.values[5] - made.points[5]).max() < 0.5
