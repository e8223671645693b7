"""Photo points: the collinearity of ground point, projection centre and measured photo coordinates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns
from orip.geometry.perspective import Perspective
from orip.geometry.projection import projected_with_partials
from orip.geometry.rolling_shutter import Motion, MovingImage, moving_image_with_partials
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera
from orip.interior.image_coordinates import ImageResiduals, SetValues, image_residuals_with_partials
from orip.interior.motions import readout_a_mm, rows_of_readout
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, READOUT, AdditionalSet
from orip.records.coded_names import CodedNames, coded
from orip.records.observation_kinds import PHOTO_POINT, measured_before, measurement_name
from orip.set_aside import set_aside

_CAMERA = len(CAMERA_PARAMETERS)
_ROTATION, POINT_PARTIALS = slice(_CAMERA + 3, _CAMERA + 6), slice(_CAMERA + 6, _CAMERA + 9)
_FIRST_ADDITIONAL = POINT_PARTIALS.stop


class PhotoPointObservations(Observations, frozen=True):
    """n photo points, 2 n equations: x and y of each point in turn.

    Parameters
    ----------
    photo, point, camera : arrays (n,) of int
    xy : array (n, 2)
        Measured photo coordinates, mm.
    at_measured : array (n,) of bool
        The camera's polynomial is given at measured coordinates.
    is_equidistant : array (n,) of bool
        The camera's projection; else the perspective.
    sets : tuple of (camera, set, base)
        Cameras with additional parameters.
    readout_a_mm : array (number of cameras, 2) or None
        See `orip.interior.motions.readout_a_mm`; None: no camera has a readout.
    """

    rows: Rows
    photo: IntArray
    point: IntArray
    camera: IntArray
    xy: FloatArray
    at_measured: BoolArray
    is_equidistant: BoolArray
    sets: tuple[tuple[int, AdditionalSet, float], ...]
    unknowns: Unknowns
    readout_a_mm: FloatArray | None = None

    def columns(self) -> NDArray[np.int32]:
        """Return the unknowns (2 n, k) that each equation touches; computed on request, as there may be millions."""
        tables, places = self.unknowns, [self.camera, self.photo, self.point, self.camera]
        columns = [tables.cameras, tables.elements, tables.points, tables.additional]
        if self.has_unknown_motions:
            columns.append(tables.motions)
            places.append(self.photo)
        of_points = [table.astype(np.int32)[place] for table, place in zip(columns, places, strict=True)]
        return np.repeat(np.concatenate(of_points, axis=1), 2, axis=0)

    @property
    def has_unknown_motions(self) -> bool:
        """Return whether the motions of photos are unknowns."""
        return bool((self.unknowns.motions != CONSTANT).any())

    def of(self, chosen: BoolArray) -> PhotoPointObservations:
        """Return some of the photo points, given as (n,)."""
        places = np.flatnonzero(chosen)
        return self._at(places, (2 * places[:, None] + np.arange(2)).ravel())

    def in_parts(self) -> Iterator[PhotoPointObservations]:
        """Yield the photo points some thousands at a time."""
        for part in parts(len(self.xy)):
            yield self._at(part, slice(2 * part.start, 2 * part.stop))

    def _at(self, places: IntArray | slice, rows: IntArray | slice) -> PhotoPointObservations:
        """Return the photo points at some places, with their equations."""
        given = self.rows
        some = Rows(
            kind=given.kind,
            photo=coded(given.photo)[rows],
            point=coded(given.point)[rows],
            component=coded(given.component)[rows],
            observed=given.observed[rows],
            error=given.error[rows],
            used=given.used[rows],
            columns=None,
        )
        return PhotoPointObservations(
            some, self.photo[places], self.point[places], self.camera[places], self.xy[places],
            self.at_measured[places], self.is_equidistant[places], self.sets, self.unknowns,
            self.readout_a_mm,
        )  # fmt: skip

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return residuals (mm) and partials by camera (13), photo (3 + 3), point (3), set and motion (6).

        For a polynomial at "measured" coordinates the residual is that of the corrected coordinate.
        """
        parameters = state.cameras[self.camera]
        moving = self.moving_image(state)
        image = moving.image
        residual = np.empty_like(self.xy)
        motions = _FIRST_ADDITIONAL + state.additional.shape[1]
        partials = np.zeros((len(self.xy), 2, motions + 6 * self.has_unknown_motions))
        for rows, at_measured, additional in self._groups(state):
            found = image_residuals_with_partials(
                image.xy[rows], self.xy[rows], parameters[rows, 1:READOUT], at_measured, additional
            )
            residual[rows] = found.value
            partials[rows, :, : _FIRST_ADDITIONAL + found.by_additional.shape[2]] = _chained(image.of(rows), found)
            if self.readout_a_mm is not None:
                partials[rows, :, READOUT] = (found.by_ideal @ moving.by_readout[rows, :, None])[:, :, 0]
            if self.has_unknown_motions:
                by_motion = np.concatenate([moving.by_velocity[rows], moving.by_rate[rows]], axis=2)
                partials[rows, :, motions:] = found.by_ideal @ by_motion
        partials[:, :, _ROTATION] = partials[:, :, _ROTATION] @ state.rotation_basis()[self.photo]
        residual[~image.in_front] = 0.0
        partials[~image.in_front] = 0.0
        return Linearisation(residual.ravel(), partials.reshape(-1, partials.shape[2]), np.repeat(image.in_front, 2))

    def moving_image(self, state: BlockState, row: float | None = None) -> MovingImage:
        """Return the ideal coordinates, each at the time of its row, or all of one."""
        offset = state.points[self.point] - state.centres[self.photo]
        rotation, parameters = state.rotations[self.photo], state.cameras[self.camera]
        if self.readout_a_mm is None:
            image = projected_with_partials(offset, rotation, parameters[:, 0], self.is_equidistant)
            return MovingImage(image, *[np.empty(0)] * 3)
        # during a whole readout: what is corrected does not depend on how long it takes
        steady = state.motions[self.photo]
        motion = parameters[:, READOUT, None] * steady + state.motion_corrections[self.photo]
        found = moving_image_with_partials(
            offset, rotation, parameters[:, 0], self.is_equidistant, Motion(motion[:, :3], motion[:, 3:]),
            rows_of_readout(self.readout_a_mm, self.xy, self.camera) if row is None else np.full(len(motion), row),
            np.ones(len(motion)),
        )  # fmt: skip
        by_readout = found.by_velocity @ steady[:, :3, None] + found.by_rate @ steady[:, 3:, None]
        return found._replace(by_readout=by_readout[:, :, 0])

    def _groups(self, state: BlockState) -> Iterator[tuple[BoolArray, bool, SetValues | None]]:
        """Yield the rows (n,) with one form of image equation, the form, and the additional parameters."""
        plain = np.ones(len(self.xy), dtype=bool)
        for camera, name, base in self.sets:
            rows = self.camera == camera
            plain &= ~rows
            if rows.any():
                values = state.additional[camera, : len(PARAMETER_SETS[name].parameter_names)]
                yield rows, bool(self.at_measured[rows][0]), SetValues(name, base, values)
        for at_measured in (False, True):
            rows = plain & (self.at_measured == at_measured)
            if rows.any():
                yield rows, at_measured, None


def _chained(image: Perspective, residuals: ImageResiduals) -> FloatArray:
    """Return the partials (n, 2, 22 + k) of the projection and the image equation together; none by the readout."""
    by_ideal = residuals.by_ideal
    by_point = by_ideal @ image.by_point
    by_distance = by_ideal @ image.by_principal_distance[:, :, None]
    return np.concatenate(
        [
            by_distance, residuals.by_principal_point, residuals.by_coefficients, np.zeros_like(by_distance),
            -by_point, by_ideal @ image.by_rotation, by_point, residuals.by_additional,
        ],
        axis=2,
    )  # fmt: skip


def observe_photo_points(block: Block, unknowns: Unknowns) -> PhotoPointObservations:
    """Return the photo points of a block as observations."""
    points = block.photo_points
    # the compiled loop goes through whole arrays, and would copy a part of a table each time
    xy = np.ascontiguousarray(points.xy)
    camera = set_aside(block.photo_camera[points.photo])
    sets = tuple(
        (row, record.additional_set, base_of_camera(record))
        for row, record in enumerate(block.cameras)
        if record.additional_set is not None
    )
    rows = Rows(
        kind=PHOTO_POINT,
        photo=_twice(CodedNames([photo.name for photo in block.photos], points.photo)),
        point=_twice(names_of_photo_points(block)),
        component=CodedNames(("x", "y"), set_aside(np.tile(np.arange(2, dtype=np.uint8), len(points.photo)))),
        observed=xy.ravel(),
        error=points.error.ravel(),
        used=points.used.ravel(),
        columns=None,
    )
    at_measured = np.array([record.distortion_at == "measured" for record in block.cameras], dtype=bool)
    is_equidistant = np.array([record.projection == "equidistant" for record in block.cameras], dtype=bool)
    return PhotoPointObservations(
        rows, points.photo, points.point, camera, xy, set_aside(at_measured[camera]),
        set_aside(is_equidistant[camera]), sets, unknowns, readout_a_mm(block),
    )  # fmt: skip


def names_of_photo_points(block: Block) -> CodedNames:
    """Return what the measurement of each of n photo points is called."""
    points = block.photo_points
    names = CodedNames(block.point_names, points.point)
    if block.definition.repeated_points != "both":
        return names
    return coded(list(map(measurement_name, names, measured_before(points.photo, points.point).tolist())))


def _twice(names: CodedNames) -> CodedNames:
    """Return each name once for x and once for y."""
    return CodedNames(names.distinct, set_aside(np.repeat(names.codes, 2)))


KINDS = (KindEquations(PHOTO_POINT, observe_photo_points),)
