"""The unknowns and their order: cameras, mountings, antennas, theodolites, figures, photos, exposures, tied points.

Other points are eliminated, and photos of rigs follow from exposures and mountings.

Within a photo the order is X0, Y0, Z0, KAPPA, OMEGA, PHI: where two control points leave one rotation undetermined,
OMEGA or PHI is reported, and not KAPPA.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from itertools import compress
from operator import index
from typing import NamedTuple, SupportsIndex

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.adjustment.equations import Layout
from orip.arrays import IntArray
from orip.bundle.antennas import name_of_stretch, station_places
from orip.bundle.known_motions import motion_errors
from orip.bundle.rigs.starting import RigColumns
from orip.interior.additional_parameters import PARAMETER_SETS
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, LENS_PLACES, OWN_PARAMETERS, Camera, first_of_lens
from orip.records.definition import ANTENNA_PARAMETERS, DRIFT, MOTION_PARAMETERS, SHIFT
from orip.records.figures import FIGURE_PARAMETERS, UNKNOWNS_OF_FIGURE, figures_in
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.rig import MOUNTING_PARAMETERS, MountedCamera, RigPlaces
from orip.structs import replace

CONSTANT = -1
POINT_COORDINATES = ("X", "Y", "Z")
_PHOTO_ORDER = ("X0", "Y0", "Z0", "KAPPA", "OMEGA", "PHI")


class UnknownName(NamedTuple):
    """An unknown in the user's names: group (CAMERA, ANTENNA, MOUNTING, PHOTO, ...), record or point, kind."""

    group: str
    name: str
    kind: str


class UnknownNames(Struct, frozen=True):
    """Names of all unknowns by their columns; those of eliminated points are made on request.

    Parameters
    ----------
    reduced : tuple of UnknownName, length m
    eliminated : array (b,) of int
        Points that are eliminated.
    fixed : array (3 b,) of bool
        Their constant coordinates, which have no name.
    """

    reduced: tuple[UnknownName, ...]
    point_names: tuple[str, ...]
    eliminated: IntArray
    fixed: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.reduced) + len(self.fixed)

    def __getitem__(self, at: SupportsIndex) -> UnknownName | None:
        column = index(at)
        if column < len(self.reduced):
            return self.reduced[column]
        place = column - len(self.reduced)
        if self.fixed[place]:
            return None
        return UnknownName("POINT", self.point_names[self.eliminated[place // 3]], POINT_COORDINATES[place % 3])

    def __iter__(self) -> Iterator[UnknownName | None]:
        return (self[column] for column in range(len(self)))


class Unknowns(Struct, frozen=True):
    """Columns of the unknowns; `CONSTANT` where a parameter is none.

    Parameters
    ----------
    cameras : array (number of cameras, 13)
        Cameras with the same lens have the same columns, except for their principal points and readouts.
    additional : array (number of cameras, k)
        Parameters of the cameras' sets; k that of the largest set.
    antennas : array (number of antennas, 7)
        In the order of `ANTENNA_PARAMETERS`.
    shifts, drifts : arrays (k, 3)
        Those of the stretches of `StationPlaces`.
    theodolites : array (number of theodolite sets,)
    figures : array (number of figures, 6)
        In the order of `FIGURE_PARAMETERS`.
    photos : array (number of photos, 6)
        In the order of `PHOTO_PARAMETERS`; none of photos of rigs.
    motions : array (number of photos, 6)
        In the order of `MOTION_PARAMETERS`: corrections of the motions of photos of rolling shutters.
    points : array (number of points, 3)
    names : UnknownNames, length m + 3 b
        None for places that are no unknowns.
    rigs : RigColumns or None
        None: there are no photos of rigs.
    """

    cameras: IntArray
    additional: IntArray
    antennas: IntArray
    shifts: IntArray
    drifts: IntArray
    theodolites: IntArray
    figures: IntArray
    photos: IntArray
    motions: IntArray
    points: IntArray
    layout: Layout
    names: UnknownNames
    rigs: RigColumns | None = None

    @property
    def elements(self) -> IntArray:
        """Return the elements of all photos (n, 6) that observations depend on: unknowns, or numbers beyond them."""
        if self.rigs is None:
            return self.photos
        found = self.photos.copy()
        found[self.rigs.photo] = self.rigs.numbers()
        return found


def number_unknowns(block: Block, tied_points: Iterable[int]) -> Unknowns:
    """Give every unknown of a block its column.

    Parameters
    ----------
    tied_points : iterable of int
        Points that an observation ties to another point: they stay in the reduced system.
    """
    names: list[UnknownName] = []
    cameras, additional = _number_cameras(block, names)
    on_rigs = block.places_on_rigs()
    mountings = _number_mountings(on_rigs.mounted, names)
    calibration = len(names)
    antennas, shifts, drifts = _number_antennas(block, names)
    theodolites = np.array(
        [
            _number("THEODOLITE", set_.name, ("R",), () if set_.constant else ("R",), names)[0]
            for set_ in block.theodolites
        ],
        dtype=np.int64,
    )
    figures = _number_figures(block, names)
    photos, motions = _number_photos(block, names, frozenset(photo.photo for photo in on_rigs.photos))
    rigs = _number_exposures(on_rigs, mountings, names)
    tied = np.array(sorted(set(tied_points)), dtype=np.int64)
    points = np.full((len(block.point_names), 3), CONSTANT)
    for point in tied:
        free = {kind for kind, held in zip(POINT_COORDINATES, block.constant_points[point], strict=True) if not held}
        points[point] = _number("POINT", block.point_names[point], POINT_COORDINATES, free, names)

    reduced = len(names)
    is_tied = np.zeros(len(block.point_names), dtype=bool)
    is_tied[tied] = True
    eliminated = np.flatnonzero(~is_tied)
    held = block.constant_points[eliminated]
    points[eliminated] = np.where(held, CONSTANT, reduced + np.arange(3 * len(eliminated)).reshape(-1, 3))
    fixed = np.concatenate([np.zeros(reduced, dtype=bool), held.ravel()])
    layout = Layout(reduced, len(eliminated), fixed, calibration=calibration)
    return Unknowns(
        cameras,
        additional,
        antennas,
        shifts,
        drifts,
        theodolites,
        figures,
        photos,
        motions,
        points,
        layout,
        UnknownNames(tuple(names), block.point_names, eliminated, held.ravel()),
        replace(rigs, first=layout.size) if len(rigs.photo) else None,
    )


def _number_cameras(block: Block, names: list[UnknownName]) -> tuple[IntArray, IntArray]:
    """Return the columns of camera parameters and of sets; cameras of one lens share those of its first camera."""
    sets = [set_names(camera) for camera in block.cameras]
    cameras = np.full((len(sets), len(CAMERA_PARAMETERS)), CONSTANT)
    additional = np.full((len(sets), max(map(len, sets))), CONSTANT)
    first = first_of_lens(block.cameras)
    for row, (camera, set_) in enumerate(zip(block.cameras, sets, strict=True)):
        new = set(camera.unknown) if first[row] == row else set(camera.unknown) & set(OWN_PARAMETERS)
        cameras[row] = _number("CAMERA", camera.name, CAMERA_PARAMETERS, new, names)
        cameras[row, list(LENS_PLACES)] = cameras[first[row], list(LENS_PLACES)]
        unheld = {name for name in set_ if (camera.name, name) not in block.held_additional}
        additional[row, : len(set_)] = _number("CAMERA", camera.name, set_, unheld, names)
    return cameras, additional


_PLACES = [_PHOTO_ORDER.index(kind) for kind in PHOTO_PARAMETERS]


def _number_photos(block: Block, names: list[UnknownName], of_rigs: Container[int]) -> tuple[IntArray, IntArray]:
    """Return the columns of the elements of photos (n, 6), in the order of PHOTO_PARAMETERS, and of their motions.

    Some photos have no elements of their own: they are of rigs.
    """
    photos, motions = [], []
    for row, (photo, moves) in enumerate(zip(block.photos, np.isfinite(motion_errors(block).values), strict=True)):
        free = () if row in of_rigs else set(_PHOTO_ORDER) - set(photo.constant)
        photos.append(_number("PHOTO", photo.name, _PHOTO_ORDER, free, names))
        motions.append(
            _number("PHOTO", photo.name, MOTION_PARAMETERS, tuple(compress(MOTION_PARAMETERS, moves)), names)
        )
    return np.array(photos)[:, _PLACES], np.array(motions)


def _number_mountings(mounted: Sequence[MountedCamera], names: list[UnknownName]) -> IntArray:
    """Return the columns of the mountings of cameras (c, 6), in the order of MOUNTING_PARAMETERS."""
    columns = []
    for camera in mounted:
        given = (camera.mounting.offset, camera.mounting.offset_error), (
            camera.mounting.rotation, camera.mounting.rotation_error,
        )  # fmt: skip
        free = [value is None or error is not None for value, error in given]
        unknown = (*MOUNTING_PARAMETERS[: 3 * free[0]], *MOUNTING_PARAMETERS[3 : 3 + 3 * free[1]])
        columns.append(_number("MOUNTING", camera.name, MOUNTING_PARAMETERS, unknown, names))
    return np.array(columns, dtype=np.int64).reshape(-1, len(MOUNTING_PARAMETERS))


def _number_exposures(places: RigPlaces, mountings: IntArray, names: list[UnknownName]) -> RigColumns:
    """Return the columns of exposures, and those of the mountings."""
    rows = [_number("EXPOSURE", name, _PHOTO_ORDER, _PHOTO_ORDER, names) for name in places.exposures]
    columns = np.array(rows, dtype=np.int64).reshape(-1, len(_PHOTO_ORDER))[:, _PLACES]
    photo, exposure, mounted = np.array(places.photos, dtype=np.int64).reshape(-1, 3).T
    return RigColumns(photo, exposure, mounted, columns, mountings)


def _number_figures(block: Block, names: list[UnknownName]) -> IntArray:
    """Return the columns of figures (n, 6), in the order of FIGURE_PARAMETERS."""
    figures = figures_in(block.figure_points)
    columns = [
        _number("FIGURE", name, FIGURE_PARAMETERS, UNKNOWNS_OF_FIGURE[kind], names)
        for name, kind in zip(figures.names, figures.kinds, strict=True)
    ]
    return np.array(columns, dtype=np.int64).reshape(-1, len(FIGURE_PARAMETERS))


def _number_antennas(block: Block, names: list[UnknownName]) -> tuple[IntArray, IntArray, IntArray]:
    """Return the columns of antennas (n, 7), shifts and drifts (k, 3); a free network has none of these unknowns."""
    places = station_places(block)

    def table(rows: list[list[int]], width: int) -> IntArray:
        return np.array(rows, dtype=np.int64).reshape(-1, width)

    used = {row for row in places.antenna.tolist() if not block.is_free_network}
    antennas = [
        _number("ANTENNA", antenna.name, ANTENNA_PARAMETERS, antenna.unknown if row in used else (), names)
        for row, antenna in enumerate(block.antennas)
    ]
    shifts, drifts = (
        [
            _number("ANTENNA", name_of_stretch(block.antennas[stretch.antenna], stretch), kinds, kinds, names)
            for stretch in stretches
        ]
        for stretches, kinds in ((places.shifts, SHIFT), (places.drifts, DRIFT))
    )
    return table(antennas, len(ANTENNA_PARAMETERS)), table(shifts, 3), table(drifts, 3)


def set_names(camera: Camera) -> tuple[str, ...]:
    """Return the names of a camera's additional parameters; none for a camera without a set."""
    return PARAMETER_SETS[camera.additional_set].parameter_names if camera.additional_set else ()


def _number(
    group: str, name: str, kinds: Sequence[str], unknown: Container[str], names: list[UnknownName]
) -> list[int]:
    """Append the unknown ones of `kinds` to `names` and return their columns in the order of `kinds`."""
    columns = []
    for kind in kinds:
        if kind in unknown:
            names.append(UnknownName(group, name, kind))
        columns.append(len(names) - 1 if kind in unknown else CONSTANT)
    return columns
