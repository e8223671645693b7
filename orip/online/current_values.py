"""Preliminary values of a block that is being measured, as far as there are any.

Photos are oriented by points that are known, points are intersected by photos that are oriented. The first photos come
from the same chain and adjustment as in `orip solve`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.bundle.part_of_block import part_of_block
from orip.bundle.solve import solve_block
from orip.bundle.starting_points import given_coordinates, with_starting_points
from orip.errors import InputError, NotSolvableError
from orip.geometry.rotation import angles_from_rotation
from orip.interior.image_vectors import image_vectors
from orip.online.model_orientation import orientation_by_model
from orip.prelim.resection.configuration import image_configuration
from orip.prelim.resection.resection import Unresected, resect
from orip.records.block import Block
from orip.solving.better_minimum import doubt_about
from orip.solving.starting_values import started_block
from orip.wording import counted

_KNOWN_POINTS = 4
"""Known points that orient a photo: three leave up to four orientations."""

_NAMED = 5
"""Points that are named as what to measure next."""


@dataclass(slots=True)
class CurrentValues:
    """Values by name.

    Parameters
    ----------
    orientations : dict of arrays (6,)
        Oriented photos, in the order of `PHOTO_PARAMETERS`, local ground coordinates and radians.
    points : dict of arrays (3,)
        Points with coordinates, local.
    cameras : dict of tuples of float
        Parameters of cameras as they were adjusted.
    photos_wait, points_wait : dict of str
        What the others wait for, as a sentence.
    """

    orientations: dict[str, FloatArray] = field(default_factory=dict)
    points: dict[str, FloatArray] = field(default_factory=dict)
    cameras: dict[str, tuple[float, ...]] = field(default_factory=dict)
    photos_wait: dict[str, str] = field(default_factory=dict)
    points_wait: dict[str, str] = field(default_factory=dict)

    def started(self, block: Block) -> Block:
        """Return a block at these values, NaN where there are none."""
        nothing = np.full(6, np.nan)
        return replace(
            block,
            cameras=tuple(
                replace(camera, parameters=self.cameras.get(camera.name, camera.parameters)) for camera in block.cameras
            ),
            photo_orientation=np.array([self.orientations.get(photo.name, nothing) for photo in block.photos]),
            point_start=np.array([self.points.get(name, nothing[:3]) for name in block.point_names]).reshape(-1, 3),
        )

    def is_oriented(self, block: Block) -> BoolArray:
        """Return which photos (number of photos,) of a block are oriented."""
        return np.array([photo.name in self.orientations for photo in block.photos], dtype=bool)

    def is_placed(self, block: Block) -> BoolArray:
        """Return which points (number of points,) of a block have coordinates."""
        return np.array([name in self.points for name in block.point_names], dtype=bool)

    def start(self, block: Block) -> None:
        """Orient the first photos by the chain and an adjustment; without success, keep what each photo waits for."""
        try:
            started = started_block(block, lambda _: None)
        except (NotSolvableError, InputError) as error:
            reason = str(error).splitlines()[0]
            self.photos_wait = {photo.name: reason for photo in block.photos}
            return
        self.photos_wait = {warning.where: warning.text for warning in started.left_out}
        if doubt := self.adjust(started.block):
            text = f"the first photos wait: their adjustment {doubt}; measure more of their common and known points"
            self.photos_wait = {photo.name: text for photo in block.photos}
            return
        for name in block.point_names:
            if name not in self.points:
                self._place(block, name)

    def adjust(self, started: Block) -> str:
        """Adjust a block with all its unknowns, and take the values; return why not if the result is doubtful."""
        try:
            solved = solve_block(started, lambda _: None, lambda: False)
        except (NotSolvableError, InputError) as error:
            return f"failed ({str(error).splitlines()[0]})"
        if doubt := doubt_about(solved):
            return doubt
        state, block = solved.state, solved.block
        for row, camera in enumerate(block.cameras):
            self.cameras[camera.name] = tuple(state.cameras[row].tolist())
        for row, photo in enumerate(block.photos):
            self.orientations[photo.name] = np.concatenate([state.centres[row], state.angles()[row]])
        rays = np.bincount(block.photo_points.point, minlength=len(block.point_names))
        known = np.isfinite(given_coordinates(block)).all(axis=1)
        for row in np.flatnonzero(((rays > 1) | known) & ~state.left_out).tolist():
            self.points[block.point_names[row]] = state.points[row].copy()
        return ""

    def advance(self, block: Block, photos: Collection[str], points: Collection[str]) -> tuple[list[str], list[str]]:
        """Try what waits, from photos and points on that have new measurements.

        Returns
        -------
        oriented, placed : lists of str
            Photos and points that have values since.
        """
        oriented: list[str] = []
        placed: list[str] = []
        open_photos, open_points = set(photos), set(points)
        while open_photos or open_points:
            new_points = [name for name in sorted(open_points) if name not in self.points and self._place(block, name)]
            open_points, placed = set(), [*placed, *new_points]
            open_photos |= _sharing(block, new_points)
            new_photos = [name for name in sorted(open_photos) if self._has_oriented(block, name)]
            open_photos, oriented = set(), [*oriented, *new_photos]
            open_points = _shown_in(block, new_photos)
        return oriented, placed

    def _has_oriented(self, block: Block, name: str) -> bool:
        return name not in self.orientations and self._orient(block, name)

    def _orient(self, block: Block, name: str) -> bool:
        """Orient a photo by its known points, or by those that it has in common with another one."""
        started = self.started(block)
        found = self._by_known_points(started, name)
        if found is None:
            row = next(row for row, photo in enumerate(block.photos) if photo.name == name)
            found = orientation_by_model(started, row)
        if found is None:
            return False
        self.orientations[name] = found
        self.photos_wait.pop(name, None)
        return True

    def _by_known_points(self, started: Block, name: str) -> FloatArray | None:
        """Return the orientation (6,) of a photo by resection; None, with what it waits for, where that fails."""
        wanted = np.array([photo.name == name for photo in started.photos], dtype=bool)
        part = part_of_block(started, wanted, self.is_placed(started))
        rays = part.photo_points
        seen = rays.used.all(axis=1)
        count = int(seen.sum())
        if count < _KNOWN_POINTS:
            self.photos_wait[name] = self._wanting_points(started, name, count)
            return None
        frame = part.cameras[0].frame
        configuration = image_configuration(rays.xy[seen], frame, rays.xy[seen])
        if frame is not None and configuration.shortcoming is not None:
            self.photos_wait[name] = f"photo {name} waits: {configuration.shortcoming}"
            return None
        found = resect(
            image_vectors(part)[seen], part.point_start[rays.point[seen]], error_mm=float(rays.error[seen].mean())
        )
        if isinstance(found, Unresected):
            self.photos_wait[name] = f"photo {name} waits: {found.reason}"
            return None
        return np.concatenate([found.centre, angles_from_rotation(found.rotation[None])[0]])

    def _wanting_points(self, block: Block, name: str, count: int) -> str:
        """Return that a photo has too few known points, and which to measure."""
        mine = _shown_in(block, [name])
        others = [point for point in self.points if point not in mine]
        near = _sharing(block, sorted(mine)) & set(self.orientations)
        likely = [point for point in others if point in _shown_in(block, sorted(near))] or others
        text = f"photo {name} waits: {count} of {counted(_KNOWN_POINTS, 'known point')}"
        return f"{text}; measure {', '.join(likely[:_NAMED])}" if likely else text

    def _place(self, block: Block, name: str) -> bool:
        """Give a point coordinates: given ones, or where the rays of oriented photos meet."""
        started = self.started(block)
        wanted = np.array([point == name for point in block.point_names], dtype=bool)
        part = part_of_block(replace(started, point_start=np.full_like(started.point_start, np.nan)),
                             self.is_oriented(block), wanted)  # fmt: skip
        rays = part.photo_points.used.all(axis=1)
        places = len(np.unique(part.photo_points.photo[rays]))
        given = np.isfinite(given_coordinates(part)).all() or bool(
            [point for point in block.preliminary if point.name == name]
        )
        if places < 2 and not given:
            self.points_wait[name] = f"point {name} waits: {places} of 2 rays of oriented photos"
            return False
        if not places:
            self.points_wait[name] = f"point {name} waits: none of its photos is oriented"
            return False
        found, warnings = with_starting_points(part)
        if warnings:
            self.points_wait[name] = f"point {name} waits: its rays do not meet at an angle"
            return False
        self.points[name] = found.point_start[0]
        self.points_wait.pop(name, None)
        return True


def _shown_in(block: Block, photos: Collection[str]) -> set[str]:
    """Return the points that some photos show."""
    rows = np.array([photo.name in photos for photo in block.photos], dtype=bool)[block.photo_points.photo]
    return {block.point_names[point] for point in np.unique(block.photo_points.point[rows])}


def _sharing(block: Block, points: Collection[str]) -> set[str]:
    """Return the photos that show some of the points."""
    rows = np.isin(block.photo_points.point, [block.point_index()[name] for name in points])
    return {block.photos[photo].name for photo in np.unique(block.photo_points.photo[rows])}
