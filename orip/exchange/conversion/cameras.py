"""Cameras of other programs as orip's cameras, exact or fitted, and measurements that take what the fit leaves."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.conversion.image_axes import (
    UnsuitableCameraError,
    aspect_of_sensor,
    axes_from_pixels,
    in_given_pixels,
    in_square_pixels,
    named,
    pixel_aspect,
    pixels_from_axes,
    require_possible,
    stretched_image,
)
from orip.exchange.conversion.lens_exact import (
    Polynomial,
    middle_of_frame,
    parameters_from_polynomial,
    polynomial_from_parameters,
)
from orip.exchange.conversion.lens_fit import fitted_polynomial
from orip.exchange.conversion.lens_from_orip import lens_of_polynomial
from orip.exchange.conversion.lens_table import (
    LENSES,
    directions_of_image,
    focal_lengths,
    image_of_directions,
    lens_parameters,
)
from orip.geometry.projection import PROJECTIONS
from orip.interior.image_coordinates import ImageEquation
from orip.records.camera import READOUT, Camera, Projection, Sensor
from orip.records.exchanged import ExchangedCamera, ImageAxes, Lens
from orip.structs import replace

MOST_MISFIT_PX = 0.5
"""A fit that is worse somewhere in the frame is refused, unless measurements are corrected for it."""

FAITHFUL_PX = 0.01
"""Cameras that differ by less are as good as the same: fifty times less than measurements are good for."""

ASSUMED_WIDTH_MM = 36.0
"""Of the larger side of a frame whose size in millimetres no file says."""

_PROJECTION_NAMES = {"perspective": "a perspective lens", "equidistant": "a fisheye lens"}

_LARGEST_FACTOR = 10.0  # between the focal length of a lens and that of the camera fitted to it
_LARGEST_ASPECT = 2.0  # of pixels that are not square; more is a damaged file

_GRID = 41  # places along each side of the frame at which a camera is fitted


class ConvertedCamera(Struct, frozen=True):
    """A camera in orip's form.

    Parameters
    ----------
    camera : Camera
        Named as the other program has it, or as it will be called.
    worst_px, rms_px : float
        What the fit leaves over the frame; 0 where the conversion is exact.
    size_is_assumed : bool
        The size of the sensor is not known: millimetres of the camera are arbitrary.
    """

    camera: Camera
    source: ExchangedCamera
    worst_px: float = 0.0
    rms_px: float = 0.0
    size_is_assumed: bool = False

    @property
    def is_exact(self) -> bool:
        """Return whether orip's camera is the other program's."""
        return self.worst_px == 0.0

    @property
    def _size(self) -> tuple[float, float] | None:
        return None if self.camera.sensor is None else self.camera.sensor.size

    def pixels(self, image: FloatArray) -> FloatArray:
        """Return orip's columns and rows (n, 2) of image coordinates (n, 2) in the axes of the source's rays."""
        return pixels_from_axes(image, self.source.ray_axes, self.source.frame, self._size)

    def pixel_errors(self, deviations: FloatArray) -> FloatArray:
        """Return standard deviations (n,) in the unit of the source's rays as pixels."""
        sensor = self.camera.sensor
        if sensor is None or self.source.ray_axes.unit == "pixel":
            return deviations
        return deviations * (sensor.columns / sensor.width)

    def rays_of_pixels(self, pixels: FloatArray) -> FloatArray:
        """Return image coordinates (n, 2) in the axes of the source's rays of orip's columns and rows (n, 2)."""
        return axes_from_pixels(pixels, self.source.ray_axes, self.source.frame, self._size)

    def corrected_pixels(self, pixels: FloatArray) -> FloatArray:
        """Return pixels (n, 2) that orip's camera has where the source's camera has the given ones.

        With these the fitted camera stands for the other program's without any misfit. NaN where there are none.
        """
        if self.is_exact:
            return pixels
        in_lens = axes_from_pixels(pixels, self.source.lens_axes, self.source.frame, self._size)
        return pixels_of_directions(self.camera, _y_up(directions_of_image(self.source, in_lens), self.source))


class ExportedCamera(Struct, frozen=True):
    """A camera as another program has it.

    Parameters
    ----------
    worst_px, rms_px : float
        By how much they differ over the frame.
    """

    source: Camera
    camera: ExchangedCamera
    worst_px: float = 0.0
    rms_px: float = 0.0

    def rays_of_pixels(self, pixels: FloatArray, *, corrects_distortion: bool = False) -> FloatArray:
        """Return image coordinates (n, 2) in the axes of the other camera's rays of orip's columns and rows (n, 2).

        Corrected, they show in the other camera the directions that the pixels show in orip's; NaN where there are
        none.
        """
        sensor = self.source.sensor
        if sensor is None:
            return pixels
        size = (sensor.width, sensor.height)
        if corrects_distortion and self.worst_px > 0.0:
            pixels = lens_pixels(self.camera, size, directions_of_pixels(self.source, pixels))
        return axes_from_pixels(pixels, self.camera.ray_axes, self.camera.frame, size)

    @property
    def principal_point(self) -> FloatArray:
        """Return the principal point (2,) in the axes of the lens."""
        return np.array([self.camera.parameters.get(name, 0.0) for name in ("cx", "cy")])

    def about_principal_point(self) -> ExchangedCamera:
        """Return the camera as it is when image coordinates count from its principal point."""
        return replace(self.camera, parameters={**self.camera.parameters, "cx": 0.0, "cy": 0.0})


def convert_camera(source: ExchangedCamera, name: str, *, accepts_any_fit: bool = False) -> ConvertedCamera:
    """Return orip's camera for one of another program.

    Parameters
    ----------
    name : str
        Of the record.
    accepts_any_fit : bool
        Measurements will be corrected for what the fit leaves.

    Raises
    ------
    UnsuitableCameraError
        If the model is not supported, its values are impossible, or no camera of orip comes within `MOST_MISFIT_PX`.
    """
    require_possible(source)
    exact, aspect = _exact_form(source)
    sensor, size_is_assumed = _sensor(source, aspect)
    projection = LENSES[source.lens].projection
    if exact is not None:
        polynomial, residuals = exact, np.zeros((1, 2))
    else:
        polynomial, residuals, projection = _fitted(source, sensor, aspect)
    pixel_mm = sensor.width / sensor.columns / aspect
    length = np.hypot(*residuals.T) / (1.0 if source.lens_axes.unit == "pixel" else pixel_mm)
    worst = float(length.max())
    if worst > MOST_MISFIT_PX and not accepts_any_fit:
        message = (
            f"{named(source)}: orip's camera differs from it by up to "
            f"{worst:.2f} px; import it with --exact-distortion, which corrects the measurements by this difference"
        )
        raise UnsuitableCameraError(message)
    camera = Camera(
        name=name,
        parameters=parameters_from_polynomial(polynomial, source.lens_axes, source.frame, pixel_mm),
        distortion_at="measured" if polynomial.at_measured else "ideal",
        projection=projection,
        sensor=sensor,
    )
    return ConvertedCamera(camera, source, worst, float(np.sqrt(np.mean(length**2))), size_is_assumed)


def pixels_of_directions(camera: Camera, directions: FloatArray) -> FloatArray:
    """Return the pixels (n, 2) where a camera with a sensor images directions (n, 2), tangents x right and y up.

    NaN where it has none.
    """
    sensor, c, equation = _imaging(camera)
    with np.errstate(all="ignore"):  # directions far outside the frame may overflow
        x, y = equation.measured(*_ideal(camera.projection, c, directions))
    column = np.asarray(x) * (sensor.columns / sensor.width) + sensor.columns / 2.0
    row = sensor.rows / 2.0 - np.asarray(y) * (sensor.rows / sensor.height)
    return np.stack([column, row], axis=1)


def _imaging(camera: Camera) -> tuple[Sensor, float, ImageEquation]:
    """Return the sensor of a camera, its principal distance (mm), and how it distorts."""
    if camera.sensor is None:
        message = f"camera {camera.name} has no sensor"
        raise ValueError(message)
    c, x0, y0, *coefficients = camera.parameters[:READOUT]
    return camera.sensor, c, ImageEquation(x0, y0, tuple(coefficients), camera.distortion_at == "measured", None)


def export_camera(
    camera: Camera,
    name: str,
    lens: Lens,
    lens_axes: ImageAxes,
    ray_axes: ImageAxes,
    *,
    terms: tuple[str, ...] | None = None,
    accepts_any_fit: bool = False,
) -> ExportedCamera:
    """Return a camera of orip as another program's.

    Parameters
    ----------
    camera : Camera
        With a sensor.
    name : str
        As the other program has it.
    lens : Lens
        That the other program knows.
    terms : tuple of str, or None
        Parameters of the lens that the format has a place for; None: all.
    accepts_any_fit : bool
        Measurements will be corrected for what the fit leaves.

    Raises
    ------
    UnsuitableCameraError
        If the camera has no sensor, or another projection than the lens, or the lens does not come within
        `MOST_MISFIT_PX`.
    """
    sensor = camera.sensor
    if sensor is None:
        message = (
            f"camera {camera.name} has no sensor, and the format has digital frames only; export film as bingo or patb"
        )
        raise UnsuitableCameraError(message)
    if camera.projection != LENSES[lens].projection:
        message = (
            f"camera {camera.name} has {_PROJECTION_NAMES[camera.projection]}, but cameras of the format are written "
            f"as those of {_PROJECTION_NAMES[LENSES[lens].projection]}; export to another format"
        )
        raise UnsuitableCameraError(message)
    frame, size = (sensor.columns, sensor.rows), (sensor.width, sensor.height)
    places = np.meshgrid(np.linspace(0.0, sensor.columns, _GRID), np.linspace(0.0, sensor.rows, _GRID))
    pixels = np.stack(places, axis=-1).reshape(-1, 2)
    directions = directions_of_pixels(camera, pixels)
    seen = np.isfinite(directions).all(axis=1)
    up = 1.0 if lens_axes.y == "up" else -1.0
    aspect, pixel_mm = aspect_of_sensor(sensor, lens, lens_axes)
    polynomial = polynomial_from_parameters(
        camera.parameters, lens_axes, frame, pixel_mm, at_measured=camera.distortion_at == "measured"
    )
    middle, _ = middle_of_frame(lens_axes, frame)
    unit = 1.0 if lens_axes.unit == "pixel" else pixel_mm
    image = stretched_image(axes_from_pixels(pixels[seen], lens_axes, frame, size), aspect, middle)
    found = lens_of_polynomial(
        polynomial, lens, directions[seen] * np.array([1.0, up]), image, terms, enough=FAITHFUL_PX * unit
    )
    length = np.hypot(*found.residuals.T) / unit
    worst = float(length.max())
    if not worst <= MOST_MISFIT_PX and not accepts_any_fit:
        message = (
            f"camera {camera.name}: no camera of the format comes nearer to it than {worst:.2f} px, as the format has "
            "no place for some of its terms; export with --exact-distortion, which corrects the measurements by this "
            "difference, or export to another format"
        )
        raise UnsuitableCameraError(message)
    parameters = in_given_pixels(lens, found.parameters, aspect, middle)
    exchanged = ExchangedCamera(name, *frame, lens, parameters, "", lens_axes, ray_axes, size)
    return ExportedCamera(camera, exchanged, worst, float(np.sqrt(np.mean(length**2))))


def directions_of_pixels(camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return the directions (n, 2), tangents x right and y up, of pixels (n, 2) of a camera with a sensor.

    NaN where there are none.
    """
    sensor, c, equation = _imaging(camera)
    x = (pixels[:, 0] - sensor.columns / 2.0) * (sensor.width / sensor.columns)
    y = (sensor.rows / 2.0 - pixels[:, 1]) * (sensor.height / sensor.rows)
    with np.errstate(all="ignore"):  # pixels far outside the frame may overflow
        vectors = np.stack(PROJECTIONS[camera.projection].image_vector(c, *equation.ideal(x, y)), axis=1)
        # tangents end at 90 degrees from the axis, fisheye lenses do not
        return np.where(vectors[:, 2:] < 0.0, vectors[:, :2] / -vectors[:, 2:], np.nan)


def _ideal(projection: Projection, c: float, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the ideal coordinates x and y (n,) of directions (n, 2) with a principal distance."""
    x, y = np.ascontiguousarray(directions.T)
    ideal: tuple[FloatArray, FloatArray] = PROJECTIONS[projection].ideal_coordinates(c, x, y, -np.ones_like(x))
    return ideal


def _exact_form(source: ExchangedCamera) -> tuple[Polynomial | None, float]:
    """Return the polynomial that holds a camera exactly, if there is one, and the aspect of the pixels that it takes.

    Pixels are square unless orip holds the camera only without an affinity that follows its distortion.
    """
    lens, parameters = LENSES[source.lens], lens_parameters(source)
    exact = lens.polynomial(parameters)
    if exact is not None or source.lens_axes.unit == "mm":
        return exact, 1.0
    aspect = pixel_aspect(source.lens, parameters)
    if not 1.0 / _LARGEST_ASPECT < aspect < _LARGEST_ASPECT:
        return None, 1.0
    middle, _ = middle_of_frame(source.lens_axes, source.frame)
    return lens.polynomial(in_square_pixels(source.lens, parameters, middle)), aspect


def _sensor(source: ExchangedCamera, aspect: float) -> tuple[Sensor, bool]:
    """Return the sensor, with pixels of that aspect where the lens is in pixels, and whether its size is assumed."""
    columns, rows = source.frame
    if source.sensor_mm is not None and source.lens_axes.unit == "mm":
        return Sensor(columns, rows, *source.sensor_mm), False
    width = ASSUMED_WIDTH_MM * columns / max(columns, rows) if source.sensor_mm is None else source.sensor_mm[0]
    return Sensor(columns, rows, width * aspect, width * rows / columns), source.sensor_mm is None


def _fitted(source: ExchangedCamera, sensor: Sensor, aspect: float) -> tuple[Polynomial, FloatArray, Projection]:
    """Return the polynomial that comes nearest, its residuals over the frame, and its projection."""
    columns, rows = source.frame
    places = np.stack(np.meshgrid(np.linspace(0.0, columns, _GRID), np.linspace(0.0, rows, _GRID)), axis=-1)
    image = axes_from_pixels(places.reshape(-1, 2), source.lens_axes, source.frame, sensor.size)
    directions = directions_of_image(source, image)
    stretched = stretched_image(image, aspect, middle_of_frame(source.lens_axes, source.frame)[0])
    lens = LENSES[source.lens]
    tried: tuple[Projection, ...] = ("perspective", "equidistant") if lens.suits_any_projection else (lens.projection,)
    found = [
        (*fitted_polynomial(np.stack(_ideal(projection, 1.0, directions), axis=1), stretched), projection)
        for projection in tried
        if np.isfinite(directions).all()
    ]
    focal = np.mean(focal_lengths(source))
    possible = [fit for fit in found if focal / _LARGEST_FACTOR < fit[0].c < focal * _LARGEST_FACTOR]
    if not possible:
        message = f"{named(source)}: its formula has no inverse over the whole frame, so that it cannot be fitted"
        raise UnsuitableCameraError(message)
    return min(possible, key=lambda fit: float(np.hypot(*fit[1].T).max()))


def lens_pixels(source: ExchangedCamera, sensor_mm: tuple[float, float], directions: FloatArray) -> FloatArray:
    """Return the pixels (n, 2), as orip counts them, where a camera of another program images directions (n, 2).

    Directions are tangents x right and y up; NaN where there are none.
    """
    image = image_of_directions(source, _y_up(directions, source))
    return pixels_from_axes(image, source.lens_axes, source.frame, sensor_mm)


def _y_up(directions: FloatArray, source: ExchangedCamera) -> FloatArray:
    """Return directions of the lens' axes with y up, or the other way."""
    return directions if source.lens_axes.y == "up" else directions * np.array([1.0, -1.0])
