"""A bundle adjustment of plain arrays by a method of choice, without a project folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal, get_args

from orip.api.gathering import Given, block_input
from orip.api.given import (
    Camera,
    ControlPoints,
    Datum,
    Directions,
    Distances,
    Elements,
    Figures,
    GivenDirections,
    PhotoPoints,
    Photos,
    PreliminaryPoints,
    Stations,
)
from orip.api.solution import Solution
from orip.bundle.methods import Method
from orip.bundle.snooping.search import SnoopingSettings
from orip.errors import UsageError
from orip.records.results import solution as records
from orip.records.results.solution import IterationPass
from orip.report.report_input import ReportInput
from orip.solving.solve import NOBODY, solve
from orip.solving.starting_values import gather_bundle
from orip.structs import replace
from orip.threads import limited_threads

Sigma0 = Literal["apriori", "posteriori"]
_ALPHA = 1e-9, 0.5


def method_of(
    snoop: bool, sigma0: Sigma0 | None, alpha: float | None, prune: bool, variance_components: bool
) -> Method:
    """Return the method of an adjustment.

    Raises
    ------
    UsageError
        If `sigma0` or `alpha` is given without `snoop`, or is out of its range.
    """
    if not snoop and (sigma0 is not None or alpha is not None):
        message = "sigma0 and alpha go with snoop=True; add it, or leave them out"
        raise UsageError(message)
    if sigma0 is not None and sigma0 not in get_args(Sigma0):
        message = f"sigma0 is {sigma0!r}; it is one of {', '.join(get_args(Sigma0))}"
        raise UsageError(message)
    if alpha is not None and not _ALPHA[0] <= alpha <= _ALPHA[1]:
        message = f"alpha is {alpha!r}; it is a probability from {_ALPHA[0]:g} to {_ALPHA[1]:g}"
        raise UsageError(message)
    defaults = SnoopingSettings()
    settings = SnoopingSettings(sigma0 or defaults.sigma0, alpha)
    return Method(settings if snoop else None, prune, variance_components)


class Block:
    """What one bundle adjustment is made from: cameras, photos, photo points and ground control.

    Parameters
    ----------
    cameras : list of Camera
    photos : Photos
    photo_points : PhotoPoints
    control_points : ControlPoints, optional
        Without control, give `stations`, observed `elements` or `datum="free"`.
    elements : Elements, optional
    distances : Distances, optional
    directions : Directions, optional
    figures : Figures, optional
    given_directions : GivenDirections, optional
    stations : Stations, optional
    antennas : sequence of dict
        With the keys and values of ``[[antenna]]``.
    rigs, exposures : sequence of dict
        With those of ``[[rig]]``, whose ``camera`` is a list of dicts, and of ``[[exposure]]``.
    preliminary_points : PreliminaryPoints, optional
    name : str
        Of the bundle adjustment, in results and messages.
    ground_unit : str
        Unit of all ground coordinates and their errors.
    crs : str, optional
        Coordinate reference system of the ground coordinates, such as "EPSG:2056".
    measurement_precision : float or str
        A-priori error of photo coordinates without one of their own, mm, or a text such as "0.5px".
    datum : {"control", "free"}
        What fixes the ground system; "free": a free network.
    datum_points : sequence of str
        Points of a free network's inner constraints; all if none is given.
    enp_stop : float
        Iterations end at this exponent of numerical precision.
    max_iterations : int
    start_down_weight : int
        Iteration from which on weights of observations that do not fit are reduced; equal to `max_iterations`, or
        20 and more: never.
    max_standard_residual : float
        Standard residual from which on a weight is reduced.
    max_lost_digits : float
        Decimal digits that a diagonal element may lose before its unknown counts as not determined.
    velocity_error, rate_error : float, optional
        A-priori errors of the motions of photos of rolling shutters, ground unit and degrees a second: these are
        unknowns then.

    Raises
    ------
    InputError
        With everything that is wrong: shapes and types of arrays, numbers, names, and what does not go together; each
        complaint names table, column and index.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        photos: Photos,
        photo_points: PhotoPoints,
        control_points: ControlPoints | None = None,
        *,
        elements: Elements | None = None,
        distances: Distances | None = None,
        directions: Directions | None = None,
        figures: Figures | None = None,
        given_directions: GivenDirections | None = None,
        stations: Stations | None = None,
        antennas: Sequence[Mapping[str, Any]] = (),
        rigs: Sequence[Mapping[str, Any]] = (),
        exposures: Sequence[Mapping[str, Any]] = (),
        preliminary_points: PreliminaryPoints | None = None,
        name: str = "MAIN",
        ground_unit: str = "m",
        crs: str | None = None,
        measurement_precision: float | str = 0.005,
        datum: Datum = "control",
        datum_points: Sequence[str] = (),
        enp_stop: float = 4.0,
        max_iterations: int = 60,
        start_down_weight: int = 2,
        max_standard_residual: float = 5.0,
        max_lost_digits: float = 12.0,
        velocity_error: float | None = None,
        rate_error: float | None = None,
    ) -> None:
        settings = {
            "name": name,
            "measurement_precision": measurement_precision,
            "datum": datum,
            "datum_points": datum_points,
            "enp_stop": enp_stop,
            "max_iterations": max_iterations,
            "start_down_weight": start_down_weight,
            "max_standard_residual": max_standard_residual,
            "max_lost_digits": max_lost_digits,
        }
        motion = {"velocity_error": velocity_error, "rate_error": rate_error}
        settings |= {key: error for key, error in motion.items() if error is not None}
        given = Given(
            cameras,
            photos,
            photo_points,
            control_points,
            elements,
            distances,
            directions,
            figures,
            given_directions,
            stations,
            antennas,
            rigs,
            exposures,
            preliminary_points,
            ground_unit,
            crs,
            settings,
        )
        self._input = block_input(given)
        self._gathered = gather_bundle(self._input)
        self.warnings = self._gathered.warnings
        """What is doubtful in what was given; `Solution.warnings` has it too."""

    def __repr__(self) -> str:
        block = self._gathered
        counts = f"{len(block.photos)} photos, {len(block.point_names)} points"
        return f"<Block {block.definition.name}: {counts}, {len(block.photo_points.photo)} photo points>"

    def adjust(
        self,
        *,
        snoop: bool = False,
        sigma0: Sigma0 | None = None,
        alpha: float | None = None,
        prune: bool = False,
        variance_components: bool = False,
        on_iteration: Callable[[IterationPass], None] | None = None,
    ) -> Solution:
        """Adjust the block. Starting values that are missing are found first.

        Parameters
        ----------
        snoop : bool
            Search for blunders and leave them out, instead of reducing weights.
        sigma0 : {"apriori", "posteriori"}, optional
            With `snoop`: sigma0 is 1 (the default), or estimated.
        alpha : float, optional
            With `snoop`: error probability of one test; if not given, 0.05 of all together, at most 0.001 of one.
        prune : bool
            Hold camera parameters at zero that are not significant or not determinable.
        variance_components : bool
            Estimate the a-priori error of each group of observations, and adjust with these errors.
        on_iteration : callable, optional
            Told each iteration when it is done.

        Returns
        -------
        Solution

        Raises
        ------
        NotSolvableError
            If there is no solution, or photos cannot be oriented; probable causes come first.
        UsageError
            If `sigma0` or `alpha` is given without `snoop`, or is out of its range.
        """
        watcher = NOBODY if on_iteration is None else replace(NOBODY, passed=on_iteration)
        method = method_of(snoop, sigma0, alpha, prune, variance_components)
        with limited_threads(None):
            record, solved = solve(self._gathered, method, watcher)
        return Solution(record, solved, given=partial(self._reported, record))

    def _reported(self, record: records.Solution) -> ReportInput:
        """Return what a report of a solution of this block is made from."""
        given = self._input
        return ReportInput(
            record, (), given.definition, given.records.cameras, given.records.photos, given.records.templates,
            crs=given.crs,
        )  # fmt: skip
