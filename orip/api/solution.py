"""The result of an adjustment: figures, estimates, residuals, and covariances between any of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from orip.api.estimates import AdjustedCamera, AdjustedCameras, AdjustedPhotos, AdjustedPoints
from orip.api.plots import Plots
from orip.api.tables import HasTable, ObservationResiduals, TableName, data_frame, residuals_of, solution_html
from orip.arrays import FloatArray
from orip.bundle.results.covariance import (
    Figures,
    NormalEquations,
    camera_figures,
    covariance,
    normal_equations,
    photo_figures,
    point_figures,
)
from orip.bundle.results.figures import figure
from orip.bundle.solve import SolvedBlock
from orip.errors import InputError, ProjectWarning, UnknownNameError
from orip.files.result.json_text import result_text
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import PointKind
from orip.records.definition import BundleDefinition
from orip.records.results import solution as records
from orip.records.results.tests import GATE_FIGURES, Status
from orip.report.report_input import ReportInput

if TYPE_CHECKING:
    import pandas as pd

    from orip.workflow.adjust.report import ReportKind

Names = str | Sequence[str]


class Solution:
    """The result of a bundle adjustment, as `Block.adjust`, `Project.solve` and `Project.solution` return it.

    Attributes
    ----------
    bundle : str
        Name of the bundle adjustment.
    ground_unit : str
        Unit of all ground coordinates.
    run : str
        Identifies project, inputs and settings, as on the listings; empty without a project.
    status : {"converged", "doubtful", "not_converged", "stopped", "not_determined"}
    sigma0 : float
        Standard error of unit weight, from the observations of full weight; NaN without redundancy.
    sigma0_all : float
        The same from all observations with their weights.
    redundancy : int
    observations : int
        Components that take part.
    unknowns : int
    iterations : tuple of IterationPass
        Number, exponent of numerical precision and sigma0 of each iteration.
    blunders : tuple of Blunder
        What data snooping left out, in the order in which it was found.
    check_points : tuple of CheckPoint
        Adjusted minus given coordinates.
    variance_components : tuple of VarianceComponent
        By which factor the a-priori errors of each group of observations are wrong, if that was asked for.
    zero_directions : tuple of ZeroDirection
        Of each set of theodolite directions: `set`, `value` (R: the azimuth of a reading of 0), `sd`; degrees. The sd
        is NaN for a constant and infinite for what nothing determines.
    figures : tuple of FigureEstimate
        Of each line, plane, cylinder and common height: `name`, `kind`, `points`, a place `X`, `Y`, `Z`, direction
        `dX`, `dY`, `dZ`, `radius`, `sd_place`, `sd_direction` (degrees), `sd_radius`, `rms` of its distances.
    antennas : tuple of AntennaEstimate
        Parameters of each antenna, and shifts and drifts: `antenna`, `strip`, `name`, `value`, `sd`; ground unit,
        degrees, seconds. The sd is NaN for a constant and infinite for what nothing determines.
    mountings : tuple of MountingEstimate
        Of each camera on a rig: `rig`, `camera`, `name`, `value`, `sd`; ground unit, degrees. The sd is as of antennas.
    exposures : tuple of ExposureEstimate
        Of each exposure of a rig, as of photos: `exposure`, `rig`, `name`, `value`, `sd`.
    motions : tuple of PhotoMotion
        Of each photo of a rolling shutter: `photo`, `VX` to `WZ`, each with its `_sd`, and `pixels`; ground unit and
        degrees a second. The sd is NaN of what is no unknown, infinite of what nothing determines.
    correlations : tuple of Correlation
        Between the parameters of each camera, and of each antenna.
    singular : tuple of SingularUnknown
        Unknowns that nothing determines.
    diagnosis : tuple of Diagnosis
        Weaknesses of the block, with what to do.
    warnings : tuple of ProjectWarning
        What is doubtful in the input.
    """

    def __init__(
        self,
        record: records.Solution,
        solved: SolvedBlock | None = None,
        write: Callable[[], None] | None = None,
        given: Callable[[], ReportInput] | None = None,
    ) -> None:
        self._record = record
        self._solved = solved
        self._write = write
        self._given = given
        self.bundle = record.bundle
        self.ground_unit = record.ground_unit
        self.run = record.run
        self.status: Status = record.status
        self.sigma0 = record.sigma0
        self.sigma0_all = record.sigma0_all
        self.redundancy = record.redundancy
        self.observations = record.observations
        self.unknowns = record.unknowns
        self.iterations = record.iterations
        self.blunders = record.blunders
        self.check_points = record.check_points
        self.variance_components = record.variance_components
        self.zero_directions = record.zero_directions
        self.figures = record.figures
        self.antennas = record.antennas
        self.mountings = record.mountings
        self.exposures = record.rig_exposures
        self.motions = record.motions
        self.correlations = record.correlations
        self.singular = record.singular
        self.diagnosis = record.diagnosis
        self.warnings = tuple(ProjectWarning(*warning) for warning in record.warnings)

    def __repr__(self) -> str:
        counts = f"{len(self.photos)} photos, {len(self.points)} points"
        return f"<Solution of bundle {self.bundle}: {self.status}, sigma0 {self.sigma0:.4f}, {counts}>"

    def _repr_html_(self) -> str:
        return solution_html(self._record)

    @cached_property
    def plot(self) -> Plots:
        """Return the figures of the report, as figures of plotly: ``solution.plot.residuals()``."""
        return Plots(self._report_input)

    @cached_property
    def points(self) -> AdjustedPoints:
        """Return the ground points."""
        found = self._record
        return AdjustedPoints(
            found.points.names,
            cast("tuple[PointKind, ...]", tuple(found.point_kinds)),
            found.point_rays.tolist(),
            found.points.values,
            found.points.sd,
            found.point_correlations,
            found.ground_unit,
        )

    @cached_property
    def photos(self) -> AdjustedPhotos:
        """Return the photos."""
        found = self._record.photos
        about_axes = self._record.photo_rotation_sd_about_axes
        unit = self.ground_unit
        return AdjustedPhotos(found.names, found.values, found.sd, about_axes, self.covariance, unit)

    @cached_property
    def cameras(self) -> AdjustedCameras:
        """Return the cameras, each with the additional parameters of its set."""
        found = self._record.cameras
        return AdjustedCameras(list(map(self._camera, range(len(found.names)))))

    @cached_property
    def residuals(self) -> ObservationResiduals:
        """Return the residuals of all observation components."""
        return residuals_of(self._record.residuals, self.ground_unit)

    def covariance(self, rows: Names, columns: Names | None = None) -> FloatArray:
        """Return the covariances between the unknowns of records.

        Parameters
        ----------
        rows : str or sequence of str
            Records by kind and name, such as "photo 102", "camera C35" and "point CP3"; a point by its name alone, too.
            Several follow one another in the rows of the result.
        columns : str or sequence of str, optional
            The same for the columns; those of `rows` if not given.

        Returns
        -------
        array (r, c)
            A point has three rows or columns: X, Y, Z (ground units); a photo six: X0, Y0, Z0 (ground units), OMEGA,
            PHI, KAPPA (degrees); a camera those of its `parameter_names`. Cofactors of the inverse of the normal
            equations, times sigma0² (1 without redundancy). Zero for constants, NaN for what nothing determines.

        Raises
        ------
        UnknownNameError
            If there is no such record.
        InputError
            If the solution was read from a project: normal equations are not stored.
        """
        if self._solved is None:
            message = (
                "a solution that was read from a project has no covariances between records: normal equations are not "
                "stored; project.solve() computes them again"
            )
            raise InputError.single(message)
        one = self._figures(rows)
        return covariance(self._solved, one, one if columns is None else self._figures(columns))

    def normal_equations(self) -> NormalEquations:
        """Return the normal equations at the solution: names, sparse matrix, right-hand side; see `NormalEquations`.

        Raises
        ------
        InputError
            If the solution was read from a project: normal equations are not stored.
        """
        if self._solved is None:
            message = "a solution that was read from a project has no normal equations; project.solve() computes them"
            raise InputError.single(message)
        return normal_equations(self._solved)

    def figure(self, name: str) -> float:
        """Return a figure by the name that gates use, such as "check_points.rms_xy"; NaN where there is none.

        Raises
        ------
        UnknownNameError
            If no figure is called so.
        """
        if name not in GATE_FIGURES:
            raise UnknownNameError(name, "figure", tuple(GATE_FIGURES))
        return figure(self._record, name)

    def to_dataframe(self, table: TableName) -> pd.DataFrame:
        """Return a table as a pandas data frame.

        Parameters
        ----------
        table : {"points", "photos", "cameras", "residuals", "control", "check", "groups", "blunders", "iterations"}
            Points and photos have a row for each, values and standard deviations (with an s before the name) as
            columns, and the units of these in `attrs["units"]`. Cameras have a row for each parameter; residuals a row
            for each component, as `ObservationResiduals`. Control and check points have the differences dX, dY, dZ,
            adjusted minus given, the standard deviations of adjusted (sX) and given coordinates (given_sX), w (wX), and
            `image`, the root mean square of the residuals of their rays (mm). The others are as their attributes.

        Raises
        ------
        OripError
            If pandas is not installed.
        UnknownNameError
            If there is no such table.
        """
        tables: dict[str, HasTable] = {
            "points": self.points,
            "photos": self.photos,
            "cameras": self.cameras,
            "residuals": self.residuals,
        }
        return data_frame(table, self._record, tables)

    def report(self, path: str | PathLike[str], kind: ReportKind = "full") -> Path:
        """Write a report as `orip report` does: one HTML page, or a PDF if the name ends in ``.pdf``.

        Parameters
        ----------
        path : str or path
            An earlier report of this name is replaced, no other file.
        kind : {"full", "client", "certificate"}
            The report for who checks the work, that for the client, or the certificate of the calibrated cameras.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        InputError
            If no camera was calibrated, for a certificate.
        UsageError
            If another file has this name, or there is no such kind.
        OripError
            If the file cannot be written, or no browser is there to print it.
        """
        from orip.workflow.adjust.report import write_report

        return write_report(self._report_input(), Path(path), kind)

    def to_json(self) -> str:
        """Return the solution as the text of result.json."""
        return result_text(self._record)

    def save(self) -> None:
        """Keep the solution in the stores of its project, and write listings, result.json and residuals.csv.

        A solution that was read from its project is already saved, and nothing is written.

        Raises
        ------
        InputError
            If the solution belongs to no project.
        LockedError
            If another run holds the project.
        OripError
            If a file cannot be written.
        """
        if self._write is None:
            message = "this solution belongs to no project folder; keep it with to_json() or to_dataframe()"
            raise InputError.single(message)
        self._write()

    def _camera(self, row: int) -> AdjustedCamera:
        found = self._record.cameras
        name = found.names[row]
        own = [parameter for parameter in self._record.additional if parameter.camera == name]
        return AdjustedCamera(
            name,
            (*CAMERA_PARAMETERS, *(parameter.name for parameter in own)),
            np.append(found.values[row], [parameter.value for parameter in own]),
            np.append(found.sd[row], [parameter.sd for parameter in own]),
            self.covariance,
        )

    def _report_input(self) -> ReportInput:
        given = self._given
        return ReportInput(self._record, (), BundleDefinition(self.bundle), {}, {}) if given is None else given()

    def _figures(self, names: Names) -> list[Figures]:
        records = names if isinstance(names, Iterable) and not isinstance(names, str) else [names]
        return [self._figures_of(record) for record in records]

    def _figures_of(self, record: object) -> Figures:
        assert self._solved is not None
        if not isinstance(record, str):
            raise UnknownNameError(record, "record", self.points.names)
        kind, _, name = record.rpartition(" ")
        groups = {
            "camera": (self.cameras.row, camera_figures),
            "photo": (self.photos.row, photo_figures),
            "point": (self.points.row, point_figures),
        }
        if (kind or "point").lower() not in groups:
            raise UnknownNameError(kind, "kind of record", tuple(groups))
        row, figures = groups[(kind or "point").lower()]
        return partial(figures, self._solved)(row(name))
