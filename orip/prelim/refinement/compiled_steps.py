"""Steps of a refinement in the compiled loop; `orip.prelim.refinement.array_steps` does the same with arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import FloatArray
from orip.prelim.compiled import kernels
from orip.prelim.least_squares import LARGEST_TURN
from orip.prelim.rays.image_rays import CAMERA_CORRECTIONS
from orip.prelim.refinement.band_order import band_order
from orip.prelim.refinement.camera_corrections import by_corrections, camera_of, corrected
from orip.prelim.refinement.problem import RayResiduals, RefinementProblem, RefinementState
from orip.prelim.refinement.reduced_equations import ReducedEquations


class CompiledSolver:
    """Normal equations of a refinement in the compiled loop: points eliminated, photos in a band.

    Parameters
    ----------
    problem : RefinementProblem
    """

    def __init__(self, problem: RefinementProblem) -> None:
        self._problem = problem
        self._band_order = band_order(problem)
        self._coupling = np.empty((len(problem.rays.photo), 6, 3))
        self._width = max(6 * self._band_order.places, 6)
        self._camera = camera_of(problem.rays)
        self._seen = np.empty(len(problem.rays.cameras.unknown), dtype=np.int64)
        self._by_camera = by_corrections(problem.rays)
        self._cameras = problem.rays.cameras.unknown.size
        self._prepared: tuple[RefinementState, tuple[NDArray[np.generic], ...]] | None = None

    def _arrays(self, state: RefinementState) -> tuple[NDArray[np.generic], ...]:
        # needed twice: for the residuals of a state, and for the step from there
        if self._prepared is None or self._prepared[0] is not state:
            rays = corrected(self._problem.rays, state.corrections)
            arrays = (
                rays.photo,
                self._problem.point_starts,
                rays.vectors,
                rays.error,
                state.rotations,
                state.centres,
                state.points,
            )
            self._prepared = state, tuple(map(np.ascontiguousarray, arrays))
        return self._prepared[1]

    def residuals(self, state: RefinementState) -> RayResiduals:
        """Return the residuals of all rays."""
        squares, lengths = np.empty((2, len(self._problem.rays.photo)))
        kernels.refinement_residuals(*self._arrays(state), squares, lengths)
        return RayResiduals(squares, lengths, state.of_cameras)

    def weights(self, lengths: FloatArray) -> tuple[FloatArray, float]:
        """Return the Danish weights (m,) of residuals by their lengths, and their robust scale."""
        weights = np.empty(len(lengths))
        unit = self._problem.median_length
        scale = kernels.refinement_weights(lengths, weights, unit, LIMIT_OF_TWO_COMPONENTS, LEAST_WEIGHT)
        return weights, scale

    def moved(self, state: RefinementState, factors: FloatArray, damping: float) -> RefinementState:
        """Return the state after one step with weight factors (m,) of the rays."""
        problem, order, place = self._problem, self._band_order.order, self._band_order.place
        arrays, points, size, cameras = self._arrays(state), len(problem.point_free), 6 * len(order), self._cameras
        inverse, point_right, right = np.empty((points, 3, 3)), np.empty((points, 3)), np.zeros(size)
        band, border = np.zeros((size, self._width)), np.zeros((size, cameras))
        point_border, own, own_right = np.zeros((points, 3, cameras)), np.zeros((cameras, cameras)), np.zeros(cameras)
        kernels.refinement_normals(
            *arrays, place, problem.point_free, factors, self._camera, self._by_camera,
            np.zeros((len(order), 6, 6)), self._coupling, inverse, point_right, band, right,
            border, point_border, own, own_right, self._seen, damping,
        )  # fmt: skip
        equations = ReducedEquations(band.T, right, border, own, own_right)
        solution, of_cameras = equations.solved(state.corrections)
        rotations, centres, ground = (np.empty(values.shape) for values in arrays[4:])
        factor = kernels.refinement_step(
            *arrays, place, self._coupling, inverse, point_right, point_border, np.ascontiguousarray(solution),
            of_cameras, rotations, centres, ground, LARGEST_TURN,
        )  # fmt: skip
        corrections = state.corrections - factor * of_cameras.reshape(-1, CAMERA_CORRECTIONS)
        return RefinementState(rotations, centres, ground, corrections)
