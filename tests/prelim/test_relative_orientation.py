"""Relative orientation without initial values: published figures, known truth, standard deviations, blunders."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from orip.prelim.rays import ImageRays, photo_index
from orip.prelim.relative.orientation import orient_pair
from orip.records.preliminary import NotOriented, RelativeOrientation

ERROR = 0.005


def rays_of(left: np.ndarray, right: np.ndarray, c: float, error: float = ERROR) -> ImageRays:
    """Photos L and R with points 1 to n, and a third photo that has nothing to do with them."""
    n = len(left)
    xy = np.concatenate([left, right, [[1.0, 2.0]]])
    return ImageRays(
        ("L", "R", "X"), tuple(str(i + 1) for i in range(n)), np.repeat([0, 1, 2], [n, n, 1]),
        np.concatenate([np.arange(n), np.arange(n), [0]]), xy, np.hstack([xy, np.full((len(xy), 1), -c)]),
        np.full(len(xy), error),
    )  # fmt: skip


def orient(rays: ImageRays, left: int = 0, right: int = 1) -> RelativeOrientation | NotOriented:
    return orient_pair(rays, left, right, model="M1", row=1, column=2)


def oriented(rays: ImageRays, left: int = 0, right: int = 1) -> RelativeOrientation:
    found = orient(rays, left, right)
    assert isinstance(found, RelativeOrientation), found
    return found


class Scene:
    """Points in the left photo's system and what both photos see of them: formulas of docs/conventions.md, scipy's
    rotations."""

    def __init__(self, points: np.ndarray, base: tuple[float, ...], angles: tuple[float, ...], c: float) -> None:
        self.points, self.base, self.c = points, np.array(base, dtype=float), c
        # Rx Ry Rz of docs/conventions.md is scipy's intrinsic XYZ
        self.rotation = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
        self.left, self.right = self.image(np.zeros(3), np.eye(3)), self.image(self.base, self.rotation)

    def image(self, centre: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        u = (self.points - centre) @ rotation
        assert (u[:, 2] < 0.0).all()
        return -self.c * u[:, :2] / u[:, 2:]

    def measured(self, generator: np.random.Generator, noise: float = ERROR) -> tuple[np.ndarray, np.ndarray]:
        shape = self.left.shape
        return self.left + noise * generator.normal(size=shape), self.right + noise * generator.normal(size=shape)

    def off(self, found: RelativeOrientation) -> tuple[float, float]:
        """Angles between the rotations and between the bases, radians."""
        turn = Rotation.from_matrix(found.block.rotations[1] @ self.rotation.T).magnitude()
        directions = found.base / np.linalg.norm(found.base), self.base / np.linalg.norm(self.base)
        return turn, float(np.arcsin(min(np.linalg.norm(np.cross(*directions)), 1.0)))


def box(seed: int, count: int, low: tuple[float, ...], high: tuple[float, ...]) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def aerial(seed: int, count: int, relief: float = 15.0) -> Scene:
    points = box(seed, count, (-10.0, -100.0, -153.0 - relief), (100.0, 100.0, -153.0 + relief))
    return Scene(points, (92.0, 3.0, -2.0), (1.5, -1.0, 2.0), 153.0)


SCENES: dict[str, Callable[[], Scene]] = {
    "aerial": lambda: aerial(1, 20),
    "oblique and convergent": lambda: Scene(
        box(2, 15, (-12, -8, -45), (12, 8, -30)), (25, 4, -9), (4, 40, 7), 35.0
    ),
    "plane": lambda: Scene(
        box(3, 12, (-15, -15, -50), (15, 15, -50)), (20, 5, -3), (3, 18, -10), 50.0
    ),
    "upside down": lambda: Scene(box(4, 12, (-5, -5, -30), (25, 5, -20)), (20, 1, 0), (2, 1, 180), 50.0),
    "forward": lambda: Scene(box(5, 12, (-8, -8, -60), (8, 8, -30)), (0.3, -0.2, -15), (1, 2, 3), 50.0),
    "backward": lambda: Scene(box(5, 12, (-8, -8, -60), (8, 8, -30)), (0.3, -0.2, 15), (1, 2, 3), 50.0),
    "along y": lambda: Scene(box(6, 12, (-10, -10, -60), (10, 10, -40)), (0, 20, 0), (0, 0, 90), 50.0),
    "phi = 90": lambda: Scene(box(7, 12, (-5, -5, -35), (5, 5, -25)), (30, 0, -30), (0, 90, 0), 50.0),
    "phi = -90": lambda: Scene(box(8, 12, (-5, -5, -35), (5, 5, -25)), (-30, 0, -30), (0, -90, 0), 50.0),
    "opposite": lambda: Scene(box(9, 12, (-5, -5, -35), (5, 5, -25)), (3, 1, -60), (0, 180, 0), 50.0),
    "normal case": lambda: Scene(box(10, 12, (-5, -5, -35), (20, 5, -25)), (10, 0, 0), (0, 0, 0), 50.0),
}  # fmt: skip


# published and independent figures


def test_published_relative_orientation():
    """The verification data of a photogrammetry course (University of Calgary): C 152.15 mm, bx 92 mm."""
    left = [[106.399, 90.426], [18.989, 93.365], [70.964, 4.907], [-0.931, -7.284], [9.278, -92.926], [98.681, -62.769]]
    right = [
        [24.848, 81.824],
        [-59.653, 88.138],
        [-15.581, -0.387],
        [-85.407, -8.351],
        [-78.81, -92.62],
        [8.492, -68.873],
    ]
    found = oriented(rays_of(np.array(left), np.array(right), 152.15))
    # published: equal weights of the determinants. Weights of the parallaxes themselves differ by some per cent, which
    # with one redundant point moves the unknowns by a fiftieth of their standard deviations
    assert np.degrees(found.angles) == pytest.approx([0.4392, 1.5080, 3.1575], abs=3e-4)
    assert found.base / found.base[0] * 92.0 == pytest.approx([92.0, 5.0455, 2.1725], abs=1e-3)
    assert np.all(found.weight_factor == 1.0)
    # published models have parallaxes y left - y right of these signs; six points leave one pattern of residuals
    assert 1e3 * found.parallax == pytest.approx([-2.9, 1.9, 8.5, -6.4, 2.5, -3.6], abs=0.1)


def test_all_collinearity_equations_together_give_the_same():
    """Photo coordinates of Wolf and Dewitt's example; five elements and the points adjusted by scipy."""
    left = np.array(
        [[-4.87, 1.992], [89.296, 2.706], [0.256, 84.138], [90.328, 83.854], [-4.673, -86.815], [88.591, -85.269]]
    )
    right = np.array(
        [[-97.92, -2.91], [-1.485, -1.836], [-90.906, 78.98], [-1.568, 79.482], [-100.064, -95.733], [-0.973, -94.312]]
    )
    c, bx = 152.113, 91.974

    def residuals(x: np.ndarray) -> np.ndarray:
        rotation = Rotation.from_euler("XYZ", x[2:5]).as_matrix()
        points = x[5:].reshape(-1, 3)
        u = (points - [bx, x[0], x[1]]) @ rotation
        seen = [-c * points[:, :2] / points[:, 2:] - left, -c * u[:, :2] / u[:, 2:] - right]
        return np.concatenate(seen).ravel()

    start = np.concatenate([np.zeros(5), np.hstack([left, np.full((6, 1), -c)]).ravel()])
    whole = least_squares(residuals, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    cofactor = np.linalg.inv(whole.jac.T @ whole.jac)
    sigma = np.sqrt(whole.fun @ whole.fun / (24 - 23))
    found = oriented(rays_of(left, right, c))
    scale = bx / found.base[0]
    # the parallax is the residual to first order: the second order is (0.01 mm / 150 mm) of the residuals
    assert found.seuw * ERROR == pytest.approx(sigma, rel=1e-3)
    assert found.angles == pytest.approx(whole.x[2:5], abs=1e-3 * np.sqrt(cofactor[2, 2]) * sigma)
    assert scale * found.base[1:] == pytest.approx(whole.x[:2], abs=1e-3 * np.sqrt(cofactor[1, 1]) * sigma)
    deviations = sigma * np.sqrt(np.diag(cofactor))
    assert found.angle_deviation == pytest.approx(deviations[2:5], rel=2e-3)
    assert found.base_deviation * scale == pytest.approx([0.0, *deviations[:2]], rel=2e-3)
    # halfway between the rays, which differs from the least squares of photo coordinates by a tenth of its deviations
    # halfway between the rays, which is not quite the least squares of photo coordinates
    difference = found.block.coordinates - whole.x[5:].reshape(-1, 3) / scale
    assert (np.abs(difference) < 0.1 * found.block.deviations).all()


# known truth


@pytest.mark.parametrize("name", SCENES)
def test_truth_is_found_without_initial_values(name):
    scene = SCENES[name]()
    found = oriented(rays_of(scene.left, scene.right, scene.c))
    # coordinates of 100 mm are rounded to 1e-14 mm; the weakest of these geometries loses four digits
    assert max(scene.off(found)) < 1e-9
    scale = np.linalg.norm(found.base) / np.linalg.norm(scene.base)
    assert found.base == pytest.approx(scale * scene.base, abs=1e-10)
    assert found.block.coordinates == pytest.approx(scale * scene.points, rel=1e-8, abs=1e-9)
    assert found.in_front.all()
    assert np.abs(found.parallax).max() < 1e-10
    assert found.seuw < 1e-7
    assert np.array_equal(found.block.centres, [np.zeros(3), found.base])


def test_base_of_the_normal_case_is_the_mean_x_parallax():
    scene = SCENES["normal case"]()
    found = oriented(rays_of(scene.left, scene.right, scene.c))
    mean = (scene.left - scene.right)[:, 0].mean()
    assert found.base == pytest.approx([mean / 1000.0, 0.0, 0.0], abs=1e-9)
    assert found.base_deviation[0] == 0.0
    # a model at photo scale lies about as far below the photos as the principal distance
    assert -1000.0 * np.median(found.block.coordinates[:, 2]) == pytest.approx(scene.c, rel=0.1)


def test_largest_component_of_the_base_fixes_the_scale():
    scene = SCENES["forward"]()
    found = oriented(rays_of(*scene.measured(np.random.default_rng(1)), scene.c))
    assert found.base_deviation[2] == 0.0
    assert (found.base_deviation[:2] > 0.0).all()
    assert np.linalg.norm(found.base) > 0.01


def test_names_measured_coordinates_and_place_are_handed_on():
    scene = aerial(3, 8)
    rays = rays_of(scene.left, scene.right, scene.c)
    found = orient_pair(rays, 1, 0, model="M7", row=None, column=None, index=photo_index(rays))
    assert isinstance(found, RelativeOrientation)
    assert (found.model, found.left, found.right, found.row, found.column) == ("M7", "R", "L", None, None)
    assert found.points == tuple("12345678")
    assert np.array_equal(found.left_xy, scene.right)
    assert np.array_equal(found.right_xy, scene.left)
    assert np.array_equal(found.block.photos, [1, 0])
    assert any("to the left" in remark for remark in found.remarks)


def test_order_of_the_rays_does_not_matter():
    scene = aerial(4, 12)
    rays = rays_of(*scene.measured(np.random.default_rng(2)), scene.c)
    order = np.random.default_rng(3).permutation(len(rays.photo))
    mixed = ImageRays(
        rays.photos, rays.points, rays.photo[order], rays.point[order], rays.xy[order], rays.vectors[order],
        rays.error[order],
    )  # fmt: skip
    assert np.array_equal(oriented(mixed).parallax, oriented(rays).parallax)


# standard deviations


def test_scatter_of_repeated_measurements_is_the_predicted_one():
    scene = Scene(box(12, 10, (-12, -8, -45), (12, 8, -30)), (25, 4, -9), (4, 20, 7), 35.0)
    generator = np.random.default_rng(5)
    truth = oriented(rays_of(scene.left, scene.right, scene.c))
    normalised, redundant, parallaxes = [], [], []
    for _ in range(200):
        found = oriented(rays_of(*scene.measured(generator), scene.c))
        of_base = found.base / found.base[0] - truth.base / truth.base[0]
        deviations = np.concatenate([found.angle_deviation, (found.base_deviation / found.base[0])[1:]]) / found.seuw
        normalised.append(np.concatenate([found.angles - truth.angles, of_base[1:]]) / deviations)
        redundant.append(found.seuw**2)
        parallaxes.append(found.parallax * found.seuw / found.parallax_deviation)
    # a mean of 200 squares is within 1 ± 0.1, one standard deviation; with five tests 3.5 of them are allowed
    assert np.mean(np.square(normalised), axis=0) == pytest.approx(np.ones(5), abs=0.35)
    assert np.mean(redundant) == pytest.approx(1.0, abs=0.15)
    assert np.mean(np.square(parallaxes), axis=0) == pytest.approx(np.ones(10), abs=0.4)


def test_deviations_of_an_intersection_in_the_normal_case():
    scene = SCENES["normal case"]()
    found = oriented(rays_of(scene.left, scene.right, scene.c))
    x, y, z = found.block.coordinates.T
    px = scene.c * found.base[0] / -z
    # Z = -C b / px and Y = -Z (y left + y right) / 2 C, errors of four independent coordinates
    of_z = -z / px * np.sqrt(2.0) * ERROR
    of_y = np.hypot(-z / scene.c * ERROR / np.sqrt(2.0), y / z * of_z)
    of_x = np.hypot(-z / scene.c * ERROR / np.sqrt(2.0), (x - found.base[0] / 2.0) / z * of_z)
    assert found.block.deviations == pytest.approx(np.column_stack([of_x, of_y, of_z]), rel=1e-6)


# blunders


def test_misnumbered_point_is_named():
    scene = aerial(5, 14)
    left, right = scene.measured(np.random.default_rng(6))
    right[[3, 8]] = right[[8, 3]]
    found = oriented(rays_of(left, right, scene.c))
    assert set(np.flatnonzero(found.weight_factor < 1.0)) == {3, 8}
    assert any(remark.startswith("point 4 does not fit: py ") for remark in found.remarks)
    assert any(remark.startswith("point 9 does not fit: py ") for remark in found.remarks)
    assert {found.points[i] for i in (3, 8)}.isdisjoint(str(point + 1) for point in found.block.points)
    assert scene.off(found)[0] < 6.0 * np.linalg.norm(found.angle_deviation)
    assert found.max_residual < 0.03


@pytest.mark.parametrize(("seed", "count"), [(1, 16), (2, 16), (3, 40), (4, 40), (5, 100)])
def test_a_quarter_of_blunders(seed, count):
    scene = aerial(seed, count)
    generator = np.random.default_rng(seed)
    left, right = scene.measured(generator)
    bad = generator.choice(count, count // 4, replace=False)
    right[bad] = generator.uniform(-100.0, 100.0, (len(bad), 2))
    found = oriented(rays_of(left, right, scene.c))
    reduced = set(np.flatnonzero(found.weight_factor < 1.0))
    assert reduced <= set(bad)
    # a blunder along its epipolar line has no parallax; one in a hundred is that near to it
    assert len(reduced) >= len(bad) - 1
    assert scene.off(found)[0] < 6.0 * np.linalg.norm(found.angle_deviation)
    assert found.seuw == pytest.approx(1.0, abs=0.5)
    assert any("points do not fit: check point numbers" in remark for remark in found.remarks)


def test_camera_that_is_not_calibrated_is_no_blunder():
    scene = aerial(6, 30)
    left, right = scene.measured(np.random.default_rng(7), 15.0 * ERROR)
    found = oriented(rays_of(left, right, scene.c))
    assert np.all(found.weight_factor == 1.0)
    assert found.seuw == pytest.approx(15.0, rel=0.3)
    assert scene.off(found)[0] < 6.0 * np.linalg.norm(found.angle_deviation)
    assert any("is the camera calibrated?" in remark for remark in found.remarks)


def test_blunders_among_residuals_of_a_camera_that_is_not_calibrated():
    scene = aerial(7, 30)
    left, right = scene.measured(np.random.default_rng(8), 15.0 * ERROR)
    right[4] += [20.0, 30.0]
    right[17] += [10.0, -15.0]
    found = oriented(rays_of(left, right, scene.c))
    assert set(np.flatnonzero(found.weight_factor < 1.0)) == {4, 17}


def test_points_behind_a_photo_are_no_model_points():
    scene = aerial(8, 20)
    left, right = scene.measured(np.random.default_rng(9))
    # along the epipolar line to where the rays diverge: no parallax
    normal = SCENES["normal case"]()
    right_of_normal = normal.right.copy()
    right_of_normal[2, 0] = normal.left[2, 0] + 3.0
    found = oriented(rays_of(normal.left, right_of_normal, normal.c))
    assert not found.in_front[2]
    assert 2 not in found.block.points
    assert len(found.block.points) == 11
    assert "rays do not meet in front of both photos: point 3" in found.remarks
    assert oriented(rays_of(left, right, scene.c)).in_front.all()


# too little, and nothing


@pytest.mark.parametrize(("count", "points"), [(0, "0 points"), (1, "1 point"), (4, "4 points")])
def test_too_few_points(count, points):
    scene = aerial(9, 6)
    found = orient(rays_of(scene.left[:count], scene.right[:count], scene.c))
    assert found == NotOriented("M1", "", f"photo L and photo R share {points}, 5 are needed")


def test_photos_that_share_nothing():
    scene = aerial(9, 6)
    found = orient(rays_of(scene.left, scene.right, scene.c), 1, 2)
    assert isinstance(found, NotOriented)
    assert found.reason == "photo R and photo X share 1 point, 5 are needed"


def test_five_points_have_no_redundancy():
    scene = aerial(10, 5, relief=40.0)
    found = oriented(rays_of(*scene.measured(np.random.default_rng(10)), scene.c))
    assert found.seuw == 0.0
    assert np.all(found.parallax_deviation == 0.0)
    assert np.abs(found.parallax).max() < 1e-9
    assert (found.angle_deviation > 0.0).all()
    assert "five points: nothing checks the orientation" in found.remarks


def test_of_several_solutions_of_five_points_the_smallest_rotation_is_taken():
    # all of these have another solution with the five points in front; aerial photos are turned by a few degrees
    for seed in range(30):
        found = orient(rays_of(*(scene := aerial(seed, 5, relief=5.0)).measured(np.random.default_rng(seed)), scene.c))
        if isinstance(found, RelativeOrientation) and any("another orientation" in remark for remark in found.remarks):
            assert Rotation.from_matrix(found.block.rotations[1]).magnitude() < np.radians(20.0)
            return
    pytest.fail("no sample with two solutions")


@pytest.mark.parametrize("noise", [0.0, ERROR])
@pytest.mark.parametrize("angles", [(0, 0, 0), (3, 12, -20)])
def test_photos_from_one_place_have_no_base(noise, angles):
    scene = Scene(box(11, 15, (-8, -8, -60), (8, 8, -30)), (0, 0, 0), angles, 50.0)
    found = orient(rays_of(*scene.measured(np.random.default_rng(11), noise), scene.c))
    assert isinstance(found, NotOriented)
    assert "no base between them" in found.reason or "do not determine an orientation" in found.reason


def test_photos_from_one_place_with_blunders_have_no_base():
    scene = Scene(box(12, 20, (-8, -8, -60), (8, 8, -30)), (0, 0, 0), (3, 12, -20), 50.0)
    left, right = scene.measured(np.random.default_rng(12))
    right[[2, 5, 11]] += [[8.0, -5.0], [-4.0, 6.0], [10.0, 10.0]]
    found = orient(rays_of(left, right, scene.c))
    assert isinstance(found, NotOriented)
    assert "no base between them" in found.reason


@pytest.mark.parametrize("seed", range(6))
def test_points_without_any_connection_are_refused(seed):
    generator = np.random.default_rng(seed)
    found = orient(rays_of(*generator.uniform(-100.0, 100.0, (2, 15, 2)), 153.0))
    assert isinstance(found, NotOriented)
    assert "point numbers or photos confused" in found.reason or "in front of both" in found.reason


def test_equal_input_gives_equal_results():
    scene = aerial(13, 30)
    rays = rays_of(*scene.measured(np.random.default_rng(13)), scene.c)
    one, other = oriented(rays), oriented(rays)
    assert np.array_equal(one.parallax, other.parallax)
    assert np.array_equal(one.angles, other.angles)
    assert one.iterations == other.iterations
