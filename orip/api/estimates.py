"""Adjusted cameras, photos and points by their names, and as arrays."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

import numpy as np
from msgspec import Struct

from orip.api.tables import Table, estimates_table, html_table
from orip.arrays import FloatArray, IntArray
from orip.errors import UnknownNameError
from orip.records.camera import CAMERA_UNITS
from orip.records.control import PointKind
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.wording import counted

CovarianceOf = Callable[[str], FloatArray]
"""Gives the covariances (r, r) of a record with itself, by its name with its kind."""

Estimate = TypeVar("Estimate")

_AXES = ("X", "Y", "Z")
_SHOWN = 5
"""Names that stand for all in what a notebook prints."""


class AdjustedPoint(Struct, frozen=True):
    """One ground point.

    Parameters
    ----------
    name : str
    kind : {"control", "check", "rejected", "tie"}
    rays : int
        Photos in which it was measured with both coordinates in use.
    coordinates : array (3,)
        X, Y, Z in ground units.
    deviations : array (3,)
        Standard deviations, ground units: NaN for a constant, infinite for what nothing determines.
    covariance : array (3, 3)
        Ground units squared: 0 for a constant, NaN for what nothing determines.
    """

    name: str
    kind: PointKind
    rays: int
    coordinates: FloatArray
    deviations: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class AdjustedPhoto:
    """The exterior orientation of one photo.

    Parameters
    ----------
    name : str
    orientation : array (6,)
        X0, Y0, Z0 in ground units and OMEGA, PHI, KAPPA in degrees.
    deviations : array (6,)
        Standard deviations in the same units: NaN for a constant, infinite for what nothing determines.
    rotations_about_axes : bool
        PHI is ±90 degrees, and deviations and covariances of the angles are those of small rotations about X, Y and Z.
    """

    name: str
    orientation: FloatArray
    deviations: FloatArray
    rotations_about_axes: bool
    _covariance_of: CovarianceOf = field(repr=False, compare=False)

    @property
    def covariance(self) -> FloatArray:
        """Return the covariances (6, 6) of the orientation, see `Solution.covariance`."""
        return self._covariance_of(f"photo {self.name}")


class CameraDeviations(Struct, frozen=True):
    """Standard deviations of a camera's parameters, as ``camera.sd.c`` or ``camera.sd["C"]``.

    NaN for a constant, infinite for what nothing determines; mm, powers of 1/mm otherwise.

    Parameters
    ----------
    parameter_names : tuple of str
    deviations : array (k,)
    """

    parameter_names: tuple[str, ...]
    deviations: FloatArray

    def __getitem__(self, parameter: str) -> float:
        """Return the standard deviation of a parameter.

        Raises
        ------
        UnknownNameError
            If the camera has no such parameter.
        """
        return float(self.deviations[row_of(parameter, self.parameter_names, "parameter", str.upper)])

    def __getattr__(self, name: str) -> float:
        """Return the standard deviation of a parameter by its name in small letters."""
        return _attribute(self, name, self.parameter_names)

    def __dir__(self) -> list[str]:
        """Return the attributes, those of the parameters included."""
        return [*object.__dir__(self), *_attributes(self.parameter_names)]

    def __repr__(self) -> str:
        pairs = zip(self.parameter_names, self.deviations.tolist(), strict=True)
        return f"<sd: {', '.join(f'{name} {value:.2g}' for name, value in pairs if np.isfinite(value))}>"


def _attributes(names: Sequence[str]) -> list[str]:
    """Return the names of parameters as attributes: in small letters, a point as an underscore."""
    return [name.lower().replace(".", "_") for name in names]


def _attribute(values: AdjustedCamera | CameraDeviations, attribute: str, names: Sequence[str]) -> float:
    if attribute.startswith("_") or attribute not in _attributes(names):
        message = f"{type(values).__name__!r} has no attribute {attribute!r}"
        raise AttributeError(message)
    return values[names[_attributes(names).index(attribute)]]


@dataclass(frozen=True, slots=True)
class AdjustedCamera:
    """The interior orientation of one camera.

    Parameters
    ----------
    name : str
    parameter_names : tuple of str
        C, DX, DY, A1, A3, A5, A7, A9, P1, P2, B1, B2, and those of the camera's set of additional parameters.
    parameters : array (k,)
        C, DX, DY in mm, powers of 1/mm otherwise.
    deviations : array (k,)
        Standard deviations in the same units: NaN for a constant, infinite for what nothing determines.
    """

    name: str
    parameter_names: tuple[str, ...]
    parameters: FloatArray
    deviations: FloatArray
    _covariance_of: CovarianceOf = field(repr=False, compare=False)

    @property
    def covariance(self) -> FloatArray:
        """Return the covariances (k, k) of the parameters, see `Solution.covariance`."""
        return self._covariance_of(f"camera {self.name}")

    @property
    def sd(self) -> CameraDeviations:
        """Return the standard deviations by the parameters' names: ``camera.sd.c``, ``camera.sd["A3"]``."""
        return CameraDeviations(self.parameter_names, self.deviations)

    def __getitem__(self, parameter: str) -> float:
        """Return the value of a parameter, such as ``camera["C"]``.

        Raises
        ------
        UnknownNameError
            If the camera has no such parameter.
        """
        return float(self.parameters[row_of(parameter, self.parameter_names, "parameter", str.upper)])

    def __getattr__(self, name: str) -> float:
        """Return the value of a parameter by its name in small letters, such as ``camera.c`` or ``camera.a3``."""
        return _attribute(self, name, self.parameter_names)

    def __dir__(self) -> list[str]:
        """Return the attributes, those of the parameters included."""
        return [*object.__dir__(self), *_attributes(self.parameter_names)]

    def _repr_html_(self) -> str:
        columns: dict[str, Any] = {"parameter": self.parameter_names, "value": self.parameters, "sd": self.deviations}
        return html_table(columns, f"Camera {self.name}")


class _ByName(Mapping[str, Estimate], Generic[Estimate]):
    """Estimates by the names of their records, in the order of the block."""

    _kind: str

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._rows = {self._key(name): row for row, name in enumerate(self.names)}

    def __repr__(self) -> str:
        shown = [*self.names[:_SHOWN], *(["..."] if len(self.names) > _SHOWN else [])]
        return f"<{counted(len(self.names), self._kind)}: {', '.join(shown)}>"

    def __getitem__(self, name: str) -> Estimate:
        """Return one of them.

        Raises
        ------
        UnknownNameError
            If there is none of that name; the most similar one is named. It is a KeyError too.
        """
        return self._at(self.row(name))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def row(self, name: str) -> int:
        """Return in which row of the arrays a record is."""
        return row_of(name, self.names, self._kind, self._key, self._rows)

    @staticmethod
    def _key(name: str) -> str:
        """Return a name as it is compared: case does not count."""
        return record_key(name)

    @abstractmethod
    def _at(self, row: int) -> Estimate:
        """Return the estimate in a row."""

    @abstractmethod
    def table(self) -> Table:
        """Return all of them as a table, from which data frames and what a notebook shows are made."""

    def _repr_html_(self) -> str:
        return html_table(self.table().columns, counted(len(self.names), self._kind))


class AdjustedPoints(_ByName[AdjustedPoint]):
    """The n ground points of a solution: ``points["CP3"]`` is one of them, the attributes are arrays of all.

    Attributes
    ----------
    names : tuple of str, length n
    kinds : tuple of str, length n
        "control", "check", "rejected" or "tie".
    rays : array (n,) of int
    coordinates : array (n, 3)
    deviations : array (n, 3)
    covariances : array (n, 3, 3)
        As those of an `AdjustedPoint`.
    """

    _kind = "point"

    def __init__(
        self,
        names: Sequence[str],
        kinds: Sequence[PointKind],
        rays: Sequence[int],
        coordinates: FloatArray,
        deviations: FloatArray,
        correlations: FloatArray,
        ground_unit: str,
    ) -> None:
        super().__init__(names)
        self.kinds = tuple(kinds)
        self.rays: IntArray = np.array(rays, dtype=np.int64)
        self.coordinates = coordinates
        self.deviations = deviations
        self.covariances = _covariances(deviations, correlations)
        self._units = (ground_unit,) * 3

    @staticmethod
    def _key(name: str) -> str:
        """Return a name as it is compared: as it is."""
        return name

    def table(self) -> Table:
        """Return the points as a table: a row each, with names, coordinates, deviations, kind and rays."""
        table = estimates_table(self.names, _AXES, self.coordinates, self.deviations, self._units)
        return Table({**table.columns, "kind": list(self.kinds), "rays": self.rays.tolist()}, table.units)

    def _at(self, row: int) -> AdjustedPoint:
        return AdjustedPoint(
            self.names[row],
            self.kinds[row],
            int(self.rays[row]),
            self.coordinates[row],
            self.deviations[row],
            self.covariances[row],
        )


class AdjustedPhotos(_ByName[AdjustedPhoto]):
    """The n photos of a solution: ``photos["102"]`` is one of them, the attributes are arrays of all.

    Attributes
    ----------
    names : tuple of str, length n
        Case does not count in ``photos[name]``.
    orientations : array (n, 6)
    deviations : array (n, 6)
    rotations_about_axes : array (n,) of bool
        As those of an `AdjustedPhoto`.
    """

    _kind = "photo"

    def __init__(
        self,
        names: Sequence[str],
        orientations: FloatArray,
        deviations: FloatArray,
        rotations_about_axes: Sequence[bool],
        covariance_of: CovarianceOf,
        ground_unit: str,
    ) -> None:
        super().__init__(names)
        self.orientations = orientations
        self.deviations = deviations
        self.rotations_about_axes = np.array(rotations_about_axes, dtype=np.bool_)
        self._covariance_of = covariance_of
        self._units = (*(ground_unit,) * 3, *("degrees",) * 3)

    def table(self) -> Table:
        """Return the photos as a table: a row each, with names, orientations and deviations."""
        table = estimates_table(self.names, PHOTO_PARAMETERS, self.orientations, self.deviations, self._units)
        about_axes = self.rotations_about_axes.tolist()
        return Table({**table.columns, "rotations_about_axes": about_axes}, table.units)

    def _at(self, row: int) -> AdjustedPhoto:
        about_axes = bool(self.rotations_about_axes[row])
        return AdjustedPhoto(
            self.names[row], self.orientations[row], self.deviations[row], about_axes, self._covariance_of
        )


class AdjustedCameras(_ByName[AdjustedCamera]):
    """The cameras of a solution by name; case does not count in ``cameras[name]``.

    Attributes
    ----------
    names : tuple of str
    """

    _kind = "camera"

    def __init__(self, cameras: Sequence[AdjustedCamera]) -> None:
        super().__init__([camera.name for camera in cameras])
        self._cameras = tuple(cameras)

    def table(self) -> Table:
        """Return the cameras as a table: a row for each parameter."""
        rows = [
            (camera.name, parameter, value, deviation, CAMERA_UNITS.get(parameter, ""))
            for camera in self._cameras
            for parameter, value, deviation in zip(
                camera.parameter_names, camera.parameters.tolist(), camera.deviations.tolist(), strict=True
            )
        ]
        headings = ("camera", "parameter", "value", "deviation", "unit")
        return Table({heading: [row[place] for row in rows] for place, heading in enumerate(headings)})

    def _at(self, row: int) -> AdjustedCamera:
        return self._cameras[row]


def row_of(
    name: str,
    names: Sequence[str],
    kind: str,
    key: Callable[[str], str],
    rows: Mapping[str, int] | None = None,
) -> int:
    """Return the place of a name among others.

    Raises
    ------
    UnknownNameError
        If it is not among them.
    """
    known = {key(known_name): row for row, known_name in enumerate(names)} if rows is None else rows
    row = known.get(key(name)) if isinstance(name, str) else None
    if row is None:
        raise UnknownNameError(name, kind, names)
    return row


def _covariances(deviations: FloatArray, correlations: FloatArray) -> FloatArray:
    """Return covariances (n, 3, 3) from deviations (n, 3) and correlations XY, XZ, YZ (n, 3)."""
    full = np.broadcast_to(np.eye(3), (len(deviations), 3, 3)).copy()
    a, b = [0, 0, 1], [1, 2, 2]
    full[:, a, b] = full[:, b, a] = correlations if len(correlations) else np.nan
    constant, undetermined = np.isnan(deviations), np.isinf(deviations)
    sd = np.where(constant | undetermined, 0.0, deviations)
    found = sd[:, :, None] * full * sd[:, None, :]
    found[constant[:, :, None] | constant[:, None, :]] = 0.0
    found[undetermined[:, :, None] | undetermined[:, None, :]] = np.nan
    return np.asarray(found)
