"""Forecast: what an adjustment of planned photos will know, by the adjustment's own functions at the planned values.

Precision and reliability depend on where photos, points and control are and on the a-priori errors, not on what is
measured (Grafarend 1974, design of first order): one set of normal equations, formed where nothing has been measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct

from orip.adjustment.convergence import ENP_LIMIT, TerminationReason
from orip.adjustment.iteration_state import IterationRecord
from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import VarianceOfUnitWeight, cofactors, variance_of_unit_weight
from orip.adjustment.weights import weighing_from
from orip.arrays import FloatArray
from orip.bundle.additions.candidates import with_rays
from orip.bundle.assemble import theodolite_sets
from orip.bundle.diagnosis import diagnose
from orip.bundle.kinds.photo_point import observe_photo_points
from orip.bundle.local_frame import constants_in_frame, ground_system, photos_in_frame
from orip.bundle.problem import pose_problem
from orip.bundle.results.reliability import reliability_of
from orip.bundle.results.solution import solution_of
from orip.bundle.solve import SolvedBlock
from orip.bundle.starting_state import starting_state
from orip.bundle.undetermined_unknowns import undetermined_with_removed
from orip.bundle.unknowns import number_unknowns
from orip.errors import InputError, NotSolvableError
from orip.planning.geometry import Terrain
from orip.planning.plan import observed
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import Control, Station
from orip.records.definition import Antenna, BundleDefinition
from orip.records.photo import Photo
from orip.records.results.solution import Diagnosis, Solution
from orip.structs import replace
from orip.threads import limited_threads
from orip.units import DEGREES_PER_RADIAN

_ROUNDS = 30
"""A distorted place in the photo converges by a factor of some hundredths a round."""


class Design(Struct, frozen=True):
    """What a network is to be: everything but the measurements.

    Parameters
    ----------
    stations : tuple of Station
        Planned exposures.
    points : array (n, 3)
        Tie points, in the project.
    control : Control
        Control and check points, distances; each point is measured in all photos that show it.
    """

    definition: BundleDefinition
    camera: Camera
    stations: tuple[Station, ...]
    points: FloatArray
    control: Control
    antennas: tuple[Antenna, ...] = ()
    ground_unit: str = "m"
    crs: str | None = None


class Forecast(Struct, frozen=True):
    """What is forecast.

    Parameters
    ----------
    solution : Solution
        With standard deviations, correlations and redundancy numbers for sigma0 = 1, and no residuals.
    diagnosis : tuple of Diagnosis
        What is not determined, or badly, and the remedies.
    """

    solution: Solution
    solved: SolvedBlock
    diagnosis: tuple[Diagnosis, ...]

    @property
    def point_sd(self) -> FloatArray:
        """Return standard deviations (n, 3) of the points, ground unit."""
        return self.solution.points.sd

    def camera_sd(self, parameter: str) -> float:
        """Return the standard deviation of a parameter of the first camera; NaN where it is no unknown."""
        from orip.records.camera import CAMERA_PARAMETERS

        return float(self.solution.cameras.sd[0][CAMERA_PARAMETERS.index(parameter)])

    @property
    def held(self) -> tuple[str, ...]:
        """Return the parameters of the camera that nothing determines: all figures are as if they were known."""
        return tuple(one.kind for one in self.solution.singular if one.group == "CAMERA")

    @property
    def smallest_bias(self) -> float:
        """Return the median of the smallest blunder that is found in a photo coordinate, mm; NaN: none would be."""
        found = reliability_of(self.solution).minimal_detectable_bias[: 2 * len(self.solved.block.photo_points.photo)]
        return float(np.nanmedian(found)) if np.isfinite(found).any() else float("nan")

    @property
    def reliability_of_points(self) -> tuple[FloatArray, FloatArray]:
        """Return for each point the smallest blunder found (n,), mm, in the photo coordinate where it is largest.

        And the most that such a blunder, not found, changes a result (n,), in standard deviations. Infinite where none
        would be found.
        """
        found, rays = reliability_of(self.solution), self.solved.block.photo_points
        place = {name: row for row, name in enumerate(self.solution.points.names)}
        rows = np.array([place.get(name, -1) for name in self.solved.block.point_names], dtype=np.int64)[rays.point]
        values = np.full((2, len(place)), -np.inf)
        for largest, each in zip(values, (found.minimal_detectable_bias, found.external), strict=True):
            of_rays = np.where(np.isnan(each), np.inf, each)[: 2 * len(rows)].reshape(-1, 2).max(axis=1)
            np.maximum.at(largest, rows[rows >= 0], of_rays[rows >= 0])
        return values[0], values[1]

    @property
    def external(self) -> float:
        """Return the median of the most that such a blunder changes a result, in standard deviations."""
        found = reliability_of(self.solution).external[: 2 * len(self.solved.block.photo_points.photo)]
        return float(np.nanmedian(found)) if np.isfinite(found).any() else float("nan")


def tie_points(frame: FloatArray, c: float, stations: Sequence[Station], terrain: Terrain, count: int) -> FloatArray:
    """Return points (n, 3) on a square grid of the ground, about so many to a photo, inside all footprints together.

    Parameters
    ----------
    frame : array (2,)
        Of the photo, mm.
    """
    places = np.array([station.position for station in stations])
    above = float(np.median(places[:, 2] - terrain(places[:, :2])))
    if above <= 0.0:
        message = "the planned photos are below the ground; check their heights, and ground and terrain in [plan]"
        raise InputError.single(message)
    size = frame * above / c
    step = float(np.sqrt(size[0] * size[1] / count))
    reach = 0.5 * float(size.min())
    low, high = places[:, :2].min(axis=0) - reach, places[:, :2].max(axis=0) + reach
    # no grid stands exactly below photos, where points on lines through the nadir would tell less than others
    x, y = np.meshgrid(*(np.arange(a + 0.31 * step, b, step) for a, b in zip(low, high, strict=True)))
    plan = np.column_stack([x.ravel(), y.ravel()])
    return np.column_stack([plan, terrain(plan)])


def design_block(design: Design) -> Block:
    """Return the block of a design: each point in all photos that show it, exactly where it will be.

    Raises
    ------
    InputError
        If no point is in two photos.
    """
    control = design.control
    names = [f"T{number + 1}" for number in range(len(design.points))]
    known = [point for point in control.points if None not in point.coordinates and not point.rejected]
    coordinates = np.array([point.coordinates for point in known], dtype=np.float64).reshape(-1, 3)
    points = np.vstack([design.points.reshape(-1, 3), coordinates])
    names += [point.name for point in known]
    photos = tuple(
        Photo(
            station.photo,
            design.camera.name,
            orientation=(*station.position, *(angle * DEGREES_PER_RADIAN for angle in station.angles)),
        )
        for station in design.stations
    )
    orientation = np.array([[*station.position, *station.angles] for station in design.stations], dtype=np.float64)
    system = ground_system(design.crs, design.ground_unit, known, orientation[:, :3])
    empty = IndexedPhotoPoints(
        np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 2)), np.zeros((0, 2)),
        np.zeros((0, 2), dtype=bool),
    )  # fmt: skip
    block = Block(
        definition=design.definition,
        cameras=(design.camera,),
        photos=photos,
        photo_camera=np.zeros(len(photos), dtype=np.int64),
        photo_orientation=orientation,
        point_names=tuple(names),
        point_start=points,
        photo_points=empty,
        constant_points=np.zeros((len(points), 3), dtype=bool),
        control_points=tuple(known),
        stations=tuple(observed(design.stations)),
        antennas=design.antennas,
        ground=system,
        ground_unit=design.ground_unit,
        defined_cameras=(design.camera,),
    )
    block = photos_in_frame(block)
    block = replace(block, point_start=block.ground.to_local(points))
    seen = with_rays(block, _precision(block.definition, design.camera))
    return _with_points_in_photos(seen, {point.name for point in known}, control)


def _with_points_in_photos(block: Block, given: set[str], control: Control) -> Block:
    """Return the block with the points alone that two photos show, or that are control in one, at their images."""
    rays = np.bincount(block.photo_points.point, minlength=len(block.point_names))
    kept = (rays >= 2) | ((rays >= 1) & np.array([name in given for name in block.point_names], dtype=bool))
    if not (rays >= 2).any():
        message = "no point of the ground is in two of the planned photos; give more overlap, or check the heights"
        raise InputError.single(message)
    number = np.cumsum(kept) - 1
    rows = np.flatnonzero(kept[block.photo_points.point])
    photo_points = block.photo_points.of(rows)
    names = tuple(name for name, stays in zip(block.point_names, kept.tolist(), strict=True) if stays)
    there = set(names)
    points = tuple(point for point in block.control_points if point.name in there)
    constant = np.zeros((len(names), 3), dtype=bool)
    place = {name: row for row, name in enumerate(names)}
    for one in points:
        constant[place[one.name]] = [error == 0.0 for error in one.errors]
    block = replace(
        block,
        point_names=names,
        point_start=block.point_start[kept],
        photo_points=replace(photo_points, point=number[photo_points.point]),
        constant_points=constant,
        control_points=points,
        distances=tuple(one for one in control.distances if {one.start, one.end} <= there),
    )
    block = constants_in_frame(replace(block, theodolites=theodolite_sets(block)))
    return _with_images(block)


def _with_images(block: Block) -> Block:
    """Return the block with photo coordinates at which all residuals are zero."""
    kind = observe_photo_points(block, number_unknowns(block, frozenset()))
    state, xy = starting_state(block), block.photo_points.xy
    for _ in range(_ROUNDS):
        kind = replace(kind, xy=xy)
        residual = np.concatenate([part.linearise_with_partials(state).residual for part in kind.in_parts()])
        xy = xy + residual.reshape(-1, 2)
        if float(np.abs(residual).max(initial=0.0)) < 1e-9:
            break
    return replace(block, photo_points=replace(block.photo_points, xy=xy))


def forecast(block: Block) -> Forecast:
    """Return precision and reliability of a block at its starting values, with sigma0 = 1 and without iterations.

    Raises
    ------
    NotSolvableError
        If nothing is unknown.
    """
    problem = pose_problem(block)
    if not problem.layout.unknowns:
        message = "every camera, photo and point is constant: there is nothing to forecast"
        raise NotSolvableError(message)
    state = starting_state(block)
    with limited_threads(None):
        equations = problem.linearise(state)
        weights = np.where(equations.active, 1.0, 0.0)
        normals = solve_normals(equations, weights, problem.layout, block.definition.max_lost_digits)
        normals = normals.with_constraints(equations)
        precision = cofactors(equations, normals, problem.inner_constraints(state))
        undetermined = undetermined_with_removed(problem, equations, weights, normals, precision)
    removed = int(np.count_nonzero(normals.removed))
    found = variance_of_unit_weight(equations, weights, precision.leverage, problem.layout.unknowns - removed)
    variance = VarianceOfUnitWeight(1.0, 1.0, found.redundancy, found.redundancy_used, found.redundancy_numbers)
    record = IterationRecord(1, ENP_LIMIT, 1.0, 0, removed, False, int(np.count_nonzero(equations.active)))
    weighing = weighing_from(block.definition.max_standard_residual, None, early=False)
    solved = SolvedBlock(
        state, equations, weights, normals, state, (record,), TerminationReason.CONVERGED, weighing, problem,
        precision, variance, undetermined,
    )  # fmt: skip
    kept = (one for one in diagnose(solved) if not (one.code == "not-significant" and "not significant" in one.text))
    return Forecast(solution_of(solved), solved, tuple(kept))


def _precision(definition: BundleDefinition, camera: Camera) -> FloatArray:
    """Return the a-priori errors (2,) of photo coordinates, mm.

    Raises
    ------
    InputError
        If they are in pixels, and the camera has none.
    """
    given = definition.measurement_precision
    if given.unit == "mm":
        return np.full(2, given.value)
    if camera.sensor is None:
        message = f"measurement_precision is in px, but camera {camera.name} has no sensor; give it in mm"
        raise InputError.single(message, "orip.toml")
    sensor = camera.sensor
    return given.value * np.array([sensor.width / sensor.columns, sensor.height / sensor.rows])


_CLOSE = 0.01
"""Relative difference from what is wanted at which no better height is sought."""

_MOST_TRIALS = 12
_FARTHEST = 8.0
"""Factor between a height and the next trial, at most."""

_GAIN = 0.8
"""Part of the standard deviation that half the height leaves at most, where lower flights help."""


def height_for(sd: float, first: float, sd_at: Callable[[float], float], unit: str) -> float:
    """Return the height at which a standard deviation is what is wanted, or up to a hundredth less.

    By regula falsi in logarithms: over like ground a standard deviation is nearly proportional to the height.

    Parameters
    ----------
    first : float
        A height to begin with.
    sd_at : callable
        Returns the standard deviation from a height; infinite where nothing determines the points.
    unit : str
        Of lengths.

    Raises
    ------
    InputError
        If no height gives it: positions or control are not known well enough.
    """
    tried: dict[float, float] = {}
    height = first
    for _ in range(_MOST_TRIALS):
        found = tried[height] = sd_at(height)
        if found <= sd and found >= sd * (1.0 - _CLOSE):
            return height
        farther = [value for one, value in tried.items() if one >= 2.0 * height and math.isfinite(value)]
        if found > sd and farther and found > _GAIN * min(farther):
            break  # a flight still lower would have thousands of photos
        height = _next(tried, sd * (1.0 - 0.5 * _CLOSE), height)
    kept = [one for one, value in tried.items() if value <= sd]
    if kept:
        return max(kept)
    best = min(tried, key=lambda one: tried[one])
    message = (
        f"sd = {sd:g} is not reached: the heights of the points get {tried[best]:.3g} {unit} from {best:.4g} {unit} "
        "above ground, and lower flights gain nothing; give smaller a-priori errors (position_error, control), more "
        "overlap, or a larger sd"
    )
    raise InputError.single(message, "orip.toml")


def _next(tried: dict[float, float], wanted: float, last: float) -> float:
    """Return the next height: between two that enclose what is wanted, or farther out."""
    low = max((one for one, value in tried.items() if value <= wanted), default=None)
    high = min((one for one, value in tried.items() if value > wanted and (low is None or one > low)), default=None)
    if low is not None and high is not None and math.isfinite(tried[high]):
        part = math.log(wanted / tried[low]) / math.log(tried[high] / tried[low])
        # of two ends one would stay for ever
        part = min(max(part, 0.1), 0.9)
        return float(low * (high / low) ** part)
    if low is not None and high is not None:
        return math.sqrt(low * high)
    ratio = wanted / tried[last] if math.isfinite(tried[last]) else 0.0
    return last * min(max(ratio, 1.0 / _FARTHEST), _FARTHEST)
