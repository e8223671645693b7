"""Blocks of rigs with known truth: strips flown there and back over hills, by two to five cameras on one body.

The images are computed here from the formulas of docs/conventions.md, with scipy's rotations and without orip's
geometry.
"""

from __future__ import annotations

import zlib

import numpy as np
from msgspec import Struct
from scipy.spatial.transform import Rotation

from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo
from orip.records.rig import Mounting, Rig, RigExposure, Rigs
from orip.structs import replace

C, FRAME, ERROR = 20.0, (36.0, 24.0), 0.004
HEIGHT = 100.0

HEADS = {
    "stereo": [(0, 0, 0), (3, 0, 0)],
    "apart": [(0, 0, 0), (0, 75, 0)],
    "three": [(0, 0, 0), (0, 42, 0), (0, -42, 0)],
    "around": [(0, 0, 0), (50, 0, 0), (-50, 0, 180)],
    "four": [(0, 38, 0), (0, -38, 0), (38, 0, 0), (-38, 0, 0)],
    "penta": [(0, 0, 0), (0, 40, 90), (0, -40, -90), (40, 0, 0), (-40, 0, 180)],
}
"""Rotations of the cameras of a rig against its axes, degrees: those of "apart" have no common view."""


class RigBlock(Struct, frozen=True):
    """A block of a rig, and its truth.

    Attributes
    ----------
    block : Block
    centres, rotations : arrays (e, 3) and (e, 3, 3)
        Of the exposures.
    offsets, mountings : arrays (c, 3) and (c, 3, 3)
    points : array (p, 3)
    """

    block: Block
    centres: np.ndarray
    rotations: np.ndarray
    offsets: np.ndarray
    mountings: np.ndarray
    points: np.ndarray


def single(block: Block) -> Block:
    """Return the same photos without a rig."""
    return replace(block, rigs=Rigs())


def rig_block(
    head: str, seed: str, *, strips: int = 2, exposures: int = 5, points: int = 250, control: int = 6,
    start_error: float = 0.01, noise: float = 1.0, mounting_error: tuple[float, float] | None = None,
    planted: dict[str, object] | None = None, missing: int = 0, **definition: object,
) -> RigBlock:  # fmt: skip
    """Make a block.

    Parameters
    ----------
    head : str
        Of `HEADS`.
    seed : str
    strips, exposures, points, control : int
        Exposures of a strip, and points with measured images.
    start_error : float
        Of photos, as a part of the height and in radians.
    noise : float
        In a-priori errors.
    mounting_error : tuple of 2 float or None
        A-priori errors (ground unit, degrees) with which the mountings are observed; None: they are unknown.
    planted : dict
        ``mounting``: a rotation (3,), degrees, by which the last camera is mounted other than it is said to be.
        ``exposure``: number, shift (3,) and rotation (3,) of the last photo of an exposure against the rig.
        ``exchanged``: the photos of the first two cameras have each other's camera.
    missing : int
        Number of photos that are not there.
    """
    planted = planted or {}
    random = np.random.default_rng(zlib.crc32(f"{head} {seed}".encode()))
    offsets, mountings = _body(head, random)
    cameras = len(offsets)
    centres, rotations = _flight(head, strips, exposures, random)
    ground = np.column_stack(
        [
            random.uniform(-90, 35 * exposures + 60, points),
            random.uniform(-110, 55 * strips + 60, points),
            random.uniform(0, 20, points),
        ]
    )
    photo_centres = (centres[:, None] + np.einsum("eij,cj->eci", rotations, offsets)).reshape(-1, 3)
    photo_rotations = np.einsum("eij,cjk->ecik", rotations, mountings).reshape(-1, 3, 3)
    exposure, camera = np.divmod(np.arange(len(centres) * cameras), cameras)
    names = [f"{number + 1}{'ABCDE'[of]}" for number, of in zip(exposure, camera, strict=True)]
    photo_centres, photo_rotations = _planted(planted, photo_centres, photo_rotations, camera, cameras)
    images = [_image(ground, *photo) for photo in zip(photo_centres, photo_rotations, strict=True)]
    seen = np.array([inside for _, inside in images])
    there = np.ones(len(names), dtype=bool)
    if missing:
        there[random.choice(len(names), missing, replace=False)] = False
    seen &= there[:, None]
    kept = np.flatnonzero(seen.sum(axis=0) >= 2)
    seen, ground = seen[:, kept], ground[kept]
    photo, point = np.nonzero(seen)
    exact = np.vstack([xy[kept[row]] for (xy, _), row in zip(images, seen, strict=True)])
    measured = exact + noise * ERROR * random.normal(size=exact.shape)
    shown = np.flatnonzero(there)
    photo = np.searchsorted(shown, photo)
    start = np.hstack([photo_centres, Rotation.from_matrix(photo_rotations).as_euler("XYZ")])[shown]
    start += start_error * np.repeat([HEIGHT, 1.0], 3) * random.normal(size=start.shape)
    point_names, control_points = _control(ground, seen, control, random, noise)
    of_camera = camera[shown].copy()
    if "exchanged" in planted:
        of_camera = np.where(of_camera < 2, 1 - of_camera, of_camera)
    mounted = [_mounting(k, offsets[k], mountings[k], mounting_error, random, noise) for k in range(cameras)]
    of_exposures = [tuple(names[k] for k in shown if exposure[k] == number) for number in range(len(centres))]
    block = Block(
        definition=BundleDefinition(seed, Precision(ERROR), **definition),
        cameras=tuple(Camera("ABCDE"[k], (C, *[0.0] * 12), frame=FRAME) for k in range(cameras)),
        photos=tuple(
            Photo(names[k], "ABCDE"[of], orientation=tuple(np.r_[one[:3], np.degrees(one[3:])].tolist()))
            for k, of, one in zip(shown, of_camera, start, strict=True)
        ),
        photo_camera=of_camera.astype(np.int64),
        photo_orientation=start,
        point_names=point_names,
        point_start=ground + start_error * HEIGHT * random.normal(size=ground.shape),
        photo_points=IndexedPhotoPoints(
            photo.astype(np.int64), point.astype(np.int64), measured, np.full(measured.shape, ERROR),
            np.ones(measured.shape, dtype=bool),
        ),
        constant_points=np.zeros((len(ground), 3), dtype=bool),
        control_points=control_points,
        rigs=Rigs(
            (Rig("HEAD", tuple(mounted)),),
            tuple(RigExposure(f"E{number + 1}", photos) for number, photos in enumerate(of_exposures) if photos),
        ),
    )  # fmt: skip
    return RigBlock(block, centres, rotations, offsets, mountings, ground)


def without_common_view(made: RigBlock) -> Block:
    """Return a block in which no two cameras show the same point, and control is measured by the first one alone."""
    block, rays, cameras = made.block, made.block.photo_points, len(made.block.cameras)
    kept = rays.point % cameras == block.photo_camera[rays.photo]
    kept &= np.bincount(rays.point[kept], minlength=len(block.point_names))[rays.point] >= 2
    used = np.unique(rays.point[kept])
    number = np.searchsorted(used, np.arange(len(block.point_names)))
    of_first = used[used % cameras == 0]
    corners = {of_first[int(np.argmax(made.points[of_first, :2] @ (x, y)))] for x in (-1, 1) for y in (-1, 1)}
    return replace(
        block,
        point_names=tuple(block.point_names[k] for k in used),
        point_start=block.point_start[used],
        constant_points=block.constant_points[used],
        control_points=tuple(
            ControlPoint(block.point_names[k], tuple(made.points[k].tolist()), (0.02,) * 3) for k in sorted(corners)
        ),
        photo_points=IndexedPhotoPoints(
            rays.photo[kept], number[rays.point[kept]], rays.xy[kept], rays.error[kept], rays.used[kept]
        ),
    )


def from_nothing(block: Block) -> Block:
    """Return a block without any starting value."""
    return replace(
        block,
        photos=tuple(replace(photo, orientation=(None,) * 6) for photo in block.photos),
        photo_orientation=np.full_like(block.photo_orientation, np.nan),
        point_start=np.full_like(block.point_start, np.nan),
    )


def _image(ground: np.ndarray, centre: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the photo coordinates of points, and which of them are inside of the frame."""
    u = (ground - centre) @ rotation
    in_front = u[:, 2] < 0.0
    xy = -C * u[:, :2] / np.where(in_front, u[:, 2], -1.0)[:, None]
    return xy, in_front & (np.abs(xy) < 0.5 * np.array(FRAME)).all(axis=1)


def _body(head: str, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets and mountings; the rig has the axes of its first camera."""
    cameras = len(HEADS[head])
    offsets = np.vstack([np.zeros(3), random.uniform(-0.4, 0.4, (cameras - 1, 3))])
    said = Rotation.from_euler("XYZ", np.array(HEADS[head], dtype=float), degrees=True)
    off = Rotation.from_euler("XYZ", random.normal(0.0, 0.7, (cameras, 3)), degrees=True)
    mountings = (said[0].inv() * off * said).as_matrix()
    mountings[0] = np.eye(3)
    return offsets, mountings


def _flight(head: str, strips: int, exposures: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return centres and rotations of the exposures of strips that are flown there and back."""
    row, column = np.divmod(np.arange(strips * exposures), exposures)
    centres = np.column_stack([35.0 * column, 55.0 * row, np.full(len(row), HEIGHT)])
    centres += random.normal(0.0, 2.0, (len(row), 3))
    kappa = 180.0 * (row % 2) + random.normal(0.0, 3.0, len(row))
    tilt = random.normal(0.0, 2.0, (len(row), 2))
    level = Rotation.from_euler("XYZ", np.column_stack([tilt, kappa]), degrees=True)
    return centres, (level * Rotation.from_euler("XYZ", HEADS[head][0], degrees=True)).as_matrix()


def _spread(ground: np.ndarray, by_rays: np.ndarray, count: int) -> np.ndarray:
    """Return points with many rays that lie far from each other."""
    some = by_rays[: max(count, len(by_rays) // 2)]
    found = [some[0]]
    while len(found) < count:
        apart = np.min([np.linalg.norm(ground[some] - ground[k], axis=1) for k in found], axis=0)
        found.append(some[int(np.argmax(apart))])
    return np.array(found)


def _control(
    ground: np.ndarray, seen: np.ndarray, count: int, random: np.random.Generator, noise: float
) -> tuple[tuple[str, ...], tuple[ControlPoint, ...]]:
    """Return the names of the points, and some of them as control."""
    names = tuple(str(101 + k) for k in range(len(ground)))
    known = np.sort(_spread(ground, np.argsort(-seen.sum(axis=0), kind="stable"), count))
    given = ground[known] + noise * 0.02 * random.normal(size=(len(known), 3))
    control = (ControlPoint(names[k], tuple(one), (0.02,) * 3) for k, one in zip(known, given.tolist(), strict=True))
    return names, tuple(control)


def _mounting(
    k: int,
    offset: np.ndarray,
    rotation: np.ndarray,
    errors: tuple[float, float] | None,
    random: np.random.Generator,
    noise: float,
) -> Mounting:
    name = "ABCDE"[k]
    if k == 0 or errors is None:
        return Mounting(name)
    length, angle = errors
    angles = Rotation.from_matrix(rotation).as_euler("XYZ", degrees=True) + noise * angle * random.normal(size=3)
    offset = offset + noise * length * random.normal(size=3)
    return Mounting(name, tuple(offset.tolist()), (length,) * 3, tuple(angles.tolist()), (angle,) * 3)


def _planted(
    planted: dict[str, object], centres: np.ndarray, rotations: np.ndarray, camera: np.ndarray, cameras: int
) -> tuple[np.ndarray, np.ndarray]:
    if "mounting" in planted:
        turn = Rotation.from_euler("XYZ", planted["mounting"], degrees=True).as_matrix()
        mine = camera == cameras - 1
        rotations = rotations.copy()
        rotations[mine] = rotations[mine] @ turn
    if "exposure" in planted:
        number, shift, angles = planted["exposure"]
        last = number * cameras + cameras - 1
        centres, rotations = centres.copy(), rotations.copy()
        centres[last] += shift
        rotations[last] = Rotation.from_euler("XYZ", angles, degrees=True).as_matrix() @ rotations[last]
    return centres, rotations
