"""The loop equations: against images that orip did not compute, and closed in both directions."""

from __future__ import annotations

import numpy as np
import pytest
from support.drive_tables import LIMITS, cameras, loaded, vertical_block
from support.synthetic_block import DISTORTED, synthetic_block

from orip.geometry.rays import intersect_rays
from orip.geometry.rotation import rotation_from_angles
from orip.multimodel.photo_loop import camera_model, driven_photo
from orip.records.drive_table import DriveCamera, DriveCode, DrivePhoto, StageLimits
from orip.structs import replace

CAMERAS = cameras()
WIDE = StageLimits(-1000.0, 1000.0, -1000.0, 1000.0, 0.001)
TURNED = (100.0, 0.6, -0.81, 120.0, 0.79, 0.61)


@pytest.mark.parametrize("form", ["ideal", "measured"])
@pytest.mark.parametrize("scene", ["strip", "convergent", "terrestrial"])
def test_images_of_a_block_that_was_made_with_other_formulas(scene, form):
    truth = synthetic_block(scene, "drive", distortion=DISTORTED, distortion_at=form)
    points, (camera,) = truth.block.photo_points, truth.cameras
    model = camera_model(DriveCamera("CAM", tuple(camera[:-1].tolist()), (0.0, 0.0), form))
    for row, orientation in enumerate(truth.orientations):
        rotation = tuple(rotation_from_angles(orientation[3:]).ravel().tolist())
        photo = DrivePhoto("P", "CAM", None, "UPPER", tuple(orientation[:3].tolist()), rotation, TURNED)
        mine = points.photo == row
        found = driven_photo(photo, model, WIDE).plate_places(truth.points[points.point[mine]])
        a0, a1, a2, b0, b1, b2 = TURNED
        x, y = points.xy[mine].T
        expected = np.stack([a0 + a1 * x + a2 * y, b0 + b1 * x + b2 * y], axis=1)
        assert not found.code.any()
        # coordinates of kilometres are rounded to 5e-13 m, C / distance takes that to the photo
        assert np.abs(found.plate - expected).max() < 1e-9


def object_points(count=200):
    """Return points that all models of two strips of four show, three dimensions of them."""
    return np.random.default_rng(3).uniform([1.0, -70.0, -5.0], [79.0, 22.0, 5.0], (count, 3))


@pytest.mark.parametrize("name", CAMERAS)
def test_object_plate_object(name):
    block, _ = loaded(vertical_block(camera=CAMERAS[name], tilted=True))
    for model in block.models:
        shown = [photo.plate_places(object_points()) for photo in model.photos]
        on_both = (shown[0].code == 0) & (shown[1].code == 0)
        assert on_both.sum() > 20
        upper, lower = (shown[1], shown[0]) if model.swapped else shown
        back = model.object_places(upper.plate[on_both], lower.plate[on_both])
        assert not back.code.any()
        # 1e-9 mm on the plate is 2e-9 m on the ground, and some five times that in height
        assert np.abs(back.xyz - object_points()[on_both]).max() < 1e-8
        assert np.abs(back.y_parallax).max() < 1e-9


@pytest.mark.parametrize("name", CAMERAS)
def test_plate_object_plate(name):
    """A plate position, taken along its ray to any depth, comes back to 1e-9 mm."""
    block, _ = loaded(vertical_block(camera=CAMERAS[name], tilted=True))
    for photo in block.photos:
        x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-9.9, 9.9, 9), np.linspace(-11.9, 11.9, 9)))
        plate = np.stack(photo.plate_of_photo(x, y), axis=1)
        rays = photo.rays(plate)
        assert not rays.code.any()
        for depth in (1.5, 2.0):
            back = photo.plate_places(np.array(photo.centre) + depth * rays.direction)
            assert np.abs(back.plate - plate).max() < 1e-9


@pytest.mark.parametrize("name", CAMERAS)
def test_one_point_is_as_many(name):
    block, _ = loaded(vertical_block(camera=CAMERAS[name], tilted=True))
    points = np.vstack([object_points(50), [[40.0, -24.0, 200.0], [500.0, 0.0, 0.0], [0.0, 0.0, 100.0]]])
    for photo in block.photos[:3]:
        many = photo.plate_places(points)
        for row, point in enumerate(points.tolist()):
            one = photo.plate_place(*point)
            assert (one.code, one.inside) == (many.code[row], many.inside[row])
            if one.code != DriveCode.BEHIND_CAMERA:
                assert np.allclose(one.plate, many.plate[row], rtol=0.0, atol=1e-9, equal_nan=True)
    model = block.models[0]
    plates = [photo.plate_places(object_points()).plate for photo in model.photos]
    many = model.object_places(*plates)
    for row, (upper, lower) in enumerate(zip(*(plate.tolist() for plate in plates), strict=True)):
        one = model.object_place(tuple(upper), tuple(lower))
        assert one.code == many.code[row]
        assert np.allclose(one.xyz, many.xyz[row], rtol=0.0, atol=1e-9, equal_nan=True)


def test_place_with_the_least_squares_to_rays_that_do_not_meet():
    block, _ = loaded(vertical_block(tilted=True))
    model = block.models[0]
    random = np.random.default_rng(5)
    upper, lower = (photo.plate_places(object_points()).plate + random.normal(size=(200, 2)) for photo in model.photos)
    found = model.object_places(upper, lower)
    left, right = model.photos
    origins = np.repeat([left.centre, right.centre], len(upper), axis=0)
    directions = np.vstack([left.rays(upper).direction, right.rays(lower).direction])
    expected = intersect_rays(origins, directions, np.tile(np.arange(len(upper)), 2), len(upper))
    # rays that meet at some 5 to 15 degrees lose two digits of 1e-14
    assert np.abs(found.xyz - expected).max() < 1e-9


def test_y_parallax_in_the_normal_case():
    """Level photos from one height: the y-parallax is the difference of the photo's y coordinates."""
    block, _ = loaded(vertical_block())
    left, right = block.models[0].photos
    found = block.models[0].object_place(left.plate_of_photo(5.0, 1.0), right.plate_of_photo(-5.0, 0.9))
    assert found.y_parallax == pytest.approx(0.1, abs=1e-12)
    # x-parallax 10 mm: B C / px = 100 m below the centres; as the rays miss by 0.2 m, some millimetres beside that
    assert found.xyz == pytest.approx((10.0, 1.9, 0.0), abs=0.02)


def test_rays_that_are_parallel_or_part():
    block, _ = loaded(vertical_block())
    model = block.models[0]
    left, right = model.photos
    parallel = model.object_place(left.plate_of_photo(5.0, 1.0), right.plate_of_photo(5.0, 1.0))
    parting = model.object_place(left.plate_of_photo(-5.0, 1.0), right.plate_of_photo(5.0, 1.0))
    assert (parallel.code, parting.code) == (DriveCode.PARALLEL_RAYS, DriveCode.BEHIND_CAMERA)
    plates = [np.array([photo.plate_of_photo(x, 1.0) for x in xs]) for photo, xs in ((left, (5, -5)), (right, (5, 5)))]
    assert model.object_places(*plates).code.tolist() == [DriveCode.PARALLEL_RAYS, DriveCode.BEHIND_CAMERA]


def test_codes_of_points_that_cannot_be_driven_to():
    lens = replace(CAMERAS["ideal"], parameters=(50.0, 0.0, 0.0, 0.0, -1.0 / 1200.0, *(0.0,) * 7))
    block, _ = loaded(vertical_block(camera=lens))
    photo = block.photos[0]
    points = {
        (0.0, 0.0, 100.0): DriveCode.BEHIND_CAMERA,
        (0.0, 0.0, 101.0): DriveCode.BEHIND_CAMERA,
        (0.0, 0.0, 0.0): DriveCode.NONE,
        # 25 mm from the middle, where the lens reaches 20 mm
        (50.0, 0.0, 0.0): DriveCode.NOT_INVERTIBLE,
    }
    for point, code in points.items():
        assert photo.plate_place(*point).code == code
    assert photo.plate_places(np.array(list(points))).code.tolist() == list(points.values())
    assert np.isnan(photo.plate_places(np.array([(50.0, 0.0, 0.0)])).plate).all()


def test_limits_belong_to_the_stage():
    table = vertical_block()
    upper = replace(LIMITS, x_max=30.0)
    block, _ = loaded(replace(table, upper=upper))
    photo = block.photos[0]
    on_the_limit = photo.ray(30.0, 60.0)
    assert on_the_limit is not None
    beyond = photo.ray(30.001, 60.0)
    points = np.array(photo.centre) + 2.0 * np.array([on_the_limit, beyond]) - [[1e-9, 0.0, 0.0]]
    assert photo.plate_places(points).code.tolist() == [DriveCode.NONE, DriveCode.OUTSIDE_STAGE]


def test_what_is_surely_not_inside_never_is():
    for camera in CAMERAS.values():
        block, _ = loaded(vertical_block(camera=camera, tilted=True))
        points = np.random.default_rng(2).uniform([-60, -120, -20], [140, 80, 90], (5000, 3))
        for photo in block.photos:
            inside = photo.plate_places(points).inside
            assert inside.any()
            assert not (inside & ~photo.may_be_inside(*points.T)).any()


def test_model_axes():
    block, _ = loaded(vertical_block(tilted=True))
    for model in block.models:
        assert model.model_of_object(*model.photos[1].centre)[1:] == pytest.approx((0.0, 0.0), abs=1e-12)
        base = np.linalg.norm(np.subtract(model.photos[1].centre, model.photos[0].centre))
        assert model.model_of_object(*model.photos[1].centre)[0] == pytest.approx(base, abs=1e-12)
        assert model.object_of_model(*model.model_of_object(1.0, 2.0, 3.0)) == pytest.approx((1.0, 2.0, 3.0), abs=1e-12)
        axes = np.array(model.axes).reshape(3, 3)
        assert np.linalg.det(axes) == pytest.approx(1.0, abs=1e-12)
        # vertical photos: z points up, towards the cameras
        assert axes[2, 2] > 0.95


def test_a_fisheye_photo_is_driven_to_what_is_beside_and_behind_it():
    # C theta: 15.7 mm at 90 degrees, 20.9 mm at 120
    camera = replace(CAMERAS["fisheye ideal"], parameters=(10.0, *[0.0] * 11), frame=(42.0, 42.0))
    block, _ = loaded(vertical_block(camera=camera))
    photo = block.photos[0]
    for angle, expected in ((90.0, 10.0 * np.pi / 2.0), (115.0, 10.0 * np.radians(115.0))):
        direction = np.array([np.sin(np.radians(angle)), 0.0, -np.cos(np.radians(angle))])
        point = np.array(photo.centre) + 70.0 * direction
        found = photo.plate_place(*point.tolist())
        assert (found.code, found.inside) == (0, True)
        assert photo.photo_of_plate(*found.plate) == pytest.approx((expected, 0.0), abs=1e-12)
        assert photo.may_be_inside(*point.tolist())
        assert np.asarray(photo.ray(*found.plate)) / 10.0 == pytest.approx(direction, abs=1e-12)
        many = photo.plate_places(point[None])
        assert many.plate[0] == pytest.approx(found.plate, abs=1e-12)
        assert many.inside.tolist() == [True]
    x, y, z = photo.centre
    behind = np.array([x, y, z + 50.0])
    assert photo.plate_place(*behind.tolist()).code == DriveCode.BEHIND_CAMERA
    assert not photo.may_be_inside(*behind.tolist())
