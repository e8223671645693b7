"""The block of a session: what is measured, the values it has so far, and the equations that are in."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.bundle.assemble import BlockInput, gather
from orip.bundle.part_of_block import part_of_block
from orip.bundle.problem import starting_state
from orip.bundle.unknowns import number_unknowns
from orip.online.current_values import CurrentValues
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.observations.measurement import PhotoObservations, no_observations
from orip.sequential.hyper_row import ObservationRows
from orip.sequential.observation_rows import ObservationKey, ReducedColumns, linearised
from orip.sequential.sequential_block import SequentialBlock

_LINEAR = 1e-3
"""Corrections of a photo, in radians and parts of its distance, up to which the equations stay as they are: what they
neglect is the square of it, a tenth of a micrometre in the photo."""

_RELINEARISATIONS = 8

Measurement = tuple[str, str, tuple[float, float]]
"""Photo, point and stored coordinates; see `PhotoObservations.measured`."""


class OnlineBlock:
    """A block that grows by measurements.

    Cameras are held between adjustments: those with unknowns are adjusted with the first photos, and again with every
    further one. Additional parameters, directions, and exposure stations with an unknown shift or drift are left to the
    adjustment of the whole block.

    Parameters
    ----------
    inputs : BlockInput
        Its observations are those that there are at the beginning; none is needed.
    """

    def __init__(self, inputs: BlockInput) -> None:
        self.inputs = inputs
        given = inputs.measured.observations.get(record_key(inputs.definition.name))
        self.observations: PhotoObservations = given or no_observations(inputs.definition.name)
        self.values = CurrentValues()
        self.equations: SequentialBlock[ObservationKey] = SequentialBlock()
        self.left_out: set[ObservationKey] = set()
        disregarded = self.observations.disregarded
        # whether one counts is kept in `left_out`, from where it can come back
        self.observations = replace(self.observations, disregarded=np.zeros_like(disregarded))
        self._columns = ReducedColumns()
        self._tied = _names_tied(inputs)
        self.block: Block | None = None
        if self.observations.photos:
            self.gather()
        self.left_out.update(self._keys(np.flatnonzero(disregarded).tolist()))

    def _keys(self, rows: Iterable[int]) -> Iterator[ObservationKey]:
        """Yield the keys of rows of the observations."""
        for row in rows:
            assert self.block is not None, "something is measured"
            names = {record_key(photo.name): photo.name for photo in self.block.photos}
            photo = names[record_key(self.observations.photos[row])]
            yield ObservationKey("photo", photo, self.observations.points[row])

    @property
    def sigma0(self) -> float | None:
        """Return the standard error of unit weight of what is in; None without redundancy."""
        redundancy = self.equations.redundancy
        return float(np.sqrt(self.equations.square_sum / redundancy)) if redundancy > 0 else None

    def gather(self) -> None:
        """Gather the block from all observations.

        Raises
        ------
        InputError
            If a photo is not defined, or has no interior orientation.
        """
        key = record_key(self.inputs.definition.name)
        measured = replace(
            self.inputs.measured, observations={**self.inputs.measured.observations, key: self.observations}
        )
        block = gather(replace(self.inputs, measured=measured))
        antennas = [replace(antenna, unknown=()) for antenna in block.antennas if antenna.shift == "none"]
        moving = len(antennas) < len(block.antennas)
        if self.block is not None and block.ground is not self.block.ground and self.inputs.crs is not None:
            # the local frame lies otherwise: coordinates of before have no meaning in it
            self.forget_values()
        self.block = replace(
            block,
            cameras=tuple(replace(camera, additional_set=None) for camera in block.cameras),
            directions=(),
            antennas=() if moving else tuple(antennas),
            stations=() if moving else block.stations,
        )

    def forget_values(self) -> None:
        """Go back to where nothing is oriented."""
        self.values, self.equations, self._columns = CurrentValues(), SequentialBlock(), ReducedColumns()

    def put(self, measurement: Measurement) -> bool:
        """Add a photo point, or replace what was measured of it; return whether it was measured before.

        Raises
        ------
        InputError
            See `gather`; nothing has changed then.
        """
        photo, point, xy = measurement
        before, row = self.observations, self.row_of(photo, point)
        if row is not None:
            measured = before.measured.copy()
            measured[row] = xy
            self.observations = replace(before, measured=measured)
        else:
            self.observations = PhotoObservations(
                before.bundle,
                (*before.photos, photo),
                (*before.points, point),
                np.vstack([before.measured, xy]),
                np.vstack([before.errors, (np.nan, np.nan)]),
                np.append(before.disregarded, False),
            )
        try:
            self.gather()
        except Exception:
            self.observations = before
            raise
        return row is not None

    def remove(self, photo: str, point: str) -> None:
        """Delete what was measured of a point in a photo."""
        row, before = self.row_of(photo, point), self.observations
        assert row is not None, "only what is measured can be removed"
        kept = np.arange(len(before.photos)) != row
        self.take_out(ObservationKey("photo", before.photos[row], point))
        self.left_out.discard(ObservationKey("photo", before.photos[row], point))
        self.observations = PhotoObservations(
            before.bundle,
            tuple(name for name, keep in zip(before.photos, kept, strict=True) if keep),
            tuple(name for name, keep in zip(before.points, kept, strict=True) if keep),
            before.measured[kept],
            before.errors[kept],
            before.disregarded[kept],
        )
        if self.observations.photos:
            self.gather()
        else:
            self.block = None

    def row_of(self, photo: str, point: str) -> int | None:
        """Return the row of a photo point among the observations; None if it is not measured."""
        key = record_key(photo)
        pairs = zip(self.observations.photos, self.observations.points, strict=True)
        return next(
            (row for row, (name, other) in enumerate(pairs) if other == point and record_key(name) == key), None
        )

    def take_out(self, key: ObservationKey) -> None:
        """Take an observation out of the equations, if it is in."""
        if key in self.equations.included:
            self.equations.exclude(key)

    def forget_photo(self, photo: str) -> None:
        """Take a photo out with all that is measured in it, and the points that are left with fewer than two rays."""
        del self.values.orientations[photo]
        included = self.equations.included
        of_photo = [key for key in included if key.photo == photo]
        rays: dict[str, int] = {}
        for key in included:
            rays[key.point] = rays.get(key.point, 0) + (key.photo != photo)
        lost = {key.point for key in of_photo if key.point and rays[key.point] < 2}
        self.equations.exclude_all([key for key in included if key.photo == photo or key.point in lost])
        for name in lost:
            self.values.points.pop(name, None)

    def rows(self, photos: BoolArray, points: BoolArray) -> dict[ObservationKey, ObservationRows]:
        """Return the equations of some photos and points, of those that have values."""
        assert self.block is not None, "something is measured"
        started = self.values.started(self.block)
        tied = np.array([name in self._tied for name in started.point_names], dtype=bool)
        placed = self.values.is_placed(self.block)
        part = part_of_block(started, photos & self.values.is_oriented(self.block), (points | tied) & placed)
        if not len(part.photos):
            return {}
        return self._linearised(part)

    def adjust(self) -> None:
        """Adjust all that has values with the unknowns of the cameras, and linearise everything there.

        Where nothing of the cameras is unknown, or the result is doubtful, nothing changes.
        """
        part = self._valued()
        if part is not None and any(camera.unknown for camera in part.cameras) and not self.values.adjust(part):
            self._linearise_again()

    def _linearised(self, part: Block) -> dict[ObservationKey, ObservationRows]:
        part = replace(part, cameras=tuple(replace(camera, unknown=()) for camera in part.cameras))
        before = len(self._columns.names)
        rows = linearised(part, starting_state(part), self._tied_rows(part), self._columns)
        self.equations.append(len(self._columns.names) - before)
        return rows

    def _tied_rows(self, block: Block) -> list[int]:
        return [row for row, name in enumerate(block.point_names) if name in self._tied]

    def include(self, photos: Collection[str], points: Collection[str]) -> list[ObservationKey]:
        """Take in what is observed of photos, and of points, as far as it has values and is not left out."""
        assert self.block is not None, "something is measured"
        of_photos = np.array([photo.name in photos for photo in self.block.photos], dtype=bool)
        of_points = np.array([name in points for name in self.block.point_names], dtype=bool)
        found: list[ObservationKey] = []
        every_photo, every_point = np.ones_like(of_photos), np.ones_like(of_points)
        for rows in (
            self.rows(of_photos, every_point) if of_photos.any() else {},
            self.rows(every_photo, of_points) if of_points.any() else {},
        ):
            for key, equations in rows.items():
                if key not in self.equations.included and key not in self.left_out:
                    self.equations.include(key, equations)
                    found.append(key)
        return found

    def trial_rows(self, key: ObservationKey) -> ObservationRows | None:
        """Return the equations of an observation that is not in; None where it has no values."""
        assert self.block is not None, "something is measured"
        photos = np.array([photo.name == key.photo or not key.photo for photo in self.block.photos], dtype=bool)
        points = np.array([name == key.point for name in self.block.point_names], dtype=bool)
        return self.rows(photos, points).get(key)

    def settle(self) -> None:
        """Linearise again at the solution while corrections are too large for the equations."""
        for _ in range(_RELINEARISATIONS):
            if not self._is_far():
                return
            self.relinearise()

    def relinearise(self) -> None:
        """Move all values to the solution, and linearise all equations there."""
        part = self._valued()
        if part is None:
            return
        part = replace(part, cameras=tuple(replace(camera, unknown=()) for camera in part.cameras))
        unknowns = number_unknowns(part, self._tied_rows(part))
        state = starting_state(part).moved(self._correction(part), unknowns)
        for row, photo in enumerate(part.photos):
            self.values.orientations[photo.name] = np.concatenate([state.centres[row], state.angles()[row]])
        for row, name in enumerate(part.point_names):
            self.values.points[name] = state.points[row].copy()
        self._linearise_again()

    def _linearise_again(self) -> None:
        """Linearise what is in at the values."""
        included = set(self.equations.included)
        moved = self._valued()
        assert moved is not None, "there were values before"
        rows = self._linearised(moved)
        self.equations.relinearise({key: rows[key] for key in rows if key in included})

    def start(self, left_out: Iterable[ObservationKey] = ()) -> None:
        """Take in all observations of photos and points with values."""
        self.left_out.update(left_out)
        part = self._valued()
        if part is not None:
            rows = self._linearised(part)
            self.equations.relinearise({key: rows[key] for key in rows if key not in self.left_out})

    def _valued(self) -> Block | None:
        """Return the photos and points that have values; None if there are none."""
        assert self.block is not None, "something is measured"
        oriented, placed = self.values.is_oriented(self.block), self.values.is_placed(self.block)
        return part_of_block(self.values.started(self.block), oriented, placed) if oriented.any() else None

    def _is_far(self) -> bool:
        """Return whether a photo's corrections are too large for the linearisation."""
        reduced = self.equations.triangle.solution()
        at = {(name.group, name.name, name.kind): place for place, name in enumerate(self._columns.names)}
        heights = self._distances()
        for name in self.values.orientations:
            turns = [reduced[at[key]] for kind in ("OMEGA", "PHI", "KAPPA") if (key := ("PHOTO", name, kind)) in at]
            moves = [reduced[at[key]] for kind in ("X0", "Y0", "Z0") if (key := ("PHOTO", name, kind)) in at]
            if np.abs(turns).max(initial=0.0) > _LINEAR or np.abs(moves).max(initial=0.0) > _LINEAR * heights:
                return True
        return False

    def _distances(self) -> float:
        """Return the typical distance of the points from the photos."""
        centres = np.array([value[:3] for value in self.values.orientations.values()])
        points = np.array(list(self.values.points.values()))
        if not (len(centres) and len(points)):
            return np.inf
        return float(np.median(np.linalg.norm(points - centres.mean(axis=0), axis=1)))

    def _correction(self, part: Block) -> FloatArray:
        """Return the corrections of a block's unknowns, in its order."""
        unknowns = number_unknowns(part, self._tied_rows(part))
        reduced, points = self.equations.solution()
        at = {name: place for place, name in enumerate(self._columns.names)}
        found = np.zeros(unknowns.layout.size)
        for column, name in enumerate(unknowns.names.reduced):
            found[column] = reduced[at[name]] if name in at else 0.0
        for place, row in enumerate(unknowns.names.eliminated.tolist()):
            start = unknowns.layout.reduced + 3 * place
            found[start : start + 3] = points.get(part.point_names[row], np.zeros(3))
        found[unknowns.layout.fixed] = 0.0
        return found


def _names_tied(inputs: BlockInput) -> frozenset[str]:
    """Return the points that distances may tie to each other, whether they are measured already or not."""
    return frozenset(name for distance in inputs.control.distances for name in (distance.start, distance.end))
