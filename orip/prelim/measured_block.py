"""What preliminary values are found from: the rays of a block, and the control to which they are fitted."""

from __future__ import annotations

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.block_grower import BlockGrower
from orip.prelim.ground import approximate_points, known_centres, known_points
from orip.prelim.growing_block import FromModels
from orip.prelim.rays import ImageRays, PhotoIndex, image_rays, photo_index, rays_of_plane_images, thinned
from orip.prelim.relative.orientation import common_point_counts
from orip.prelim.resection.known_points import FEW_BLUNDERS, MANY_BLUNDERS
from orip.prelim.similarity.absolute_orientation import KnownPositions
from orip.records.block import Block
from orip.records.preliminary import SimilarityStep

_ENOUGH, MORE = 30, 80
"""Points that suffice to orient a photo, and where models are listed point by point or few points tie parts."""

_MANY_CONTRADICTED = 0.05
"""Part of the rays; fewer may be those of a photo that was measured wrong."""


class MeasuredBlock(Struct, frozen=True):
    """A block, its rays and its control.

    Parameters
    ----------
    control, centres : KnownPositions
        Control points and projection centres known on the ground; in a free network, points with approximate
        coordinates: they give it its datum, but hold nothing fixed.
    confirmed : array (n,) of bool
        Which of all rays others do not contradict; all of them unless a large part of a block's rays is wrong.
    rays : ImageRays
        The confirmed rays of as many points as suffice to orient the photos.
    index : PhotoIndex
        Of `rays`.
    common : array (photos, photos)
        Numbers of common points.
    row_of : dict
        Index in `rays` by name of the point.
    control_errors : array (number of points,)
        Root mean square a-priori errors of the coordinates of control, 0 for other points.
    from_models : FromModels
        What has been computed from pairs of photos, of `rays`.
    """

    block: Block
    control: KnownPositions
    centres: KnownPositions
    all_rays: ImageRays
    confirmed: BoolArray
    rays: ImageRays
    index: PhotoIndex
    common: IntArray
    row_of: dict[str, int]
    control_errors: FloatArray
    from_models: FromModels = field(default_factory=FromModels)

    @property
    def is_free(self) -> bool:
        """Return whether the block is a free network, which needs nothing that is known on the ground."""
        return self.block.is_free_network

    @property
    def blunders(self) -> float:
        """Return the largest part of the known points of a photo that may be wrong.

        Where many are contradicted, many are wrong of those that could not be compared, too.
        """
        contradicted = np.count_nonzero(~self.confirmed)
        return MANY_BLUNDERS if contradicted > _MANY_CONTRADICTED * len(self.confirmed) else FEW_BLUNDERS

    @property
    def known_coordinates(self) -> int:
        """Return the number of ground coordinates that are known."""
        return int(np.isfinite(self.control.coordinates).sum() + np.isfinite(self.centres.coordinates).sum())

    def full_control(self, wanted: frozenset[str] | None = None) -> FloatArray:
        """Return the coordinates (number of points, 3) of control points known in full; NaN for others.

        A free network has none.

        Parameters
        ----------
        wanted : frozenset of str, optional
            Names of the control points to return; None: all.
        """
        known = self.known_control()
        if self.is_free:
            known[:] = np.nan
        known[np.isnan(known).any(axis=1)] = np.nan
        if wanted is not None:
            left_out = [row for name, row in self.row_of_control.items() if name not in wanted]
            known[left_out] = np.nan
        return known

    def known_control(self) -> FloatArray:
        """Return all known coordinates (number of points, 3) of control points; NaN where not known."""
        known = np.full((len(self.rays.points), 3), np.nan)
        has_rays = [name in self.row_of for name in self.control.names]
        known[list(self.row_of_control.values())] = self.control.coordinates[has_rays]
        return known

    @property
    def row_of_control(self) -> dict[str, int]:
        """Return the index in `rays` of each control point that has rays, by its name."""
        return {name: self.row_of[name] for name in self.control.names if name in self.row_of}

    def fitting_control(self, absolute: SimilarityStep | None) -> FloatArray:
        """Return the control as `full_control` does, without the points that the absolute orientation down-weighted."""
        if absolute is None:
            return self.full_control()
        fits = np.all(absolute.weight_factor >= 1.0, axis=1)
        return self.full_control(frozenset(name for name, good in zip(absolute.points, fits, strict=True) if good))

    def with_rays(self, confirmed: BoolArray, enough: int = _ENOUGH) -> MeasuredBlock:
        """Return the block with those of all its rays (n,) that others confirm; `enough` points of a photo are kept."""
        from_models = self.from_models.of_other_rays()
        return _measured_block(
            self.block, self.control, self.centres, self.all_rays, confirmed, enough, from_models=from_models
        )

    def grower(self, held: FloatArray | None = None) -> BlockGrower:
        """Return what a block grows with from these rays; `held` (number of points, 3) are points that do not move."""
        nothing = np.full((len(self.rays.points), 3), np.nan)
        return BlockGrower(
            self.rays,
            self.index,
            self.common,
            nothing if held is None else held,
            np.ones(len(self.rays.photos), dtype=bool),
            self.from_models,
            held_errors=self.control_errors,
            blunders=self.blunders,
        )


def measured_block(block: Block) -> MeasuredBlock:
    """Return the rays and the control of a block; in a free network preliminary coordinates are used as control."""
    all_rays = image_rays(block)
    control = approximate_points(block) if block.is_free_network else known_points(block)
    return _measured_block(block, control, known_centres(block), all_rays, np.ones(len(all_rays.photo), dtype=bool))


def _measured_block(
    block: Block,
    control: KnownPositions,
    centres: KnownPositions,
    all_rays: ImageRays,
    confirmed: BoolArray,
    enough: int = _ENOUGH,
    *,
    from_models: FromModels | None = None,
) -> MeasuredBlock:
    known = set(control.names)
    kept = np.array([name in known for name in block.point_names], dtype=bool)
    used = rays_of_plane_images(block, all_rays.of(confirmed))
    rays = thinned(used, kept, max(enough, MORE) if block.definition.models else enough)
    row_of = {name: row for row, name in enumerate(rays.points)}
    return MeasuredBlock(
        block,
        control,
        centres,
        all_rays,
        confirmed,
        rays,
        photo_index(rays),
        common_point_counts(rays),
        row_of,
        _control_errors(control, row_of),
        from_models or FromModels(),
    )


def _control_errors(control: KnownPositions, row_of: dict[str, int]) -> FloatArray:
    errors = np.zeros(len(row_of))
    has_rays = [name in row_of for name in control.names]
    rows = [row_of[name] for name in control.names if name in row_of]
    errors[rows] = np.sqrt(np.mean(np.nan_to_num(control.errors[has_rays]) ** 2, axis=1))
    return errors
