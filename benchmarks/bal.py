"""Problems of the collection Bundle Adjustment in the Large (Agarwal et al. 2010) as blocks.

Their cameras look along -z, with the principal point in the origin:

    p = R X + t;   p = -(p1, p2) / p3;   pixels = f (1 + k1 |p|^2 + k2 |p|^4) p

which is the camera model of orip with C = f, A3 = k1 / f^2, A5 = k2 / f^4 at ideal coordinates, a pixel in the place of
a millimetre. Each photo has a camera of its own. The first photo is held and one coordinate of the photo farthest from
it, as there is no control.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from orip.geometry.rotation import angles_from_rotation
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo

LADYBUG = Path(__file__).parents[2] / "shared" / "reference-data" / "bal" / "problem-49-7776-pre.txt"
ALL_RAYS_COST = 13344.24
"""Half the sum of squares at the published minimum, pixels squared."""
RAYS_FROM_BEHIND = 31
"""Of ten points behind each of their cameras, at the start and there: the formula has residuals for them, but no camera
can see them."""
MINIMUM_COST = 13308.40594
"""Without these rays, which neither orip nor pycolmap counts. Points at infinity let it fall on and on: orip finds that
nothing determines how far eleven of them are, and leaves them where they are, some 1e-8 above this."""
COST_TOLERANCE = 0.005 / ALL_RAYS_COST
"""Relative: half the last digit of the published cost."""

_AXES = ("X0", "Y0", "Z0")
_ITERATIONS = 100


def bal_block(path: Path) -> Block:
    """Return the block of a problem's file."""
    with path.open(encoding="ascii") as file:
        photos, points, count = map(int, file.readline().split())
        numbers = np.fromstring(file.read(), sep=" ")
    observations = numbers[: 4 * count].reshape(-1, 4)
    cameras = numbers[4 * count :][: 9 * photos].reshape(-1, 9)
    ground = numbers[4 * count + 9 * photos :].reshape(points, 3)
    rotations = Rotation.from_rotvec(cameras[:, :3]).as_matrix()
    centres = -np.einsum("nji,nj->ni", rotations, cameras[:, 3:6])
    xy = observations[:, 2:]
    return Block(
        definition=BundleDefinition("BAL", Precision(1.0), max_iterations=_ITERATIONS, start_down_weight=_ITERATIONS),
        cameras=tuple(
            Camera(f"C{row}", (f, 0.0, 0.0, 0.0, k1 / f**2, k2 / f**4, *[0.0] * 7), unknown=("C", "A3", "A5"))
            for row, (f, k1, k2) in enumerate(cameras[:, 6:].tolist())
        ),
        photos=tuple(Photo(f"P{row}", f"C{row}", constant=held) for row, held in enumerate(_held(centres))),
        photo_camera=np.arange(photos),
        photo_orientation=np.hstack([centres, angles_from_rotation(np.swapaxes(rotations, 1, 2))]),
        point_names=tuple(map(str, range(points))),
        point_start=ground,
        photo_points=IndexedPhotoPoints(
            observations[:, 0].astype(np.int64), observations[:, 1].astype(np.int64), xy,
            np.ones(xy.shape), np.ones(xy.shape, dtype=bool),
        ),
        constant_points=np.zeros(ground.shape, dtype=bool),
    )  # fmt: skip


def _held(centres: np.ndarray) -> list[tuple[str, ...]]:
    """Return the constant elements of each photo."""
    held: list[tuple[str, ...]] = [()] * len(centres)
    away = np.abs(centres - centres[0])
    photo, axis = np.unravel_index(away.argmax(), away.shape)
    held[0], held[int(photo)] = (*_AXES, "OMEGA", "PHI", "KAPPA"), (_AXES[axis],)
    return held
