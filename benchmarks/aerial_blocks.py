"""Seeded aerial blocks with one self-calibrated camera, and how long their adjustment takes.

    OPENBLAS_NUM_THREADS=1 python benchmarks/aerial_blocks.py 50 200

Photos overlap by 60 % along the strips and 30 % across, about 600 points are measured in each over rolling ground,
with a noise of half a pixel. C, DX, DY, A3 and A5 are unknown; orientations start off by 3 m and 0.3 degrees. Times are
CPU seconds, which other work on the machine hardly changes.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from orip.bundle.solve import SolvedBlock, solve_block
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo
from orip.structs import replace

PRINCIPAL_DISTANCE_MM = 120.0
FRAME_MM = (70.0, 100.0)
"""Along and across the direction of flight."""
TRUE_CAMERA = np.array([120.05, 0.03, -0.02, 0.0, 2e-7, 1e-11, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
NOISE_MM = 0.003
FLYING_HEIGHT = 1000.0
POINTS_A_PHOTO = 600
PHOTOS_A_CONTROL_POINT = 5
START_OFF = np.array([3.0] * 3 + [np.radians(0.3)] * 3)


def aerial_block(photos: int, points_a_photo: int = POINTS_A_PHOTO) -> Block:
    """Return the block of so many photos; the same at every call."""
    random = np.random.default_rng([photos, points_a_photo])
    orientations = _flown(photos, random)
    ground = _ground(orientations, points_a_photo, random)
    photo, point, xy = _images(orientations, ground)
    return seeded_block(random, orientations, ground, photo, point, xy, max(6, photos // PHOTOS_A_CONTROL_POINT))


def seeded_block(
    random: np.random.Generator, orientations: np.ndarray, ground: np.ndarray, photo: np.ndarray, point: np.ndarray,
    xy: np.ndarray, control_points: int,
) -> Block:  # fmt: skip
    """Return the block of true photo coordinates (n, 2): noise is added, and starting values are off.

    Without control points it is a free network.
    """
    used, point = np.unique(point, return_inverse=True)
    ground = ground[used]
    names = tuple(str(1001 + number) for number in range(len(ground)))
    control = np.linspace(0, len(ground) - 1, control_points).astype(int)
    xy = xy + NOISE_MM * random.normal(size=xy.shape)
    start = orientations + START_OFF * random.normal(size=orientations.shape)
    camera = (PRINCIPAL_DISTANCE_MM, *np.zeros(12).tolist())
    datum = "control" if control_points else "free"
    definition = BundleDefinition("BENCH", Precision(NOISE_MM), datum=datum, max_iterations=30, start_down_weight=30)
    return Block(
        definition=definition,
        cameras=(Camera("CAM", camera, unknown=("C", "DX", "DY", "A3", "A5"), frame=FRAME_MM),),
        photos=tuple(
            Photo(f"P{row + 1}", "CAM", orientation=tuple(np.r_[place[:3], np.degrees(place[3:])].tolist()))
            for row, place in enumerate(start)
        ),
        photo_camera=np.zeros(len(orientations), dtype=np.int64),
        photo_orientation=start,
        point_names=names,
        point_start=ground + 3.0 * random.normal(size=ground.shape),
        photo_points=IndexedPhotoPoints(photo, point, xy, np.full(xy.shape, NOISE_MM), np.ones(xy.shape, dtype=bool)),
        constant_points=np.zeros((len(ground), 3), dtype=bool),
        control_points=tuple(
            ControlPoint(names[index], tuple((ground[index] + 0.05 * random.normal(size=3)).tolist()), (0.05,) * 3)
            for index in control
        ),
    )


VARIANTS = ("free", "EBNER", "GRUEN", "fisheye")


def variant_of(block: Block, variant: str) -> Block:
    """Return a block as a free network, with a set of additional parameters, or with a fisheye camera.

    The photo coordinates stay those of the plain camera: how long an iteration takes does not depend on them.
    """
    if variant == "free":
        return replace(block, definition=replace(block.definition, datum="free"), control_points=())
    camera = block.cameras[0]
    fisheye = variant == "fisheye"
    varied = replace(camera, projection="equidistant") if fisheye else replace(camera, additional_set=variant)
    return replace(block, cameras=(varied,))


def _flown(photos: int, random: np.random.Generator) -> np.ndarray:
    """Return orientations (n, 6) of strips of about equal length and width."""
    base, distance = (np.array(FRAME_MM) * [0.4, 0.7] * FLYING_HEIGHT / PRINCIPAL_DISTANCE_MM).tolist()
    along = max(2, round(np.sqrt(photos * distance / base)))
    number = np.arange(photos)
    result = np.zeros((photos, 6))
    result[:, 0], result[:, 1], result[:, 2] = base * (number % along), distance * (number // along), FLYING_HEIGHT
    return result + random.normal(size=result.shape) * [5.0, 5.0, 5.0, *np.radians([1.0, 1.0, 2.0])]


def _ground(orientations: np.ndarray, points_a_photo: int, random: np.random.Generator) -> np.ndarray:
    """Return points (n, 3) of rolling ground, so many in the area of a photo."""
    reach = 0.5 * np.array(FRAME_MM) * FLYING_HEIGHT / PRINCIPAL_DISTANCE_MM
    low, high = orientations[:, :2].min(axis=0) - reach, orientations[:, :2].max(axis=0) + reach
    count = int(points_a_photo * np.prod(high - low) / np.prod(2.0 * reach))
    plan = random.uniform(low, high, size=(count, 2))
    # in the order of a reader who goes from place to place
    plan = plan[np.lexsort((plan[:, 0], np.floor(plan[:, 1] / 500.0)))]
    height = 40.0 * np.sin(plan[:, 0] / 400.0) * np.cos(plan[:, 1] / 300.0) + random.normal(size=count)
    return np.column_stack([plan, height])


def _images(orientations: np.ndarray, ground: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return photo (n,), point (n,) and true photo coordinates (n, 2) of points that two photos show at least."""
    reach = 0.7 * np.hypot(*FRAME_MM) * FLYING_HEIGHT / PRINCIPAL_DISTANCE_MM
    near = cKDTree(ground[:, :2]).query_ball_point(orientations[:, :2], reach)
    photo = np.repeat(np.arange(len(orientations)), [len(neighbours) for neighbours in near])
    point = np.concatenate([np.sort(np.array(neighbours, dtype=np.int64)) for neighbours in near])
    rotation = Rotation.from_euler("XYZ", orientations[:, 3:]).as_matrix()
    u = np.einsum("nji,nj->ni", rotation[photo], ground[point] - orientations[photo, :3])
    ideal = -TRUE_CAMERA[0] * u[:, :2] / u[:, 2:]
    r2 = np.sum(ideal**2, axis=1, keepdims=True)
    xy = TRUE_CAMERA[1:3] + ideal * (1.0 + r2 * (TRUE_CAMERA[4] + r2 * TRUE_CAMERA[5]))
    shown = (np.abs(xy) < np.array(FRAME_MM) / 2.0).all(axis=1)
    photo, point, xy = photo[shown], point[shown], xy[shown]
    often = np.bincount(point, minlength=len(ground))[point] >= 2
    return photo[often], point[often], xy[often]


def measured(block: Block) -> tuple[SolvedBlock, list[float], float]:
    """Return the adjusted block, the CPU seconds of its iterations, and those of the precision after the last one."""
    times = [time.process_time()]
    solved = solve_block(block, lambda _: times.append(time.process_time()), lambda: False)
    return solved, np.diff(times).tolist(), time.process_time() - times[-1]


def main() -> None:
    """Adjust blocks of the sizes given and print what they took."""
    print("photos    points  photo points  iterations  s/iteration  s/minimum  s/precision  MB peak     sigma0")
    for photos in [int(word) for word in sys.argv[1:]] or [50, 200]:
        block = aerial_block(photos)
        solved, times, precision = measured(block)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        print(
            f"{photos:6d} {len(block.point_names):9d} {len(block.photo_points.photo):13d} {len(times):11d} "
            f"{min(times):12.3f} {sum(times):10.3f} {precision:12.3f} {peak:8.0f} {solved.variance.sigma0:10.6f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
