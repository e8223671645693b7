"""Cameras that move together: their relative orientation, its standard deviations, and no other cameras'."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.solving import solved
from scipy.spatial.transform import Rotation

from orip.bundle.results.covariance import covariance, photo_figures
from orip.bundle.results.further_records import RIG_PARAMETERS, rig_estimates
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import ControlPoint, Station
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo
from orip.report.photos import rig_table
from orip.structs import replace

BASE, TURN = np.array([0.8, 0.02, -0.05]), np.array([1.5, -6.0, 0.4])
INSTANTS = 8
C, ERROR = 20.0, 0.002


def block(seed: int, *, turn: np.ndarray = TURN, fixed: bool = True) -> Block:
    """Return photos of two facades at right angles taken by two cameras, in a frame or each by itself."""
    random = np.random.default_rng(seed)
    x, z = np.meshgrid(np.linspace(-4.0, 16.0, 13), np.linspace(-3.0, 6.0, 5))
    facade = np.stack([x, 10.0 + 1.5 * np.sin(3.0 * x + z), z], axis=-1).reshape(-1, 3)
    points = np.vstack([facade, facade[:, [1, 0, 2]] * (1.3, 1.0, 1.0) + (8.0, -10.0, 0.0)])
    poses = []
    for instant in range(INSTANTS):
        centre, pose = (
            np.array([1.5 * instant, 0.3 * np.sin(instant), 1.7]),
            Rotation.from_euler("XYZ", [88.0, 3.0 * np.sin(instant), 2.0 * (-1.0) ** instant], degrees=True),
        )
        base = BASE if fixed else BASE + np.random.default_rng(instant).normal(size=3)
        poses += [(centre, pose), (centre + pose.apply(base), pose * Rotation.from_euler("XYZ", turn, degrees=True))]
    images = [(photo, *_images(points, *pose)) for photo, pose in enumerate(poses)]
    photo = np.concatenate([np.full(len(seen), row) for row, seen, _ in images])
    point, xy = (np.concatenate([image[part] for image in images]) for part in (1, 2))
    # R = Rx Ry Rz: intrinsic turns about x, y, z
    orientation = np.array([[*centre, *pose.as_euler("XYZ")] for centre, pose in poses])
    names = tuple(f"T{row}" for row in range(len(points)))
    known = range(0, len(points), 6)
    return Block(
        definition=BundleDefinition("RIG", Precision(ERROR), start_down_weight=30, max_iterations=30),
        cameras=tuple(Camera(name, (C, *(0.0,) * 12), unknown=("C", "DX")) for name in ("LEFT", "RIGHT")),
        photos=tuple(
            Photo(f"{'LR'[row % 2]}_{row // 2:04d}.jpg", ("LEFT", "RIGHT")[row % 2]) for row in range(len(poses))
        ),
        photo_camera=np.arange(len(poses)) % 2,
        photo_orientation=orientation,
        point_names=names,
        point_start=points.copy(),
        photo_points=IndexedPhotoPoints(
            photo, point, xy + ERROR * random.normal(size=xy.shape), np.full(xy.shape, ERROR), np.ones(xy.shape, bool)
        ),
        constant_points=np.zeros(points.shape, dtype=bool),
        control_points=tuple(
            ControlPoint(names[row], tuple((points[row] + 0.01 * random.normal(size=3)).tolist()), (0.01,) * 3)
            for row in known
        ),
    )


def _images(points: np.ndarray, centre: np.ndarray, pose: Rotation) -> tuple[np.ndarray, np.ndarray]:
    u = pose.inv().apply(points - centre)
    xy = -C * u[:, :2] / u[:, 2:]
    seen = np.flatnonzero((u[:, 2] < 0.0) & (np.abs(xy) < (18.0, 12.0)).all(axis=1))
    return seen, xy[seen]


def figures(found: SolvedBlock) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the values, standard deviations and scatters of the only rig."""
    rows = rig_estimates(found)
    assert [row.name for row in rows] == list(RIG_PARAMETERS)
    assert {(row.first, row.second, row.instants) for row in rows} == {("LEFT", "RIGHT", INSTANTS)}
    return tuple(np.array([getattr(row, name) for row in rows]) for name in ("value", "sd", "scatter"))


def mean_pose(photos: np.ndarray) -> np.ndarray:
    """Return the mean base and angles (degrees) from the X0 to KAPPA (m, degrees) of left and right photos in turn."""
    pose = Rotation.from_euler("XYZ", photos[:, 3:], degrees=True)
    base = pose[::2].inv().apply(photos[1::2, :3] - photos[::2, :3])
    return np.r_[base.mean(axis=0), (pose[::2].inv() * pose[1::2]).mean().as_euler("XYZ", degrees=True)]


def test_values_are_those_of_the_frame() -> None:
    values, sd, _ = figures(solved(block(1)))
    # within four standard deviations
    assert np.abs((values - np.r_[BASE, TURN]) / sd).max() < 4.0


def test_standard_deviations_are_those_propagated_from_all_photos() -> None:
    found = solved(block(2))
    values, sd, _ = figures(found)
    photos = solution_of(found).photos.values
    assert values == pytest.approx(mean_pose(photos), abs=1e-9)
    records = [photo_figures(found, photo) for photo in range(len(photos))]
    partials, step = np.zeros((6, photos.size)), 1e-5
    for place in range(photos.size):
        change = np.zeros(photos.size)
        change[place] = step
        after, before = (mean_pose(photos + sign * change.reshape(photos.shape)) for sign in (1.0, -1.0))
        partials[:, place] = (after - before) / (2.0 * step)
    wanted = np.sqrt(np.diag(partials @ covariance(found, records, records) @ partials.T))
    # differences are right to some 1e-9, and differ by the scatter of the rotations from the linear mean
    assert sd == pytest.approx(wanted, rel=1e-4)


@pytest.mark.long
def test_standard_deviations_are_those_of_repeated_measurements() -> None:
    results = [figures(solved(block(seed))) for seed in range(100, 140)]
    spread = np.std([values for values, *_ in results], axis=0, ddof=1)
    # with 40 repetitions the ratio is within a third of one in all but three of a thousand cases
    assert spread / np.mean([sd for _, sd, _ in results], axis=0) == pytest.approx(np.ones(6), abs=0.36)
    # what the cameras' unknowns do to all instants alike shows in no scatter
    of_scatter = np.mean([scatter for *_, scatter in results], axis=0) / np.sqrt(INSTANTS)
    assert (spread > 1.5 * of_scatter).any()


def test_a_camera_that_looks_sideways_has_rotations_about_the_axes() -> None:
    values, sd, scatter = figures(solved(block(3, turn=np.array([0.0, -90.0, 0.0]))))
    assert values[4] == pytest.approx(-90.0, abs=0.1)
    # omega and kappa have no standard deviations there
    assert (sd[3:] < 10.0 * scatter[3:]).all()


def test_instants_are_those_of_the_stations_where_they_are_known() -> None:
    made = block(4)
    shuffled = replace(
        made,
        photos=tuple(
            replace(photo, name=f"{photo.name[0]}_{97 - 5 * row}.jpg") for row, photo in enumerate(made.photos)
        ),
    )
    assert not rig_estimates(solved(shuffled))
    far = (1e3,) * 3
    stations = tuple(
        Station(photo.name, (0.0, 0.0, 0.0), far, time=100.0 + row // 2) for row, photo in enumerate(shuffled.photos)
    )
    assert len(rig_estimates(solved(replace(shuffled, stations=stations)))) == len(RIG_PARAMETERS)


def test_photos_that_are_constant_have_no_standard_deviation() -> None:
    made = block(5)
    held = tuple(replace(photo, constant=("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")) for photo in made.photos)
    assert np.isnan(figures(solved(replace(made, photos=held)))[1]).all()


def test_cameras_that_only_have_equal_numbers_are_no_rig() -> None:
    assert not rig_estimates(solved(block(6, fixed=False)))


def test_the_report_has_them_in_a_table() -> None:
    solution = solution_of(solved(block(7)))
    table = rig_table(solution)
    assert table is not None
    cells = {column.heading: column.cells[0] for column in table.columns}
    assert (cells["Cameras"], cells["Instants"]) == ("LEFT, RIGHT", str(INSTANTS))
    value, sd = map(float, cells["BX"].split(" ± "))
    row = solution.rigs[0]
    assert (value, sd) == pytest.approx((row.value, row.sd), rel=0.05)
    assert rig_table(replace(solution, rigs=())) is None
