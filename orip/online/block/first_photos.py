"""The first photos of a session: whether there is enough in them, where their adjustment starts, and their points."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.bundle.assemble import with_starting_values
from orip.bundle.local_frame import photos_in_frame
from orip.bundle.unknowns import UnknownName
from orip.errors import NotSolvableError
from orip.online.block.measurements import Measurements
from orip.online.sequential.observation_rows import ObservationKey, ReducedColumns
from orip.online.sequential.sequential_block import SequentialBlock
from orip.records.block import Block
from orip.records.control import PreliminaryPoint
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.preliminary import PreliminaryValues
from orip.records.results.solution import Solution
from orip.solving.starting_values import (
    StartedBlock,
    explained_preliminary_values,
    own_start,
    soon_found_values,
    started_block,
)
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.run_id import changed_inputs
from orip.workflow.status import inputs_now


class PlacesAtSolution(Mapping[str, FloatArray]):
    """Coordinates (3,) of points by name: their values with their corrections, as long as the block does not change.

    Parameters
    ----------
    values : mapping of array (3,)
        Those that the equations have been linearised at.
    tied : mapping of array (3,)
        The points among them that are known already: their corrections are reduced unknowns.
    reduced : array (n,)
        Corrections of the reduced unknowns.
    """

    def __init__(
        self,
        values: Mapping[str, FloatArray],
        tied: Mapping[str, FloatArray],
        equations: SequentialBlock[Any],
        reduced: FloatArray,
    ) -> None:
        self._values, self._tied, self._equations, self._reduced = values, tied, equations, reduced

    def __getitem__(self, name: str) -> FloatArray:
        """Return the coordinates (3,) of a point; raise `KeyError` if it has no values."""
        tied = self._tied.get(name)
        return self._values[name] + self._equations.point_correction(name, self._reduced) if tied is None else tied

    def __contains__(self, name: object) -> bool:
        """Return whether a point has values."""
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        """Yield the names."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._values)


_ENDED = ("converged", "doubtful")
"""What is doubtful about a solution shows in a session again."""


def solution_of_what_is_measured(bundle: BundleState) -> Solution | None:
    """Return the last solution of a bundle if it has converged and nothing that it was computed from has changed.

    Parameters
    ----------
    bundle : BundleState
        With definitions, what is measured, and heads.
    """
    head = bundle.state.head(bundle.name)
    if head is None or head.status not in _ENDED or changed_inputs(head.inputs, inputs_now(bundle)):
        return None
    solution = bundle.state.read_again("solutions", bundles=[bundle.name]).solution(bundle.name)
    # another run may have replaced it meanwhile
    return solution if solution is not None and solution.run == head.run else None


class FirstValues(Struct, frozen=True):
    """How values are found for a block of which none are known.

    Parameters
    ----------
    find : callable
        Runs the chain.
    solution : Solution or None
        An adjustment of the same measurements, which is tried first.
    known : callable or None
        Starts the adjustment of a gathered block at values that a session has already, or raises `NotSolvableError`.
    """

    find: Callable[[Block], PreliminaryValues]
    solution: Solution | None = None
    known: Callable[[Block], StartedBlock] | None = None

    def starts(self, block: Block) -> Iterator[Callable[[], StartedBlock]]:
        """Yield functions that start the adjustment of a gathered block, or raise `NotSolvableError`."""
        if (solution := self.solution) is not None:
            yield lambda: _at_solution(block, solution)
        if (known := self.known) is not None:
            yield lambda: known(block)
        values = cache(lambda: self.find(block))
        yield lambda: _without_given(block, values())
        if np.isfinite(block.photo_orientation).any():
            # given orientations are often far off, and what the chain finds is not
            yield lambda: started_block(block, lambda _: values())


THOROUGH = FirstValues(explained_preliminary_values)
"""At the beginning of a session, with all that is measured."""

SOON = FirstValues(soon_found_values)
"""In an answer: if it does not suffice, it is tried again with more measurements."""


def _at_solution(block: Block, solution: Solution) -> StartedBlock:
    """Return a gathered block with the adjusted values of its photos, points and cameras.

    Raises
    ------
    NotSolvableError
        If a photo was left out of the adjustment.
    """
    rows = {name: row for row, name in enumerate(solution.photos.names)}
    if lacking := [photo.name for photo in block.photos if photo.name not in rows]:
        message = f"photo {lacking[0]} was left out of the last adjustment"
        raise NotSolvableError(message)
    orientation = np.array([solution.photos.values[rows[photo.name]] for photo in block.photos])
    orientation[:, 3:] *= RADIANS_PER_DEGREE
    cameras = dict(zip(solution.cameras.names, solution.cameras.values.tolist(), strict=True))
    points = zip(solution.points.names, solution.points.values.tolist(), strict=True)
    started = replace(
        block,
        photo_orientation=orientation,
        cameras=tuple(
            replace(camera, parameters=tuple(cameras.get(camera.name, camera.parameters))) for camera in block.cameras
        ),
        preliminary=tuple(
            PreliminaryPoint(name, (x, y, z)) for name, (x, y, z) in points if np.isfinite((x, y, z)).all()
        ),
    )
    return StartedBlock(with_starting_values(photos_in_frame(started))[0], block)


def _without_given(block: Block, values: PreliminaryValues) -> StartedBlock:
    """Return a block as the chain starts it; photos that it cannot orient are left out, unless they are constant."""
    constant = np.array([[kind in photo.constant for kind in PHOTO_PARAMETERS] for photo in block.photos])
    return own_start(replace(block, photo_orientation=np.where(constant, block.photo_orientation, np.nan)), values)


COMMON_POINTS = 5
"""Points common to two photos, or control points of one, from which the first photos may be oriented."""

_LATER = 0.1
"""Part by which the measurements have to increase before it is tried again without more control."""

_CARRYING = 3
"""Known points from which a model is placed on the ground."""


def may_start(measurements: Measurements, photo: str) -> bool:
    """Return whether a photo may be oriented by points in common with another one, or by known points."""
    mine = set(measurements.points_in(photo))
    common = (len(mine.intersection(measurements.points_in(other))) for other in measurements.sharing(mine) - {photo})
    if (
        max(common, default=0) >= COMMON_POINTS
        or sum(map(measurements.control.has_coordinates, mine)) >= COMMON_POINTS - 1
    ):
        return True
    return measurements.has_orientation(photo)


def no_start(photo: str) -> str:
    """Return what a photo waits for where `may_start` holds for none."""
    return (
        f"photo {photo} waits: no two photos have {COMMON_POINTS} common points, and no photo has "
        f"{COMMON_POINTS - 1} known points"
    )


class StartAttempts:
    """When it is tried again to orient photos that wait, which takes its time.

    Attributes
    ----------
    changes : int
        How often what is measured, or what of it counts, has changed.
    """

    def __init__(self) -> None:
        self.changes = self._tried_thoroughly = 0
        self._is_control_new = True
        self._next_start = 0
        self._tried: dict[tuple[str, bool], tuple[int, int]] = {}

    def note(self, measurements: Measurements, key: ObservationKey) -> None:
        """Remember that a photo point has changed; what is measured of control decides on what waits."""
        self.changes += 1
        self._is_control_new |= measurements.control.is_about(key.point) or measurements.has_orientation(key.photo)

    def is_due(self, measurements: Measurements) -> bool:
        """Return whether the first photos may be oriented since it was tried: more control, or a tenth more."""
        return self._is_control_new or len(measurements) >= self._next_start

    def started(self, measurements: Measurements) -> None:
        """Remember that it is tried."""
        self._is_control_new = False
        self._next_start = int(len(measurements) * (1.0 + _LATER))

    def is_due_thoroughly(self) -> bool:
        """Return whether anything has changed since this was asked the last time; then the first photos are due."""
        is_due = self._tried_thoroughly != self.changes
        self._tried_thoroughly = self.changes
        self._is_control_new |= is_due
        return is_due

    def may_join(self, measurements: Measurements, oriented: Collection[str], photo: str) -> bool:
        """Return whether photos that are not tied to oriented ones may be oriented together since it was tried.

        Parameters
        ----------
        photo : str
            One of them; empty: any, and thoroughly, as soon as anything of theirs has changed.
        """
        seen: set[str] = set()
        for name in [photo] if photo else measurements.photos:
            if name in oriented or name in seen:
                continue
            group = _waiting_group(measurements, name, oriented)
            seen |= group
            keys = [(other, not photo) for other in sorted(group)]
            control, rays = _control_and_rays(measurements, group)
            before = max(self._tried.get(key, (0, 0)) for key in keys)
            is_due = control > before[0] or rays >= before[1] * (1.0 + _LATER) or (not photo and rays != before[1])
            if is_due and _may_be_placed(measurements, group):
                self._tried.update(dict.fromkeys(keys, (control, rays)))
                return True
        return False


def _waiting_group(measurements: Measurements, photo: str, oriented: Collection[str]) -> set[str]:
    """Return the photos that are tied to one by points, over photos that are not oriented either."""
    group, fresh = {photo}, {photo}
    while fresh:
        points = {point for name in fresh for point in measurements.points_in(name)}
        fresh = {name for name in measurements.sharing(points) if name not in oriented} - group
        group |= fresh
    return group


def _may_be_placed(measurements: Measurements, group: Collection[str]) -> bool:
    """Return whether photos that wait may be oriented together: a model of two, and known points to place it by."""
    rays = {photo: set(measurements.points_in(photo)) for photo in group}
    known = {point for points in rays.values() for point in points if measurements.control.has_coordinates(point)}
    if len(known) < _CARRYING:
        return False
    return any(
        len(mine.intersection(rays[other])) >= COMMON_POINTS
        for photo, mine in rays.items()
        for other in measurements.sharing(mine).intersection(group) - {photo}
    )


def _control_and_rays(measurements: Measurements, group: Collection[str]) -> tuple[int, int]:
    """Return how many photo points of some photos are of control, and how many there are."""
    rays = [point for photo in group for point in measurements.points_in(photo)]
    return sum(map(measurements.control.is_about, rays)), len(rays)


_ANGLES = ("OMEGA", "PHI", "KAPPA")


class PhotoCorrections:
    """The unknowns of photos among the reduced ones; they are looked up when some have been appended.

    Attributes
    ----------
    photos : list of str
        In the order of `largest`.
    """

    def __init__(self, columns: ReducedColumns) -> None:
        self.photos: list[str] = []
        self._columns = columns
        self._seen = 0
        self._rows: dict[str, int] = {}
        self._angles: tuple[list[int], list[int]] = ([], [])
        self._centres: tuple[list[int], list[int]] = ([], [])

    def of(self, names: Sequence[UnknownName], reduced: FloatArray) -> FloatArray:
        """Return the corrections (k,) of some unknowns; 0 of one that no equation has."""
        places = self._columns.known_places(names)
        return np.where(places < 0, 0.0, reduced[np.maximum(places, 0)]) if len(reduced) else np.zeros(len(names))

    def largest(self, reduced: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest correction of the angles and of the centre of each photo (number of photos,)."""
        self._look_up()
        return self._largest(self._angles, reduced), self._largest(self._centres, reduced)

    def _largest(self, found: tuple[list[int], list[int]], reduced: FloatArray) -> FloatArray:
        rows, places = (np.array(part, dtype=np.int64) for part in found)
        largest = np.zeros(len(self.photos))
        np.maximum.at(largest, rows, np.abs(reduced[places]))
        return largest

    def _look_up(self) -> None:
        for place, name in enumerate(self._columns.names[self._seen :], start=self._seen):
            if name.group != "PHOTO":
                continue
            if name.name not in self._rows:
                self._rows[name.name] = len(self.photos)
                self.photos.append(name.name)
            rows, places = self._angles if name.kind in _ANGLES else self._centres
            rows.append(self._rows[name.name])
            places.append(place)
        self._seen = len(self._columns.names)
