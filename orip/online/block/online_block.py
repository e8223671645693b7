"""The block of a session: what is measured, the values it has so far, and the equations that are in."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.bundle.antennas import part_of_block
from orip.bundle.assemble import BlockInput
from orip.bundle.starting_state import starting_state
from orip.bundle.unknowns import number_unknowns
from orip.online.block.current_values import CurrentValues, counting_alone, with_cameras_held
from orip.online.block.first_photos import FirstValues, PhotoCorrections, PlacesAtSolution
from orip.online.block.local_system import LocalSystem
from orip.online.block.measurements import Measurements, RayName
from orip.online.sequential.hyper_rows import ObservationRows
from orip.online.sequential.observation_rows import ObservationKey, ReducedColumns, linearised
from orip.online.sequential.sequential_block import SequentialBlock
from orip.records.block import Block
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.structs import replace

_LINEAR = 1e-3
"""Corrections of a photo or point, in radians and parts of its distance, up to which the equations stay as they are:
what they neglect is the square of it, a tenth of a micrometre in the photo."""

_SHOWN = 1e-4
"""Corrections, in the same measure, up to which a solution is shown: it is off by the square, 0.01 micrometres."""

_LOST = 0.5
"""Corrections, in the same measure, from which the solution of the linear equations means nothing."""

_UNSTEADY = 0.05
"""Corrections that a photo must not have after all attempts to linearise at the solution."""

_UNSETTLED = "photo {} waits: its points do not determine its orientation; measure more of them, far from each other"

_RELINEARISATIONS = 8
"""Linearisations at the solution, one after the other, after which a photo that still moves is not determined."""

_WEAK = 1e-3
"""Root of the weight of control while it is examined: what is known to centimetres is observed to tens of metres."""

_FEW = 3
"""Photos up to which these alone are linearised again."""


class OnlineBlock:
    """A block that grows by measurements.

    Cameras are held between adjustments of all that has values.

    Parameters
    ----------
    inputs : BlockInput
        Its observations are those that there are at the beginning; none is needed.
    local : LocalSystem or None
        The system of the block, whose inputs are given then; None: that of the project.

    Raises
    ------
    InputError
        See `Measurements`.
    """

    def __init__(self, inputs: BlockInput, local: LocalSystem | None = None) -> None:
        self.measurements, self.local = Measurements(inputs), local
        self.values = CurrentValues()
        self.equations: SequentialBlock[ObservationKey] = SequentialBlock()
        self.columns = ReducedColumns()
        self._corrections = PhotoCorrections(self.columns)
        self._of_photo: dict[str, dict[ObservationKey, None]] = {}
        self._of_point: dict[str, dict[ObservationKey, None]] = {}
        self._control_weight = 1.0
        self._relinearisations = _RELINEARISATIONS
        given = inputs.measured.observations.get(record_key(inputs.definition.name))
        # whether a photo point counts is kept here, from where it can come back
        self.left_out: set[ObservationKey] = set()
        if given is not None:
            rows = zip(given.photos, given.points, given.disregarded, strict=True)
            self.left_out.update(self.key(photo, point) for photo, point, disregarded in rows if disregarded)

    @property
    def project(self) -> Measurements:
        """Return measurements with all that the project knows of the ground; their rays may be fewer."""
        return self.measurements if self.local is None else self.local.project

    def begun_again(self, excluded: Collection[ObservationKey], local: LocalSystem | None = None) -> OnlineBlock:
        """Return a block of the same measurements without any values, on the ground or not; some are excluded."""
        measured, inputs = self.measurements.observations, self.project.inputs if local is None else local.inputs
        out = [key in excluded for key in map(self.key, measured.photos, measured.points)]
        given = {record_key(measured.bundle): replace(measured, disregarded=np.array(out, dtype=bool))}
        again = OnlineBlock(replace(inputs, measured=replace(inputs.measured, observations=given)), local)
        again.left_out.update(key for key in excluded if key.kind != "photo")
        return again

    @property
    def sigma0(self) -> float | None:
        """Return the standard error of unit weight of what is in; None without redundancy."""
        redundancy = self.equations.redundancy
        return float(np.sqrt(self.equations.square_sum / redundancy)) if redundancy > 0 else None

    @property
    def ground(self) -> GroundSystem:
        """Return the system of coordinates of the values."""
        return self.measurements.ground

    def key(self, photo: str, point: str) -> ObservationKey:
        """Return the key of a photo point, with the name of the photo as it is defined."""
        return ObservationKey("photo", self.measurements.name_of(photo), point)

    def remove(self, key: ObservationKey) -> None:
        """Delete what was measured of a point in a photo."""
        self.take_out(key)
        self.left_out.discard(key)
        self.measurements.remove(key.photo, key.point)

    def leave_out(self, key: ObservationKey) -> None:
        """Take an observation out, and keep it out until it is no longer left out."""
        self.take_out(key)
        self.left_out.add(key)

    @contextmanager
    def weak_control(self) -> Iterator[None]:
        """Meanwhile, let control points only keep the datum from being singular.

        Equations keep the weights that they have been linearised with: see `linearise_again`.
        """
        self._control_weight = _WEAK
        try:
            self.linearise_again()
            yield
        finally:
            self._control_weight = 1.0

    @contextmanager
    def relinearised(self, at_most: int) -> Iterator[None]:
        """Meanwhile, let `settle` linearise so many times at most: 0 keeps the values that there are."""
        before, self._relinearisations = self._relinearisations, at_most
        try:
            yield
        finally:
            self._relinearisations = before

    def take_out(self, key: ObservationKey) -> None:
        """Take an observation out of the equations, if it is in."""
        if key in self.equations.included:
            self.equations.exclude(key)

    def included_of(self, photos: Iterable[str] = (), points: Iterable[str] = ()) -> list[ObservationKey]:
        """Return what is observed of some photos, and of some points, and is in; always in the same order."""
        keys = dict.fromkeys(key for photo in photos for key in self._of_photo.get(photo, ()))
        keys |= dict.fromkeys(key for point in points for key in self._of_point.get(point, ()))
        return [key for key in keys if key in self.equations.included]

    def forget_photo(self, photo: str) -> None:
        """Take a photo out with all that is measured in it, and the points that are left with fewer than two rays."""
        del self.values.orientations[photo]
        of_photo = self.included_of(photos=[photo])
        lost = dict.fromkeys(key.point for key in of_photo if key.point and self._rays(key.point) < 3)
        self.equations.exclude_all(dict.fromkeys([*of_photo, *self.included_of(points=lost)]))
        # without photos there is no block that the others could lie in
        for name in lost if self.values.orientations else list(self.values.points):
            self.values.points.pop(name, None)

    def _rays(self, point: str) -> int:
        return sum(key.kind == "photo" for key in self.included_of(points=[point]))

    def include(self, rays: Iterable[RayName]) -> list[ObservationKey]:
        """Take in some rays, and what else is observed of their photos and points, unless it is left out."""
        found: list[ObservationKey] = []
        for key, equations in self.rows(rays).items():
            if key not in self.equations.included and key not in self.left_out:
                self.equations.include(key, equations)
                found.append(key)
        return found

    def rows(self, rays: Iterable[RayName]) -> dict[ObservationKey, ObservationRows]:
        """Return the equations of some rays, and of what else is observed of their photos and points with values."""
        chosen = dict.fromkeys(ray for ray in rays if self.has_values(ray))
        for name in sorted(self.measurements.control.tied_to([point for _, point in chosen])):
            chosen |= dict.fromkeys(ray for ray in self._rays_of(points=[name]) if self.has_values(ray))
        part = self.measurements.part(chosen)
        return {} if part is None else self.linearised(self.values.started(part))

    def has_values(self, ray: RayName) -> bool:
        """Return whether photo and point of a ray have values."""
        return ray[0] in self.values.orientations and ray[1] in self.values.points

    def _rays_of(self, photos: Iterable[str] = (), points: Iterable[str] = ()) -> list[RayName]:
        of_photos = [(photo, point) for photo in photos for point in self.measurements.points_in(photo)]
        return of_photos + [(photo, point) for point in points for photo in self.measurements.photos_of(point)]

    def rays_with_values(self, photos: Iterable[str] = (), points: Iterable[str] = ()) -> list[RayName]:
        """Return the rays of some photos, and of some points, that have values."""
        return [ray for ray in self._rays_of(photos, points) if self.has_values(ray)]

    def adjust(self) -> bool:
        """Adjust all that has values with the unknowns of the cameras, and linearise everything there.

        Where the result is doubtful nothing changes, and the answer is False.
        """
        return self._adjusted(self._valued(), robust=True)

    def adjust_included(self) -> bool:
        """Do so with what is in alone and as the definition of the bundle says: nothing is down-weighted besides."""
        part = self._valued()
        if part is None:
            return False
        part = counting_alone(part, self.equations.included, self.left_out)
        return self._adjusted(part, robust=any(key.kind not in ("photo", "control") for key in self.left_out))

    def _adjusted(self, part: Block | None, *, robust: bool) -> bool:
        if part is None or self.values.adjust(part, robust=robust):
            return False
        self.linearise_again()
        return True

    def linearised(self, part: Block) -> dict[ObservationKey, ObservationRows]:
        """Return the equations of a block at its values, its cameras held."""
        part = with_cameras_held(part)
        known: BoolArray = np.asarray(np.isfinite(part.point_start).all(axis=1), dtype=bool)
        if not known.all():
            part = part_of_block(part, np.ones(len(part.photos), dtype=bool), known)
        before = len(self.columns.names)
        rows = linearised(part, starting_state(part), self._tied_rows(part), self.columns)
        self.equations.append(len(self.columns.names) - before)
        if self._control_weight != 1.0:
            rows = {
                key: row.weighted(self._control_weight) if key.kind == "control" else row for key, row in rows.items()
            }
        for key in rows:
            self._of_photo.setdefault(key.photo, {})[key] = None
            self._of_point.setdefault(key.point, {})[key] = None
        return rows

    def _tied_rows(self, block: Block) -> list[int]:
        distances = self.measurements.control.distances
        return [row for row, name in enumerate(block.point_names) if name in distances]

    def settle(self, points: Collection[str] = ()) -> bool:
        """Linearise again at the solution while corrections are too large for the equations.

        A wrong observation that has not been found yet may demand corrections that mean nothing: it ends there.

        Parameters
        ----------
        points : collection of str
            Points that may have moved.

        Returns
        -------
        bool
            Whether the corrections are small now.
        """
        for remaining in range(self._relinearisations, -1, -1):
            reduced = self.equations.triangle.solution()
            photos = self._far_photos(reduced)
            far = self._far_points(points, reduced)
            if not (photos or far):
                return True
            if not remaining or self._far_photos(reduced, _LOST):
                break
            if len(photos) > _FEW:
                self.relinearise()
            else:
                self._relinearise_some(photos, far, reduced)
        return False

    def lose_unsettled(self) -> None:
        """Take photos out again whose corrections do not become smaller, the worst first; they wait.

        A photo that is not determined moves the ones that share its points: these often settle without it.
        """
        while lost := self._far_photos(self.equations.triangle.solution(), _UNSTEADY):
            self.forget_photo(lost[0])
            self.values.photos_wait[lost[0]] = _UNSETTLED.format(lost[0])
            self.settle()

    def _far_photos(self, reduced: FloatArray, limit: float = _LINEAR) -> list[str]:
        """Return the photos whose corrections exceed a limit, in radians and parts of their distance, worst first."""
        turns, moves = self._corrections.largest(reduced)
        if not len(turns):
            return []
        sizes = np.maximum(turns, moves / self._distance() if (moves > 0.0).any() else 0.0)
        names = self._corrections.photos
        order = np.argsort(-sizes, kind="stable")
        return [names[row] for row in order.tolist() if sizes[row] > limit and names[row] in self.values.orientations]

    def _far_points(
        self, points: Collection[str], reduced: FloatArray, linear: float = _LINEAR
    ) -> dict[str, FloatArray]:
        """Return the corrections of points that are too large for the linearisation."""
        moved = {
            name: self.equations.point_correction(name, reduced) for name in points if self.equations.has_point(name)
        }
        limit = linear * self._distance()
        return {name: move for name, move in moved.items() if np.abs(move).max() > limit}

    def _distance(self) -> float:
        """Return the typical distance of points from the photos."""
        centres = np.array([value[:3] for value in self.values.orientations.values()])
        points = np.array(list(self.values.points.values()))
        if not (len(centres) and len(points)):
            return np.inf
        return float(np.median(np.linalg.norm(points - centres.mean(axis=0), axis=1)))

    def _relinearise_some(self, photos: Collection[str], points: dict[str, FloatArray], reduced: FloatArray) -> None:
        """Move some photos and points to the solution, and linearise what is observed of them there."""
        self.values.orientations.update(self._moved(map(self._one_ray, photos), reduced)[0])
        for name, move in points.items():
            self.values.points[name] = self.values.points[name] + move
        rows = self.rows(self.rays_with_values(photos, points))
        moved_keys = set(self.included_of(photos, points))
        changed = {key: new for key, new in rows.items() if key in moved_keys}
        self.equations.replace_all(changed)

    def relinearise(self) -> None:
        """Move all values to the solution, and linearise all equations there."""
        orientations, points = self.at_solution()
        self.values.orientations, self.values.points = orientations, dict(points)
        self.linearise_again()

    def at_solution(self) -> tuple[dict[str, FloatArray], PlacesAtSolution]:
        """Return the orientations (6,) and points (3,) of the solution: the values with their corrections."""
        reduced = self.equations.triangle.solution()
        measured = [photo for photo in self.values.orientations if self.measurements.points_in(photo)]
        tied = self.rays_with_values(points=self.measurements.control.distances)
        orientations, places = self._moved([*map(self._one_ray, measured), *tied], reduced)
        points = PlacesAtSolution(self.values.points, places, self.equations, reduced)
        return {**self.values.orientations, **orientations}, points

    def _one_ray(self, photo: str) -> RayName:
        """Return a ray of a photo, of a point with values if there is one."""
        points = self.measurements.points_in(photo)
        return photo, next((name for name in points if name in self.values.points), next(iter(points)))

    def _moved(
        self, rays: Iterable[RayName], reduced: FloatArray
    ) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Return the corrected orientations (6,) of the photos of rays, and points (3,) that are tied to others."""
        part = self._with_values(self.measurements.part(rays))
        if part is None:
            return {}, {}
        part = with_cameras_held(part)
        unknowns = number_unknowns(part, tied := self._tied_rows(part))
        correction = np.zeros(unknowns.layout.size)
        correction[: unknowns.layout.reduced] = self._corrections.of(unknowns.names.reduced, reduced)
        correction[unknowns.layout.fixed] = 0.0
        state = starting_state(part).moved(correction, unknowns)
        elements = np.hstack([state.centres, state.angles()])
        orientations = dict(zip((photo.name for photo in part.photos), elements, strict=True))
        return orientations, {part.point_names[row]: state.points[row].copy() for row in tied}

    def approach_solution(self) -> None:
        """Linearise everything at the solution until what corrections neglect is far below any standard deviation."""
        for _ in range(_RELINEARISATIONS):
            reduced = self.equations.triangle.solution()
            if not (self._far_photos(reduced, _SHOWN) or self._far_points(self.values.points, reduced, _SHOWN)):
                break
            self.relinearise()

    def linearise_again(self) -> None:
        """Linearise what is in at the values, control with its present weight."""
        included = set(self.equations.included)
        moved = self._valued()
        rows = {} if moved is None else self.linearised(moved)
        self.equations.relinearise({key: rows[key] for key in rows if key in included})

    def start(self, first: FirstValues) -> None:
        """Orient the first photos, and take in all observations of photos and points with values.

        These are values of a robust adjustment: what is wrong would only lead away from them.
        """
        self.values.start(self.measurements, first)
        if first.known is not None and self.values.orientations:
            # it starts some photos; the others follow one after the other, and then all share their errors
            self.values.advance(self.measurements, self.measurements.photos, self.measurements.points)
            if (whole := self._valued()) is not None:
                self.values.adjust(with_cameras_held(whole))
        part = self._valued()
        if part is not None:
            rows = self.linearised(part)
            self.equations.relinearise({key: rows[key] for key in rows if key not in self.left_out})

    def _valued(self) -> Block | None:
        """Return the photos and points that have values; None if there are none."""
        return self._with_values(self.measurements.whole())

    def _with_values(self, block: Block | None) -> Block | None:
        if block is None or not self.values.orientations:
            return None
        oriented, placed = self.values.is_oriented(block), self.values.is_placed(block)
        return part_of_block(self.values.started(block), oriented, placed)
