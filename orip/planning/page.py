"""The page of a plan: maps of footprints, overlap, precision and reliability, and the profile of the flight."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.rotation import rotation_from_angles
from orip.planning.forecast import Forecast
from orip.planning.geometry import Frame, Terrain, footprint
from orip.records.control import Station
from orip.report.drawings.block_plan import MOST_OVERLAP, overlap_cells
from orip.report.drawings.svg import ChartFrame, Curve, MapPlane, drawing, element, line_chart, map_plane, number
from orip.report.templates import template_source

_CELLS = 110

_STYLE = """
.plan-path{fill:none;stroke:#37527a;stroke-width:1.2}.plan-photo{fill:#37527a}
.plan-foot{fill:#37527a0a;stroke:#37527a55;stroke-width:.5}.plan-point{fill:#37527a66;stroke:#37527a;stroke-width:.5}.plan-control{fill:#b3261e}
.plan-border{fill:none;stroke:#b3261e;stroke-width:1.5;stroke-dasharray:6 3}
"""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'"


def plan_page(
    title: str,
    facts: Sequence[tuple[str, str]],
    stations: Sequence[Station],
    frame: Frame,
    terrain: Terrain,
    found: Forecast,
    border: FloatArray | None = None,
) -> str:
    """Return the page: one file that needs no network.

    Parameters
    ----------
    facts : sequence of (what, figure)
    frame : Frame
        Along and across are the photo's x and y.
    border : array (n, 2), optional
        Of the area.
    """
    unit = found.solution.ground_unit
    advice = [f"{one.text}; {one.remedy}" for one in found.diagnosis]
    places = np.array([station.position for station in stations])
    feet = _footprints(stations, frame, terrain)
    shown = np.isfinite(feet).all(axis=(1, 2))
    every = np.vstack([feet[shown].reshape(-1, 2), places[:, :2]])
    margin = 0.03 * float(np.ptp(every, axis=0).max())
    plane = map_plane(every.min(axis=0) - margin, every.max(axis=0) + margin)
    names = [f"X ({unit})", f"Y ({unit})"]
    parts = [
        ("Exposures and what they show", _map(plane, places, feet[shown], found, border, names)),
        ("Number of photos that show each part of the ground", _overlap(plane, feet[shown], names)),
        *((head, _at_points(plane, found, values, names)) for head, values in _of_points(found, unit)),
        ("Heights of exposures and of the ground below them", _profile(places, terrain, unit)),
    ]
    rows = "".join(f"<tr><th>{escape(what)}</th><td>{escape(figure)}</td></tr>" for what, figure in facts)
    lines = "".join(f"<li>{escape(line)}</li>" for line in advice)
    figures = "".join(f"<figure><figcaption>{escape(head)}</figcaption>{drawn}</figure>" for head, drawn in parts)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}"><title>{escape(title)}</title>'
        f"<style>{template_source('report.css')}{_STYLE}</style></head>\n<body><main><h1>{escape(title)}</h1>\n"
        f"<table>{rows}</table>\n<ul>{lines}</ul>\n{figures}</main></body></html>\n"
    )


def _footprints(stations: Sequence[Station], frame: Frame, terrain: Terrain) -> FloatArray:
    """Return the corners (n, 4, 2) of the photos on level ground at the height below each."""
    rotations = rotation_from_angles(np.array([station.angles for station in stations]))
    places = np.array([station.position for station in stations])
    ground = terrain(places[:, :2])
    size = np.array([frame.along, frame.across])
    return np.array(
        [
            footprint(frame, place, rotation, size, height)
            for place, rotation, height in zip(places, rotations, ground.tolist(), strict=True)
        ]
    )


def _map(
    plane: MapPlane,
    places: FloatArray,
    feet: FloatArray,
    found: Forecast,
    border: FloatArray | None,
    names: Sequence[str],
) -> str:
    drawn = [element("path", d=_closed(plane.place(corners)), class_="plan-foot") for corners in feet]
    if border is not None:
        drawn.append(element("path", d=_closed(plane.place(border)), class_="plan-border"))
    at = plane.place(places[:, :2])
    path = "M" + "L".join(f"{number(x)} {number(y)}" for x, y in at.tolist())
    drawn.append(element("path", d=path, class_="plan-path"))
    drawn += [element("circle", cx=x, cy=y, r=1.6, class_="plan-photo") for x, y in at.tolist()]
    control = [
        point.coordinates[:2]
        for point in found.solved.block.control_points
        if None not in point.coordinates and point.kind == "control"
    ]
    if control:
        marks = plane.place(np.array(control, dtype=np.float64)).tolist()
        drawn += [element("circle", cx=x, cy=y, r=4.0, class_="plan-control") for x, y in marks]
    return drawing(*plane.size, "Map of the plan", [plane.clipped(drawn), *plane.axes(names)], "map")


def _overlap(plane: MapPlane, feet: FloatArray, names: Sequence[str]) -> str:
    drawn = overlap_cells(plane, feet, _CELLS)
    swatches = "".join(
        f'<span><i class="swatch" style="--n:{photos}"></i>{photos}{" and more" * (photos == MOST_OVERLAP)}</span>'
        for photos in range(1, MOST_OVERLAP + 1)
    )
    shown = drawing(*plane.size, "Map of the overlap", [plane.clipped(drawn), *plane.axes(names)], "map")
    return f'{shown}<div class="key" aria-hidden="true">{swatches}</div>'


def _of_points(found: Forecast, unit: str) -> list[tuple[str, FloatArray]]:
    """Return what is drawn at the points, and its values (n,)."""
    sd = found.point_sd
    bias, external = found.reliability_of_points
    return [
        (
            f"Standard deviation of the points in plan, X and Y together ({unit})",
            np.hypot(sd[:, 0], sd[:, 1]),
        ),
        (f"Standard deviation of Z of the points ({unit})", sd[:, 2]),
        ("Smallest blunder that is found in a photo coordinate of the point, where it is largest (mm)", bias),
        ("What such a blunder, not found, changes a result by at most, in standard deviations of the result", external),
    ]


def _at_points(plane: MapPlane, found: Forecast, values: FloatArray, names: Sequence[str]) -> str:
    """Return a map of the points, each with a circle as large as its value (n,), with the extremes in words."""
    known = np.isfinite(values)
    if not known.any():
        return "<p>Not determined at any point.</p>"
    at, median = plane.place(found.solution.points.values[known, :2]), float(np.median(values[known]))
    sizes = 3.0 * values[known] / max(median, 1e-12)
    drawn = [
        element("circle", f"<title>{value:.4g}</title>", cx=x, cy=y, r=min(size, 12.0), class_="plan-point")
        for (x, y), size, value in zip(at.tolist(), sizes.tolist(), values[known].tolist(), strict=True)
    ]
    label = f"{values[known].min():.3g} to {values[known].max():.3g}, half of them above {median:.3g}"
    shown = drawing(*plane.size, f"Map: {label}", [plane.clipped(drawn), *plane.axes(names)], "map")
    unknown = np.count_nonzero(~known)
    left = f"; not determined at {unknown} points" if unknown else ""
    return f"<p>{label} (a circle of 3 pixels){left}</p>{shown}"


def _profile(places: FloatArray, terrain: Terrain, unit: str) -> str:
    steps = np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    ground = terrain(places[:, :2])
    curves = [
        Curve(list(zip(along.tolist(), heights.tolist(), strict=True)), name, style)
        for heights, name, style in ((places[:, 2], "exposures", "first"), (ground, "ground", "second"))
    ]
    frame = ChartFrame(f"flown ({unit})", f"Z ({unit})", width=720.0)
    return line_chart("Profile of the flight", frame, curves)


def _closed(corners: FloatArray) -> str:
    return "M" + "L".join(f"{number(x)} {number(y)}" for x, y in corners.tolist()) + "z"
