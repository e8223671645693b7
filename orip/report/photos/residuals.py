"""Residuals of photo points in summary: RMS in micrometres and pixels, histograms of w and of rays a point."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from orip.arrays import FloatArray
from orip.records.coded_names import coded
from orip.records.observations.observation_kinds import PHOTO_POINT
from orip.records.results.solution import Solution
from orip.report.drawings.histogram import Bars, histogram
from orip.report.numbers import counted, fixed, significant
from orip.report.photo_scale import pixel_of_photo
from orip.report.report_input import ReportInput
from orip.report.table import PageColumn, PageTable

_W_REACH, _W_STEP = 4.0, 0.25
_MOST_RAYS = 20
MOST_PHOTOS = 1000


def rms_of_photos(given: ReportInput) -> str:
    """Return the RMS of the residuals x and y of full weight, with pixels where all were measured in them."""
    residual, pixels = _residuals(given)
    return _in_both(residual, pixels) if residual.size else ""


def photo_residual_table(given: ReportInput) -> PageTable | None:
    """Return the RMS of the residuals of each photo, in micrometres and pixels; None where there are none."""
    solution = given.solution
    residuals = solution.residuals
    used = _used(solution)
    photo, component = coded(residuals.photo)[used], coded(residuals.component)[used]
    value, down = residuals.residual[used], residuals.weight_factor[used] < 1.0
    occurring = set(photo.occurring())
    names = [name for name in solution.photos.names if name in occurring]
    if not 0 < len(names) <= MOST_PHOTOS:
        return None
    place = {name: row for row, name in enumerate(names)}
    row = photo.places(place)
    axes = {axis: component.where(axis.__eq__) & (row >= 0) for axis in "xy"}
    rms = {}
    for axis in "xy":
        mine = axes[axis]
        count = np.bincount(row[mine], minlength=len(names))
        rms[axis] = np.sqrt(np.bincount(row[mine], value[mine] ** 2, len(names)) / np.maximum(count, 1))
    pixel = np.array([pixel_of_photo(given, name) for name in names])
    points = np.bincount(row[axes["x"]], minlength=len(names))
    lost = np.bincount(row[down & (row >= 0)], minlength=len(names))
    columns = [
        PageColumn("Photo", names, words=True),
        PageColumn("Points", [str(count) for count in points]),
        PageColumn("RMS x", [fixed(1e3 * size, 2) for size in rms["x"]], "µm"),
        PageColumn("RMS y", [fixed(1e3 * size, 2) for size in rms["y"]], "µm"),
    ]
    if np.isfinite(pixel).any():
        columns.append(PageColumn("RMS x", [fixed(size, 3) for size in rms["x"] / pixel], "px"))
        columns.append(PageColumn("RMS y", [fixed(size, 3) for size in rms["y"] / pixel], "px"))
    columns.append(PageColumn("Down-weighted", [str(count) for count in lost]))
    return PageTable("", "Residuals by photo", columns, "Down-weighted: components x or y.")


def residual_histograms(solution: Solution) -> tuple[Markup, ...]:
    """Return the histograms of normalised residuals of photo points and of the rays of points."""
    return tuple(drawing for drawing in (_of_w(solution), _of_rays(solution)) if drawing)


def _of_w(solution: Solution) -> Markup:
    used = _used(solution)
    # the listings have |w|; its sign is that of the residual
    w = np.copysign(solution.residuals.w[used], solution.residuals.residual[used])
    w = w[np.isfinite(w)]
    if not w.size:
        return Markup("")
    edges = np.linspace(-_W_REACH, _W_REACH, round(2.0 * _W_REACH / _W_STEP) + 1)
    inside = np.clip(w, -_W_REACH, _W_REACH - 1e-9)
    bar = ((inside + _W_REACH) / _W_STEP).astype(np.int64)
    count = np.bincount(bar, minlength=len(edges) - 1)
    middle = (edges[:-1] + edges[1:]) / 2.0
    expected = w.size * _W_STEP * np.exp(-(middle**2) / 2.0) / np.sqrt(2.0 * np.pi)
    beyond = int(np.count_nonzero(np.abs(w) > _W_REACH))
    across = (
        f"normalised residual w; {beyond} beyond ±{_W_REACH:g}, in the outermost bars"
        if beyond
        else "normalised residual w"
    )
    label = f"Histogram of {counted(w.size, 'normalised residual')} of photo points, and the normal distribution"
    return histogram(label, across, Bars(edges, count, expected))


def _of_rays(solution: Solution) -> Markup:
    rays = solution.point_rays[solution.point_rays > 0]
    if not rays.size:
        return Markup("")
    last = int(min(rays.max(), _MOST_RAYS))
    count = np.bincount(np.minimum(rays, _MOST_RAYS), minlength=last + 1)[1:]
    edges = np.arange(0.5, last + 1.0)
    across = f"rays a point; {_MOST_RAYS} stands for more" if rays.max() > _MOST_RAYS else "rays a point"
    return histogram(f"Histogram of the rays of {counted(rays.size, 'point')}", across, Bars(edges, count, None))


def _used(solution: Solution) -> np.ndarray:
    residuals = solution.residuals
    of_photos = coded(residuals.kind).where(PHOTO_POINT.name.__eq__)
    return np.asarray(of_photos & (residuals.weight_factor > 0.0))


def _residuals(given: ReportInput) -> tuple[FloatArray, FloatArray]:
    """Return the residuals (mm) of photo points of full weight, and the sizes of their pixels (mm), NaN without."""
    residuals = given.solution.residuals
    used = _used(given.solution) & (residuals.weight_factor >= 1.0)
    photo = coded(residuals.photo)
    pixels = np.array([pixel_of_photo(given, name) for name in photo.distinct], dtype=np.float64)
    return residuals.residual[used], pixels[photo.codes[used]]


def _in_both(residual: FloatArray, pixels: FloatArray) -> str:
    text = f"{significant(1e3 * _rms(residual), 3)} µm"
    return f"{text} ({significant(_rms(residual / pixels), 2)} px)" if np.isfinite(pixels).all() else text


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
