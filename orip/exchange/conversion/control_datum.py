"""Whether the photos of an imported block stand where its control points put them; else the similarity that moves it.

Programs reconstruct a block first and refer it to the ground afterwards, by observed positions of the photos or by
control, and files hold control that had no part in that. The rays to control points and the observed positions tell
scale, rotation and shift between the block and its control; and whether the heights of both have one origin: those of
satellite positions are above the ellipsoid or, in photos of telephones and drones, above anything.
"""

from __future__ import annotations

import contextlib
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.rays import intersect_rays
from orip.geometry.similarity import UNKNOWNS, Similarities, Similarity, fit_similarity, similarity_with_partials
from orip.structs import replace

_TRUE = 1e-3
"""Radians, and part of the distance, by which an imported block is bent and points are marked beside one another."""

_FITS = 3.0
"""Standard error of unit weight up to which block, control and observed positions agree."""

_FAR = 0.05
"""Radians between rays and control beyond which preliminary values have to be moved; less is left to the adjustment."""

_FEWEST_REDUNDANT = 3
"""Redundant observations below which anything would fit."""

_SIGNIFICANT = 3.5
"""Standard deviations."""

_LOWEST_STEP = 1.0
"""Ground units (m): heights that differ by less are not those of two systems."""

_MOST_STEPS, _SMALL, _DAMPING, _STUCK = 100, 1e-9, 1e-3, 1e12
"""Steps, relative gain at which they end, first damping, and that at which nothing improves the fit."""

_LARGEST_CHANGE = 1.0
"""Natural logarithm of the scale, of one step."""

_IN_FRONT = 1.0
"""Radians: with a larger misfit points are behind the photos."""


class ControlRays(NamedTuple):
    """k rays to control points with three coordinates.

    Parameters
    ----------
    origins, directions : arrays (k, 3)
        Projection centres and unit vectors, in the system of the block.
    point : array (k,) of int
        Place of the point among the control points.
    targets : array (k, 3)
        The coordinates of the points.
    """

    origins: FloatArray
    directions: FloatArray
    point: IntArray
    targets: FloatArray


class ObservedCentres(NamedTuple):
    """n projection centres that were observed: in the block, as observed, and their standard deviations, (n, 3)."""

    centres: FloatArray
    positions: FloatArray
    errors: FloatArray


class ControlDatum(Struct, frozen=True):
    """How an imported block is taken to its control.

    Parameters
    ----------
    similarity : Similarity
        From the system of the block as imported to that of the control points.
    height_step, height_step_sd : float
        By how much the observed positions are too high beside the control points, ground units, and its standard
        deviation; 0 where both have one height system.
    moved : float
        Median distance by which projection centres move, ground units.
    misfit_before, misfit_after : float
        Root mean square angle between the rays and the directions of the control points, radians.
    """

    similarity: Similarity
    height_step: float
    height_step_sd: float
    moved: float
    misfit_before: float
    misfit_after: float

    @property
    def turned(self) -> float:
        """Return the angle of the rotation, radians."""
        cosine = (np.trace(self.similarity.rotation) - 1.0) / 2.0
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


class _Fit(NamedTuple):
    """A similarity with the square sum of its standard residuals; height step and its standard deviation."""

    similarity: Similarity
    squares: float
    redundancy: int
    step: float
    step_sd: float

    @property
    def s0(self) -> float:
        """Return the standard error of unit weight."""
        return float(np.sqrt(self.squares / self.redundancy))


def control_datum(rays: ControlRays, observed: ObservedCentres, typical_distance: float) -> ControlDatum | None:
    """Return the similarity from an imported block to its control; None where the block may stay, or none is found.

    Parameters
    ----------
    observed : ObservedCentres
        Those that have weight.
    typical_distance : float
        From photos to points, in the block; the block is taken to be true to a thousandth of it.
    """
    if 2 * len(rays.origins) + 3 * len(observed.centres) - UNKNOWNS - 1 < _FEWEST_REDUNDANT or not len(rays.origins):
        return None
    block, ground = rays.origins.mean(axis=0), rays.targets.mean(axis=0)
    problem = _Problem(
        rays._replace(origins=rays.origins - block, targets=rays.targets - ground),
        ObservedCentres(observed.centres - block, observed.positions - ground, observed.errors),
        _TRUE * typical_distance,
    )
    as_imported = Similarity(1.0, np.eye(3), block - ground)
    chosen = None if problem.fit(as_imported).s0 <= _FITS else _chosen(problem, as_imported)
    if chosen is None:
        return None
    found = chosen.similarity
    whole = Similarity(found.scale, found.rotation, found.apply(-block[None])[0] + ground)
    centres = np.vstack([observed.centres, rays.origins])
    moved = float(np.median(np.linalg.norm(whole.apply(centres) - centres, axis=1)))
    return ControlDatum(whole, chosen.step, chosen.step_sd, moved, problem.misfit(as_imported), problem.misfit(found))


def _chosen(problem: _Problem, as_imported: Similarity) -> _Fit | None:
    """Return the fit with a step between the height systems if that explains more, else that without; or neither."""
    plain = _best(problem, as_imported, has_step=False)
    if len(problem.observed.centres):
        stepped = _best(problem, as_imported, has_step=True)
        if stepped is not None and stepped.s0 <= _FITS and abs(stepped.step) >= _LOWEST_STEP:
            gain = np.inf if plain is None else plain.squares - stepped.squares
            if gain > (_SIGNIFICANT * max(1.0, stepped.s0)) ** 2:
                return stepped
    if plain is None or plain.s0 > _FITS or problem.misfit(as_imported) < _FAR:
        return None
    return plain


class _Problem:
    """Standard residuals of rays and observed positions, and their partials, at a similarity."""

    def __init__(self, rays: ControlRays, observed: ObservedCentres, block_error: float) -> None:
        self.rays, self.observed, self._block_error = rays, observed, block_error

    def at(self, similarity: Similarity, step: float) -> tuple[FloatArray, FloatArray]:
        """Return residuals (m,) and partials (m, 8); the last unknown is the height step.

        A ray misses its point by the vector from the point to the foot on the ray. Only its component across the ray
        counts, which neither moving the foot along the ray nor turning the ray changes to the first order.
        """
        now = Similarities(np.array([similarity.scale]), similarity.rotation[None], similarity.shift[None])
        to_points, along = self._towards(similarity)
        distance = np.einsum("ni,ni->n", to_points, along)
        foot = self.rays.origins + (distance / similarity.scale)[:, None] * self.rays.directions
        moved = similarity_with_partials(now, foot)
        error = _TRUE * np.maximum(np.linalg.norm(to_points, axis=1), np.finfo(float).tiny)
        across = (np.eye(3) - along[:, :, None] * along[:, None, :]) / error[:, None, None]
        of_rays = np.einsum("nki,ni->nk", across, moved.value[0] - self.rays.targets)
        by_rays = np.einsum("nki,niu->nku", across, moved.by_unknowns[0])
        deviation = np.hypot(self.observed.errors, similarity.scale * self._block_error)
        placed = similarity_with_partials(now, self.observed.centres)
        upwards = np.broadcast_to([0.0, 0.0, 1.0], deviation.shape)
        of_centres = (placed.value[0] + step * upwards - self.observed.positions) / deviation
        by_centres = np.dstack([placed.by_unknowns[0], upwards]) / deviation[:, :, None]
        by_rays = np.dstack([by_rays, np.zeros(of_rays.shape)])
        return (
            np.concatenate([of_rays.ravel(), of_centres.ravel()]),
            np.vstack([by_rays.reshape(-1, UNKNOWNS + 1), by_centres.reshape(-1, UNKNOWNS + 1)]),
        )

    def _towards(self, similarity: Similarity) -> tuple[FloatArray, FloatArray]:
        """Return vectors (k, 3) from the photos to the points, and unit vectors (k, 3) along the rays."""
        return self.rays.targets - similarity.apply(self.rays.origins), self.rays.directions @ similarity.rotation.T

    def misfit(self, similarity: Similarity) -> float:
        """Return the root mean square angle between rays and points, radians."""
        to_points, along = self._towards(similarity)
        sine = np.linalg.norm(np.cross(to_points, along), axis=1)
        return float(np.sqrt(np.mean(np.arctan2(sine, np.einsum("ni,ni->n", to_points, along)) ** 2)))

    def fit(self, similarity: Similarity, step: float = 0.0, *, has_step: bool = False) -> _Fit:
        """Return how a similarity fits."""
        residuals, partials = self.at(similarity, step)
        squares = float(residuals @ residuals)
        observations = 2 * len(self.rays.origins) + 3 * len(self.observed.centres)
        redundancy = observations - UNKNOWNS - int(has_step)
        variance = np.linalg.pinv(partials.T @ partials)[-1, -1] if has_step else 0.0
        return _Fit(similarity, squares, redundancy, step, float(np.sqrt(variance * max(1.0, squares / redundancy))))


def _best(problem: _Problem, as_imported: Similarity, *, has_step: bool) -> _Fit | None:
    """Return the best fit from several starts; None where there is none with the points in front of the photos."""
    found = [_adjusted(problem, start, has_step=has_step) for start in _starts(problem, as_imported)]
    in_front = [fit for fit in found if fit is not None and problem.misfit(fit.similarity) < _IN_FRONT]
    return min(in_front, key=lambda fit: fit.squares, default=None)


def _starts(problem: _Problem, as_imported: Similarity) -> list[Similarity]:
    """Return the block as it is; and as points intersected in it, projection centres or both fit what is known."""
    rays = problem.rays
    points = intersect_rays(rays.origins, rays.directions, rays.point, int(rays.point.max()) + 1)
    known = np.isfinite(points).all(axis=1)
    targets = np.full_like(points, np.nan)
    targets[rays.point] = rays.targets
    of_points, of_centres = (points[known], targets[known]), (problem.observed.centres, problem.observed.positions)
    both = (np.vstack([of_points[0], of_centres[0]]), np.vstack([of_points[1], of_centres[1]]))
    starts = [as_imported]
    for source, target in (of_points, of_centres, both):
        with contextlib.suppress(ValueError):  # too few, or on one line
            starts.append(fit_similarity(source, target))
    return starts


def _first_step(problem: _Problem, start: Similarity) -> float:
    """Return by how much the points are seen too high from where the photos start, ground units."""
    rays = problem.rays
    begin, along = start.apply(rays.origins), rays.directions @ start.rotation.T
    distance = np.linalg.norm(rays.targets - begin, axis=1)
    return float(np.median((begin + distance[:, None] * along - rays.targets)[:, 2]))


def _adjusted(problem: _Problem, start: Similarity, *, has_step: bool) -> _Fit | None:
    """Return the least squares fit (Levenberg, Marquardt) from a start; None if it does not converge."""
    unknowns = UNKNOWNS + int(has_step)
    step = _first_step(problem, start) if has_step else 0.0
    now = replace(start, shift=start.shift - [0.0, 0.0, step])
    damping = _DAMPING
    residuals, partials = problem.at(now, step)
    for _ in range(_MOST_STEPS):
        normal = partials[:, :unknowns].T @ partials[:, :unknowns]
        try:
            solved = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -partials[:, :unknowns].T @ residuals)
        except np.linalg.LinAlgError:
            return None
        change = np.zeros(UNKNOWNS + 1)
        change[:unknowns] = solved
        tried = _moved(now, change)
        tried_residuals, tried_partials = problem.at(tried, step + change[-1])
        before = float(residuals @ residuals)
        gain = before - float(tried_residuals @ tried_residuals)
        damping = damping / 10.0 if gain >= 0.0 else damping * 100.0
        if gain >= 0.0:
            now, step, residuals, partials = tried, step + float(change[-1]), tried_residuals, tried_partials
        if 0.0 <= gain <= _SMALL * before or damping > _STUCK:
            return problem.fit(now, step, has_step=has_step)
        if not np.isfinite(gain):
            return None
    return None


def _moved(similarity: Similarity, change: FloatArray) -> Similarity:
    now = Similarities(np.array([similarity.scale]), similarity.rotation[None], similarity.shift[None])
    bounded = change[None, :UNKNOWNS].copy()
    bounded[0, 0] = np.clip(bounded[0, 0], -_LARGEST_CHANGE, _LARGEST_CHANGE)
    return now.moved(bounded).one(0)
