"""Preliminary values of a block that is being measured, as far as there are any."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import part_of_block
from orip.bundle.points.starting import given_coordinates, with_starting_points
from orip.bundle.solve import solve_block
from orip.errors import InputError, NotSolvableError
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.interior.image_coordinates import image_vectors
from orip.online.block.first_photos import FirstValues
from orip.online.block.measurements import Measurements
from orip.online.sequential.observation_rows import ObservationKey
from orip.prelim.rays import image_rays, rays_of_plane_images
from orip.prelim.relative.orientation import orient_pair
from orip.prelim.resection.known_points import image_configuration
from orip.prelim.resection.resection import Unresected, resect
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.records.names import record_key
from orip.records.preliminary import RelativeOrientation
from orip.solving.better_minimum import doubt_about
from orip.structs import replace
from orip.wording import counted

_COMMON_POINTS = 7
"""Five determine a relative orientation; two more tell whether it is right."""

_LARGEST_SEUW = 5.0
"""Mean parallax, in a-priori errors, from which a relative orientation is not believed."""


def orientation_by_model(pair: Block, photo: str) -> FloatArray | None:
    """Return the orientation (6,) of a photo by its common points with one that is oriented.

    Parameters
    ----------
    pair : Block
        The two photos and their common points, with orientation and coordinates as far as there are any, NaN elsewhere.
    photo : str
        The one that is not oriented.

    Returns
    -------
    array (6,) or None
        In the order of `PHOTO_PARAMETERS`; None where too few points are common, they do not fit, or none of them has
        coordinates to take the scale from.
    """
    rays = pair.photo_points
    shown = np.zeros((len(pair.photos), len(pair.point_names)), dtype=bool)
    shown[rays.photo, rays.point] = rays.in_use
    common: BoolArray = np.asarray(shown.all(axis=0))
    if common.sum() < _COMMON_POINTS:
        return None
    part = part_of_block(pair, np.ones(len(pair.photos), dtype=bool), common)
    first = int(part.photos[0].name == photo)
    found = _relative_orientation(part, first)
    return None if found is None else _in_block(part, found, first)


def orientation_to_first(pair: Block) -> FloatArray | None:
    """Return the orientation (6,) of the second photo of a pair in the axes of the first, its base 1; None if it fails.

    Parameters
    ----------
    pair : Block
        Two photos and their common points alone.
    """
    found = _relative_orientation(pair, 0) if len(pair.point_names) >= _COMMON_POINTS else None
    if found is None:
        return None
    base, angles = found.block.centres[1], angles_from_rotation(found.block.rotations[1][None])[0]
    return np.concatenate([base / np.linalg.norm(base), angles])


def _relative_orientation(part: Block, first: int) -> RelativeOrientation | None:
    """Return the relative orientation of a pair, if it can be believed."""
    found = orient_pair(rays_of_plane_images(part, image_rays(part)), first, 1 - first, model="", row=None, column=None)
    return found if isinstance(found, RelativeOrientation) and found.seuw <= _LARGEST_SEUW else None


def _in_block(part: Block, found: RelativeOrientation, first: int) -> FloatArray | None:
    """Return the orientation of the second photo of a pair in the system of the first."""
    orientation, model = part.photo_orientation[first], found.block
    distances = np.linalg.norm(part.point_start[model.points] - orientation[:3], axis=1)
    scales = distances / np.linalg.norm(model.coordinates, axis=1)
    scales = scales[np.isfinite(scales)]
    if not len(scales):
        return None
    rotation = rotation_from_angles(orientation[None, 3:])[0]
    centre = orientation[:3] + float(np.median(scales)) * rotation @ model.centres[1]
    return np.concatenate([centre, angles_from_rotation((rotation @ model.rotations[1])[None])[0]])


# Photos are oriented by points that are known, points are intersected by photos that are oriented. The first photos
# come from the same chain and adjustment as in `orip solve`.

_KNOWN_POINTS = 4
"""Known points that orient a photo: three leave up to four orientations."""

_ROBUST_FROM = 2
_ITERATIONS = 20

_LARGER = 5.0
"""How many times larger errors than those a priori are tried for the first photos."""

_NAMED = 5
"""Points that are named as what to measure next."""


class CurrentValues(Struct):
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

    def waiting(self) -> dict[str, str]:
        """Return what photos and points wait for, by ``photo NAME`` and ``point NAME``."""
        photos = {f"photo {name}": text for name, text in self.photos_wait.items() if name not in self.orientations}
        points = {f"point {name}": text for name, text in self.points_wait.items() if name not in self.points}
        return {**photos, **points}

    def has_camera_unknowns(self, measurements: Measurements) -> bool:
        """Return whether anything is unknown of the cameras of oriented photos."""
        records = measurements.inputs.records
        return any(records.camera_of(records.photos[record_key(photo)]).unknown for photo in self.orientations)

    def start(self, measurements: Measurements, first: FirstValues) -> None:
        """Orient the first photos by an adjustment; without success, keep what each photo waits for."""
        block = measurements.whole()
        assert block is not None, "something is measured"
        for start in first.starts(block):
            try:
                started = start()
            except (NotSolvableError, InputError) as error:
                reason = str(error).splitlines()[0]
                self.photos_wait = {photo.name: reason for photo in block.photos}
                continue
            if not (doubt := self._adjust_first(started.block)):
                oriented = {photo.name for photo in started.block.photos}
                left_out = [photo.name for photo in block.photos if photo.name not in oriented]
                self.photos_wait = {name: why.text for name, why in zip(left_out, started.left_out, strict=True)}
                self._place(measurements, [name for name in block.point_names if name not in self.points])
                return
            text = f"the first photos wait: their adjustment {doubt}; measure more of their common and known points"
            self.photos_wait = {photo.name: text for photo in block.photos}

    def _adjust_first(self, started: Block) -> str:
        """Adjust the first photos; return why not if the result is doubtful."""
        # few photos do not determine what is unknown of a camera, and a-priori errors may be too small
        doubt, held = self.adjust(started), with_cameras_held(started)
        for attempt in (held, _with_larger_errors(held)):
            doubt = doubt and self.adjust(attempt)
        return doubt

    def adjust(self, started: Block, *, robust: bool = True) -> str:
        """Adjust a block with all its unknowns, and take the values; return why not if the result is doubtful."""
        definition = started.definition
        # the first photos have blunders that nobody has seen, whatever the bundle is to do with them in the end
        if robust:
            iterations = max(definition.max_iterations, _ITERATIONS)
            definition = replace(definition, start_down_weight=_ROBUST_FROM, max_iterations=iterations)
        try:
            # what is wrong may lead anywhere: such a result is refused
            with np.errstate(all="ignore"):
                solved = solve_block(replace(started, definition=definition), lambda _: None, lambda: False)
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

    def advance(
        self, measurements: Measurements, photos: Collection[str], points: Collection[str]
    ) -> tuple[list[str], list[str]]:
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
            new_points = self._place(measurements, [name for name in sorted(open_points) if name not in self.points])
            open_points, placed = set(), [*placed, *new_points]
            open_photos |= measurements.sharing(new_points)
            new_photos = [
                name
                for name in sorted(open_photos)
                if name not in self.orientations and self._orient(measurements, name)
            ]
            open_photos, oriented = set(), [*oriented, *new_photos]
            open_points = {point for name in new_photos for point in measurements.points_in(name)}
        return oriented, placed

    def _orient(self, measurements: Measurements, name: str) -> bool:
        """Orient a photo by its known points, or by those that it has in common with another one."""
        found = self._by_known_points(measurements, name)
        if found is None:
            found = _observed(measurements, name)
        if found is None:
            found = self._by_model(measurements, name)
        if found is None:
            return False
        self.orientations[name] = found
        self.photos_wait.pop(name, None)
        return True

    def _by_known_points(self, measurements: Measurements, name: str) -> FloatArray | None:
        """Return the orientation (6,) of a photo by resection; None, with what it waits for, where that fails."""
        part = measurements.part((name, point) for point in measurements.points_in(name) if point in self.points)
        rays = None if part is None else part.photo_points
        seen = np.zeros(0, dtype=bool) if rays is None else rays.in_use
        count = int(seen.sum())
        if part is None or rays is None or count < _KNOWN_POINTS:
            self.photos_wait[name] = self._wanting_points(measurements, name, count)
            return None
        part = self.started(part)
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

    def _by_model(self, measurements: Measurements, name: str) -> FloatArray | None:
        """Return the orientation (6,) of a photo by the oriented one that has most points in common with it."""
        mine = set(measurements.points_in(name))
        others = [photo for photo in measurements.sharing(mine) if photo in self.orientations]
        if not others:
            return None
        # in the order of measuring, as relative orientation draws samples of them
        common = {photo: [point for point in measurements.points_in(photo) if point in mine] for photo in others}
        best = max(others, key=lambda photo: (len(common[photo]), photo))
        part = measurements.part((photo, point) for photo in (name, best) for point in common[best])
        if part is None:
            return None
        of_photo = part.photo_points.xy[part.photo_points.photo == 0]
        if (
            part.cameras[0].frame is not None
            and image_configuration(of_photo, part.cameras[0].frame, of_photo).shortcoming
        ):
            return None
        return orientation_by_model(self.started(part), name)

    def _wanting_points(self, measurements: Measurements, name: str, count: int) -> str:
        """Return that a photo has too few known points, and which to measure."""
        mine = set(measurements.points_in(name))
        near = sorted(measurements.sharing(mine) & self.orientations.keys())
        likely = dict.fromkeys(point for photo in near for point in measurements.points_in(photo))
        known = [point for point in (likely or self.points) if point in self.points and point not in mine]
        text = f"photo {name} waits: {count} of {counted(_KNOWN_POINTS, 'known point')}"
        return f"{text}; measure {', '.join(known[:_NAMED])}" if known else text

    def _place(self, measurements: Measurements, names: Collection[str]) -> list[str]:
        """Give points coordinates, given ones or where the rays of oriented photos meet; return which have some."""
        rays = {name: [photo for photo in measurements.photos_of(name) if photo in self.orientations] for name in names}
        candidates = [name for name in names if self._may_be_placed(measurements, name, len(rays[name]))]
        part = measurements.part((photo, name) for name in candidates for photo in rays[name])
        if part is None:
            return []
        wanted = np.array([name in rays for name in part.point_names], dtype=bool)
        started = self.started(part)
        started = part_of_block(
            replace(started, point_start=np.full_like(started.point_start, np.nan)),
            np.ones(len(part.photos), dtype=bool),
            wanted,
        )
        found, warnings = with_starting_points(started)
        parallel = {warning.where.removeprefix("point ") for warning in warnings}
        placed = []
        for name, coordinates in zip(found.point_names, found.point_start, strict=True):
            if name in parallel:
                self.points_wait[name] = f"point {name} waits: its rays do not meet at an angle"
                continue
            self.points[name] = coordinates
            self.points_wait.pop(name, None)
            placed.append(name)
        return placed

    def _may_be_placed(self, measurements: Measurements, name: str, rays: int) -> bool:
        """Tell whether a point has given coordinates or two rays of oriented photos; else keep what it waits for."""
        if rays >= 2 or (rays and measurements.control.has_coordinates(name)):
            return True
        missing = f"{rays} of 2 rays of oriented photos" if rays else "none of its photos is oriented"
        self.points_wait[name] = f"point {name} waits: {missing}"
        return False


def counting_alone(part: Block, included: Collection[ObservationKey], left_out: Collection[ObservationKey]) -> Block:
    """Return a block in which photo points count that are included, and control that is not left out."""
    rays = part.photo_points
    keys = [
        ObservationKey("photo", part.photos[photo].name, part.point_names[point])
        for photo, point in zip(rays.photo.tolist(), rays.point.tolist(), strict=True)
    ]
    used = rays.used & np.array([key in included for key in keys], dtype=bool)[:, None]
    control = (point for point in part.control_points if ObservationKey("control", "", point.name) not in left_out)
    return replace(part, photo_points=replace(rays, used=used), control_points=tuple(control))


def with_cameras_held(block: Block) -> Block:
    """Return a block in which nothing of the cameras is unknown."""
    return replace(block, cameras=tuple(replace(camera, unknown=()) for camera in block.cameras))


def _with_larger_errors(block: Block) -> Block:
    """Return a block whose photo points and control are several times less precise."""

    def less_precise(point: ControlPoint) -> ControlPoint:
        x, y, z = (error and _LARGER * error for error in point.errors)
        return replace(point, errors=(x, y, z))

    rays = block.photo_points
    return replace(
        block,
        photo_points=replace(rays, error=_LARGER * rays.error),
        control_points=tuple(map(less_precise, block.control_points)),
    )


def _observed(measurements: Measurements, name: str) -> FloatArray | None:
    """Return the orientation (6,) of a photo that is observed or constant; None where it is at most approximate."""
    if not measurements.has_orientation(name):
        return None
    part = measurements.part((name, point) for point in measurements.points_in(name))
    known = part is not None and bool(np.isfinite(part.photo_orientation).all())
    return part.photo_orientation[0] if part is not None and known else None
