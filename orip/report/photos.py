"""The photos of the page: residuals, exposure stations, and the rigs that their cameras form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from orip.arrays import FloatArray
from orip.number_text import decimals_for
from orip.records.coded_names import coded
from orip.records.definition import MOTION_PARAMETERS
from orip.records.observation_kinds import PHOTO_POINT, unit_of_unknown
from orip.records.results.solution import RigEstimate, Solution
from orip.records.results.stations import StationResiduals, station_residuals
from orip.records.rig import MOUNTING_PARAMETERS, OFFSET
from orip.report.drawings.svg import Bars, ChartFrame, Curve, histogram, line_chart
from orip.report.report_input import ReportInput, pixel_of_photo
from orip.report.table import NO_LINKS, PageColumn, PageTable, counted, decimals_of_most, deviation, fixed, significant

# Each module makes the tables and charts of one subject; the scale of photos is in `orip.report.report_input`, as the
# drawings need it too.

_W_REACH, _W_STEP = 4.0, 0.25
_MOST_RAYS = 20
MOST_PHOTOS = 1000


def rms_of_photos(given: ReportInput) -> str:
    """Return the RMS of the residuals x and y of full weight, with pixels where all were measured in them."""
    residual, pixels = _residuals(given)
    return _in_both(residual, pixels) if residual.size else ""


def photo_residual_table(given: ReportInput, anchors: Mapping[str, str] = NO_LINKS) -> PageTable | None:
    """Return the RMS of the residuals of each photo, in micrometres and pixels; None where there are none."""
    solution = given.solution
    residuals = solution.residuals
    used, photo = _used(solution), coded(residuals.photo)
    # of each photo the components y and x: quicker over all rows than with some of them set apart
    both = 2 * photo.codes.astype(np.int64) + coded(residuals.component).where("x".__eq__)
    count, squares, down = (
        np.bincount(both, values, 2 * len(photo.distinct)).reshape(-1, 2)
        for values in (used, np.where(used, residuals.residual, 0.0) ** 2, used & (residuals.weight_factor < 1.0))
    )
    place = {name: row for row, name in enumerate(photo.distinct) if count[row].any()}
    names = [name for name in solution.photos.names if name in place]
    if not 0 < len(names) <= MOST_PHOTOS:
        return None
    rows = [place[name] for name in names]
    rms = dict(zip("yx", np.sqrt(squares[rows] / np.maximum(count[rows], 1)).T, strict=True))
    pixel = np.array([pixel_of_photo(given, name) for name in names])
    points, lost = count[rows, 1].astype(np.int64), down[rows].sum(axis=1).astype(np.int64)
    columns = [
        PageColumn("Photo", names, words=True, links=anchors),
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
    return residuals.residual[used], given.pixel_of_rows[used]


def _in_both(residual: FloatArray, pixels: FloatArray) -> str:
    text = f"{significant(1e3 * _rms(residual), 3)} µm"
    return f"{text} ({significant(_rms(residual / pixels), 2)} px)" if np.isfinite(pixels).all() else text


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


_NOTE_ON_RIGS = (
    "Cameras whose photos of the same instant (time of the station, else number at the end of the name) are always in "
    "the same relative position. Base: projection centre of the second camera in the system of the first; angles: "
    "rotation of the second camera against the first. ±: standard deviation of the mean, from the cofactor matrix of "
    "the adjustment; scatter: standard deviation of one instant as the instants differ, mean of the three axes. The "
    "adjustment orients all photos on their own."
)


def rig_table(solution: Solution) -> PageTable | None:
    """Return base and rotation of each two cameras that move together; None where there are none."""
    if not solution.rigs:
        return None
    rigs = list(dict.fromkeys((row.first, row.second, row.instants) for row in solution.rigs))
    figures: dict[str, list[RigEstimate]] = {}
    for row in solution.rigs:
        figures.setdefault(row.name, []).append(row)
    columns = [
        PageColumn("Cameras", [f"{first}, {second}" for first, second, _ in rigs], words=True),
        PageColumn("Instants", [str(instants) for *_, instants in rigs]),
    ]
    for group, unit in ((("BX", "BY", "BZ"), solution.ground_unit), (("OMEGA", "PHI", "KAPPA"), "°")):
        names = [name for name in group if name in figures]
        columns += [PageColumn(name, _cells(figures[name]), unit) for name in names]
        scatter = [[row.scatter for row in figures[name]] for name in names]
        if names:
            sizes = zip(*scatter, strict=True)
            columns.append(PageColumn("Scatter", [_root_mean_square(own) for own in sizes], unit))
    return PageTable("", "Relative orientation of cameras that move together", columns, _NOTE_ON_RIGS)


def mounting_table(solution: Solution) -> PageTable | None:
    """Return how cameras are mounted on rigs; None where there are no rigs."""
    if not solution.mountings:
        return None
    cameras = list(dict.fromkeys((row.rig, row.camera) for row in solution.mountings))
    columns = [
        PageColumn("Rig", [rig for rig, _ in cameras], words=True),
        PageColumn("Camera", [camera for _, camera in cameras], words=True),
    ]
    for name in MOUNTING_PARAMETERS:
        rows = [row for row in solution.mountings if row.name == name]
        decimals = decimals_of_most([row.sd for row in rows])
        cells = [f"{fixed(row.value, decimals)} ± {deviation(row.sd, decimals)}" for row in rows]
        columns.append(PageColumn(name, cells, solution.ground_unit if name in OFFSET else "°"))
    return PageTable("mountings", "Rigs: mountings of cameras", columns)


def _cells(rows: Sequence[RigEstimate]) -> list[str]:
    decimals = decimals_of_most([row.sd for row in rows])
    return [f"{fixed(row.value, decimals)} ± {fixed(row.sd, decimals)}" for row in rows]


def _root_mean_square(sizes: Sequence[float]) -> str:
    size = float(np.sqrt(np.mean(np.square(sizes))))
    return fixed(size, decimals_of_most([size]))


_NOTE_ON_MOTIONS = (
    "Of photos that a rolling shutter exposed row by row: velocities along the ground axes and rates about them, "
    "from the photos before and after in the strip; ± of those that are unknowns. Motion: root mean square of the "
    "motion of the image points of a photo from the first row to the last one."
)


def motion_table(solution: Solution) -> PageTable | None:
    """Return the motions of the photos of rolling shutters; None where there are none."""
    if not solution.motions:
        return None
    columns = [PageColumn("Photo", [row.photo for row in solution.motions], words=True)]
    for kind in MOTION_PARAMETERS:
        pairs = [(getattr(row, kind), getattr(row, f"{kind}_sd")) for row in solution.motions]
        cells = [fixed(value, 3) if np.isnan(sd) else f"{fixed(value, 3)} ± {fixed(sd, 3)}" for value, sd in pairs]
        columns.append(PageColumn(kind, cells, unit_of_unknown(kind, solution.ground_unit)))
    columns.append(PageColumn("Motion", [fixed(row.pixels, 1) for row in solution.motions], "px"))
    return PageTable("", "Motions of photos during the readout", columns, _NOTE_ON_MOTIONS)


_AXES = ("X", "Y", "Z")
_STYLES = ("first", "second")
_NOTE_ON_STATIONS = (
    "v: adjusted minus observed; w: normalised residual; marked are stations that lost weight or are only compared."
)


def station_table(solution: Solution) -> PageTable | None:
    """Return the positions of stations with their residuals; None where there are none."""
    found = station_residuals(solution, "position")
    if not len(found):
        return None
    decimals = decimals_for(np.abs(found.a_priori), 3, 6)
    columns = [
        PageColumn("Photo", [exposure.photo for exposure in found.exposures], words=True),
        PageColumn("Strip", [exposure.strip for exposure in found.exposures], words=True, key="strip"),
        PageColumn("Time", [fixed(time, 1) for time in _seconds(found).tolist()], "s from the first"),
        *(
            PageColumn(f"v{axis}", [fixed(value, decimals) for value in found.residual[:, k].tolist()],
                       solution.ground_unit, f"residual.{axis}")
            for k, axis in enumerate(_AXES)
        ),
        *(
            PageColumn(f"w{axis}", [fixed(value, 2) for value in found.w[:, k].tolist()], key=f"w.{axis}")
            for k, axis in enumerate(_AXES)
        ),
    ]  # fmt: skip
    least = found.weight_factor.min(axis=1)
    emphasised = frozenset(np.flatnonzero(~(least >= 1.0)).tolist())
    return PageTable("stations", "Exposure stations: residuals of positions", columns, _NOTE_ON_STATIONS, emphasised)


def strip_table(solution: Solution) -> PageTable | None:
    """Return the mean and the RMS of the residuals of positions by strip; None where there are no strips."""
    found = station_residuals(solution, "position")
    of_strip = np.array([exposure.strip for exposure in found.exposures])
    strips = [strip for strip in dict.fromkeys(of_strip.tolist()) if strip]
    if not strips:
        return None
    decimals, unit = decimals_for(np.abs(found.a_priori), 3, 6), solution.ground_unit
    residual = [found.residual[of_strip == strip] for strip in strips]
    columns = [
        PageColumn("Strip", strips, words=True),
        PageColumn("Stations", [str(len(mine)) for mine in residual]),
    ]
    for k, axis in enumerate(_AXES):
        means = [float(np.mean(mine[:, k])) for mine in residual]
        columns.append(PageColumn(f"mean v{axis}", [fixed(mean, decimals) for mean in means], unit))
    for k, axis in enumerate(_AXES):
        sizes = [float(np.sqrt(np.mean(mine[:, k] ** 2))) for mine in residual]
        columns.append(PageColumn(f"RMS v{axis}", [fixed(size, decimals) for size in sizes], unit))
    return PageTable("", "Exposure stations by strip", columns)


def station_charts(solution: Solution) -> tuple[Markup, ...]:
    """Return charts of the residuals in X, Y and Z over time, a line for each strip; none without times."""
    found = station_residuals(solution, "position")
    seconds = _seconds(found)
    if not np.isfinite(seconds).any():
        return ()
    strips = dict.fromkeys(exposure.strip for exposure in found.exposures)
    of_strip = np.array([exposure.strip for exposure in found.exposures])
    charts = []
    for axis, name in enumerate(_AXES):
        curves = []
        for number, strip in enumerate(strips):
            rows = np.flatnonzero(of_strip == strip)
            points = list(zip(seconds[rows].tolist(), found.residual[rows, axis].tolist(), strict=True))
            curves.append(Curve(points, strip or "no strip", _STYLES[number % len(_STYLES)]))
        frame = ChartFrame("s from the first exposure", f"v{name} ({solution.ground_unit})", 480.0, 200.0)
        charts.append(line_chart(f"Residuals of stations in {name} over time", frame, curves))
    return tuple(charts)


def _seconds(found: StationResiduals) -> np.ndarray:
    times = np.array([exposure.time for exposure in found.exposures], dtype=np.float64)
    return times - np.nanmin(times) if np.isfinite(times).any() else times
