"""What a block is made from, as plain arrays; nothing is checked before the block is made, and then everything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from msgspec import Struct
from numpy.typing import ArrayLike

from orip.records.camera import AdditionalSet, DistortionArgument, Projection, ReadoutDirection


class Camera(Struct, frozen=True):
    """A camera, with the keys of ``[[camera]]`` in orip.toml.

    Parameters
    ----------
    name : str
        Case does not count.
    c : float, optional
        Principal distance, mm; not given with `same_lens_as`.
    principal_point : (2,)
        DX, DY, mm.
    distortion : mapping, optional
        A1, A3, A5, A7, A9, P1, P2, B1, B2 as far as they are not 0; powers of 1/mm.
    distortion_isp : mapping, optional
        R0, A1, A2, A3 of the ISP regulations in place of A1, A3, A5, A7, A9; P1, P2, B1, B2 may go with it.
    distortion_curve : array (n, 2), optional
        Radius and radial distortion in place of A1, A3, A5, A7, A9, mm.
    distortion_at : {"ideal", "measured"}
        Whether distortion is a function of the ideal or of the measured photo coordinate.
    frame : (2,), optional
        Size of the photo along x and y, mm.
    sensor : mapping, optional
        columns, rows (pixels), width, height (mm): photo points of this camera are pixels.
    unknown : sequence of str
        Parameters to be estimated, such as ``["C", "DX", "DY", "A3"]``; the others are held.
    additional_set : {"EBNER", "GRUEN"}, optional
        Additional parameters as weighted unknowns; needs `frame`.
    same_lens_as : str, optional
        Camera whose principal distance and distortion this one has; principal point and readout are its own.
    projection : {"perspective", "equidistant"}
        Equidistant is that of fisheye lenses.
    readout : float
        Seconds from the first row or column to the last one; needs `sensor`, and stations with times.
    readout_direction : {"down", "up", "right", "left"}
        In which rows, or columns of the sensor, are exposed one after the other.
    """

    name: str
    c: float | None = None
    principal_point: ArrayLike = (0.0, 0.0)
    distortion: Mapping[str, float] | None = None
    distortion_isp: Mapping[str, float] | None = None
    distortion_curve: ArrayLike | None = None
    distortion_at: DistortionArgument = "ideal"
    frame: ArrayLike | None = None
    sensor: Mapping[str, float] | None = None
    unknown: Sequence[str] = ()
    additional_set: AdditionalSet | None = None
    same_lens_as: str | None = None
    projection: Projection = "perspective"
    readout: float = 0.0
    readout_direction: ReadoutDirection = "down"


class Photos(Struct, frozen=True):
    """n photos.

    Parameters
    ----------
    name : (n,) of str
        Case does not count.
    camera : str or (n,) of str
        Name of the camera of all, or of each.
    orientation : array (n, 6), optional
        Starting values X0, Y0, Z0 (ground units), OMEGA, PHI, KAPPA (degrees). Where an element is NaN, or the array
        not given, preliminary values are found from the measurements.
    constant : array (n, 6) of bool, optional
        Elements that the adjustment holds.
    """

    name: ArrayLike
    camera: ArrayLike
    orientation: ArrayLike | None = None
    constant: ArrayLike | None = None


class PhotoPoints(Struct, frozen=True):
    """n points measured in photos.

    Parameters
    ----------
    photo : (n,) of str
        Case does not count.
    point : (n,) of str
        Case counts.
    xy : array (n, 2)
        Photo coordinates in the fiducial system, mm; pixels (column, row) for a camera with a sensor.
    error : float or array (2,), (n, 1) or (n, 2), optional
        A-priori errors along the photo axes, mm: NaN for the block's `measurement_precision`, negative to disregard a
        coordinate.
    """

    photo: ArrayLike
    point: ArrayLike
    xy: ArrayLike
    error: ArrayLike | None = None


class ControlPoints(Struct, frozen=True):
    """n control and check points.

    Parameters
    ----------
    name : (n,) of str
    coordinates : array (n, 3)
        X, Y, Z in ground units; NaN where one is not known.
    error : float or array (3,), (n, 1) or (n, 3)
        A-priori errors, ground units: 0 holds a coordinate, negative ones make it a check coordinate without influence.
    covariance : array (n, 3, 3) or (3 n, 3 n), optional
        In place of errors, ground units squared: of the coordinates of each point, or of all together, X Y Z point by
        point. All coordinates have to be known then.
    """

    name: ArrayLike
    coordinates: ArrayLike
    error: ArrayLike | None = None
    covariance: ArrayLike | None = None


class Elements(Struct, frozen=True):
    """n observed values of unknowns, such as projection centres positioned from the air.

    Parameters
    ----------
    name : (n,) of str
        Of the camera, photo, point or set of directions.
    group : str or (n,) of str
        "CAMERA", "PHOTO", "POINT" or "THEODOLITE".
    kind : str or (n,) of str
        Of a camera C, DX, DY, A1 ... B2; of a photo X0, Y0, Z0, OMEGA, PHI, KAPPA; of a point X, Y, Z; of a set R.
    value : array (n,)
        Angles in degrees.
    error : float or array (n,)
        A-priori error: 0 holds the unknown, negative: without influence.
    """

    name: ArrayLike
    group: ArrayLike
    kind: ArrayLike
    value: ArrayLike
    error: ArrayLike


class Distances(Struct, frozen=True):
    """n distances between points.

    Parameters
    ----------
    name : (n,) of str
    start : (n,) of str
    end : (n,) of str
    distance : array (n,)
        Ground units.
    error : float or array (n,)
        A-priori error: 0 holds the distance, negative: without influence.
    code : str or (n,) of str
        "XYZ" for a spatial distance, "XY", "YZ" or "ZX" for one in a plane, "X", "Y" or "Z" for a difference, end minus
        start.
    """

    name: ArrayLike
    start: ArrayLike
    end: ArrayLike
    distance: ArrayLike
    error: ArrayLike
    code: ArrayLike = "XYZ"


class Directions(Struct, frozen=True):
    """n directions of a theodolite, with zenith angles if they were observed.

    Parameters
    ----------
    set : (n,) of str
        All directions of a set are from one station.
    station : (n,) of str
    target : (n,) of str
    direction : array (n,)
        Degrees, clockwise.
    error : float or array (n,)
        A-priori error, degrees; negative: without influence.
    zenith : array (n,), optional
        Zenith angle, degrees; NaN where none was observed.
    zenith_error : float or array (n,), optional
        A-priori error, degrees; NaN where no zenith angle was observed.
    """

    set: ArrayLike
    station: ArrayLike
    target: ArrayLike
    direction: ArrayLike
    error: ArrayLike
    zenith: ArrayLike | None = None
    zenith_error: ArrayLike | None = None


class Figures(Struct, frozen=True):
    """n points that lie on lines, planes and cylinders, or at equal heights.

    Parameters
    ----------
    figure : (n,) of str
        Points of the same figure have the same name here.
    kind : str or (n,) of str
        "LINE", "PLANE", "CYLINDER" or "HEIGHT".
    point : (n,) of str
    error : float or array (n,)
        A-priori error of the distance from the figure, ground units; negative: without influence.
    """

    figure: ArrayLike
    kind: ArrayLike
    point: ArrayLike
    error: ArrayLike


class GivenDirections(Struct, frozen=True):
    """n directions from one point to another: edges of buildings, plumb lines.

    Parameters
    ----------
    name : (n,) of str
    start, end : (n,) of str
        Names of points.
    direction : array (n, 3)
        Along the project's axes, of any length above 0.
    error : float or array (n,)
        A-priori error, degrees; negative: without influence.
    """

    name: ArrayLike
    start: ArrayLike
    end: ArrayLike
    direction: ArrayLike
    error: ArrayLike


class Stations(Struct, frozen=True):
    """Exposure stations of n photos, observed by GNSS and INS.

    Parameters
    ----------
    name : (n,) of str
        Of the photo.
    coordinates : array (n, 3)
        X, Y, Z of the antenna in ground units; NaN where no position was observed.
    error : float or array (n, 3)
        A-priori errors: 0 constant, negative: only compared.
    angles : array (n, 3), optional
        OMEGA, PHI, KAPPA in degrees; NaN where no attitude was observed.
    angle_error : float or array (n, 3), optional
        A-priori errors, degrees.
    time : array (n,), optional
        Of the exposures, seconds; NaN where it is not known.
    strip : str or (n,) of str, optional
        Strips may have a shift and drift of their own.
    velocity : array (n, 3), optional
        During the exposure, for rolling shutters: of what the position is of, along X, Y, Z, ground units a second;
        NaN where it is not known.
    velocity_error : float or array (n, 3), optional
        A-priori errors, ground units a second: 0 constant.
    rate : array (n, 3), optional
        Angular rate about X, Y, Z, degrees a second; NaN where it is not known.
    rate_error : float or array (n, 3), optional
        A-priori errors, degrees a second: 0 constant.
    """

    name: ArrayLike
    coordinates: ArrayLike
    error: ArrayLike
    angles: ArrayLike | None = None
    angle_error: ArrayLike | None = None
    time: ArrayLike | None = None
    strip: ArrayLike | None = None
    velocity: ArrayLike | None = None
    velocity_error: ArrayLike | None = None
    rate: ArrayLike | None = None
    rate_error: ArrayLike | None = None


class PreliminaryPoints(Struct, frozen=True):
    """Starting values of n points; others start where their rays meet.

    Parameters
    ----------
    name : (n,) of str
    coordinates : array (n, 3)
        X, Y, Z in ground units.
    """

    name: ArrayLike
    coordinates: ArrayLike


Datum = Literal["control", "free"]
