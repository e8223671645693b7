"""Photo points: the collinearity of ground point, projection centre and measured photo coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.bundle.kinds.additional_parameter import base_of_camera
from orip.bundle.kinds.observation import Linearisation, Observations, Rows
from orip.bundle.state import State
from orip.bundle.unknowns import Unknowns
from orip.geometry.perspective import Perspective, perspective_with_partials
from orip.interior.additional_parameters import PARAMETER_SETS, additional_with_partials
from orip.interior.distortion import correction_with_partials, distortion_with_partials
from orip.records.block import Block
from orip.records.camera import AdditionalSet
from orip.records.observation_kinds import PHOTO_POINT

_CAMERA, _CENTRE, _ROTATION, POINT_PARTIALS = slice(0, 11), slice(11, 14), slice(14, 17), slice(17, 20)


@dataclass(frozen=True, slots=True)
class PhotoPointObservations(Observations):
    """n photo points, 2 n equations: x and y of each point in turn.

    Parameters
    ----------
    rows : Rows
    photo, point, camera : arrays (n,) of int
    xy : array (n, 2)
        Measured photo coordinates, mm.
    at_measured : array (n,) of bool
        The camera's polynomial is given at measured coordinates.
    sets : tuple of (camera, set, base)
        Cameras with additional parameters.
    unknowns : Unknowns
    """

    rows: Rows
    photo: NDArray[np.int64]
    point: NDArray[np.int64]
    camera: NDArray[np.int64]
    xy: FloatArray
    at_measured: NDArray[np.bool_]
    sets: tuple[tuple[int, AdditionalSet, float], ...]
    unknowns: Unknowns

    def columns(self) -> NDArray[np.int32]:
        """Return the unknowns (2 n, k) that each equation touches; millions of rows are made only when asked for."""
        tables, places = self.unknowns, (self.camera, self.photo, self.point, self.camera)
        columns = (tables.cameras, tables.photos, tables.points, tables.additional)
        of_points = [table.astype(np.int32)[place] for table, place in zip(columns, places, strict=True)]
        return np.repeat(np.concatenate(of_points, axis=1), 2, axis=0)

    def of(self, chosen: NDArray[np.bool_]) -> PhotoPointObservations:
        """Return some of the photo points."""
        twice = np.repeat(chosen, 2)
        rows = self.rows
        some = Rows(
            kind=rows.kind,
            photo=tuple(compress(rows.photo, twice)),
            point=tuple(compress(rows.point, twice)),
            component=tuple(compress(rows.component, twice)),
            observed=rows.observed[twice],
            error=rows.error[twice],
            used=rows.used[twice],
            columns=None,
        )
        return PhotoPointObservations(
            some, self.photo[chosen], self.point[chosen], self.camera[chosen], self.xy[chosen],
            self.at_measured[chosen], self.sets, self.unknowns,
        )  # fmt: skip

    def linearise_with_partials(self, state: State) -> Linearisation:
        """Return residuals (mm) and partials by 11 camera, 3 + 3 photo and 3 point unknowns and the additional ones.

        For a polynomial at "measured" coordinates the residual is that of the corrected coordinate.
        """
        parameters = state.cameras[self.camera]
        image = perspective_with_partials(
            state.points[self.point] - state.centres[self.photo], state.rotations[self.photo], parameters[:, 0]
        )
        residual = np.empty_like(self.xy)
        partials = np.zeros((len(self.xy), 2, 20 + state.additional.shape[1]))
        for rows, linearise in ((~self.at_measured, _at_ideal), (self.at_measured, _at_measured)):
            if rows.any():
                residual[rows], partials[rows, :, :20] = linearise(image.of(rows), self.xy[rows], parameters[rows])
        for camera, name, base in self.sets:
            self._deform(camera, name, base, state, image, residual, partials)
        partials[:, :, _ROTATION] = partials[:, :, _ROTATION] @ state.rotation_basis()[self.photo]
        residual[~image.in_front] = 0.0
        partials[~image.in_front] = 0.0
        return Linearisation(
            residual.ravel(), partials.reshape(len(residual.ravel()), -1), np.repeat(image.in_front, 2)
        )

    def _deform(
        self, camera: int, name: AdditionalSet, base: float, state: State, image: Perspective, residual: FloatArray,
        partials: FloatArray,
    ) -> None:  # fmt: skip
        """Add the deformation of a camera's parameter set, at the ideal or measured place in the fiducial system."""
        rows = self.camera == camera
        count = len(PARAMETER_SETS[name].parameter_names)
        at_measured = self.at_measured[rows]
        principal_point = state.cameras[camera, 1:3]
        place = np.where(at_measured[:, None], self.xy[rows], principal_point + image.xy[rows])
        found = additional_with_partials(name, place, base, state.additional[camera, :count])
        residual[rows] += found.value
        by_place = np.where(at_measured[:, None, None], 0.0, found.by_xy)
        partials[rows, :, :20] += _partials(image.of(rows), by_place, by_place, np.zeros((1, 2, 8)))
        partials[rows, :, 20 : 20 + count] = found.by_values


def _at_ideal(image: Perspective, xy: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    distortion = distortion_with_partials(image.xy, parameters[:, 3:])
    residual = parameters[:, 1:3] + image.xy + distortion.value - xy
    by_ideal = np.eye(2) + distortion.by_xy
    return residual, _partials(image, by_ideal, np.broadcast_to(np.eye(2), by_ideal.shape), distortion.by_coefficients)


def _at_measured(image: Perspective, xy: FloatArray, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    corrected = correction_with_partials(xy - parameters[:, 1:3], parameters[:, 3:])
    by_ideal = np.broadcast_to(np.eye(2), corrected.by_xy.shape)
    return image.xy - corrected.value, _partials(image, by_ideal, corrected.by_xy, -corrected.by_coefficients)


def _partials(
    image: Perspective, by_ideal: FloatArray, by_principal_point: FloatArray, by_coefficients: FloatArray
) -> FloatArray:
    result = np.empty((len(image.xy), 2, 20))
    result[:, :, 0] = (by_ideal @ image.by_principal_distance[:, :, None])[:, :, 0]
    result[:, :, 1:3] = by_principal_point
    result[:, :, 3:11] = by_coefficients
    result[:, :, POINT_PARTIALS] = by_ideal @ image.by_point
    result[:, :, _CENTRE] = -result[:, :, POINT_PARTIALS]
    result[:, :, _ROTATION] = by_ideal @ image.by_rotation
    return result


def observe_photo_points(block: Block, unknowns: Unknowns) -> PhotoPointObservations:
    """Return the photo points of a block as observations."""
    points = block.photo_points
    camera = block.photo_camera[points.photo]
    sets = tuple(
        (row, each.additional_set, base_of_camera(each))
        for row, each in enumerate(block.cameras)
        if each.additional_set is not None
    )
    rows = Rows(
        kind=PHOTO_POINT,
        photo=_named_twice([photo.name for photo in block.photos], points.photo),
        point=_named_twice(block.point_names, points.point),
        component=("x", "y") * len(points.photo),
        observed=points.xy.ravel(),
        error=points.error.ravel(),
        used=points.used.ravel(),
        columns=None,
    )
    at_measured = np.array([each.distortion_at == "measured" for each in block.cameras], dtype=bool)[camera]
    return PhotoPointObservations(rows, points.photo, points.point, camera, points.xy, at_measured, sets, unknowns)


def _named_twice(names: Sequence[str], places: NDArray[np.int64]) -> tuple[str, ...]:
    """Return the name at each place, once for x and once for y."""
    return tuple(np.repeat(np.array(names, dtype=object)[places], 2).tolist())
