"""The figures of the report as figures of plotly, for notebooks and scripts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from orip.api.estimates import row_of
from orip.arrays import FloatArray
from orip.bundle.results.compared_points import AXES, COMPARED_KINDS, compared_points
from orip.interior.distortion import curve_from_polynomial
from orip.records.camera import RADIAL_PLACES
from orip.records.names import record_key
from orip.records.observation_kinds import PHOTO_POINT
from orip.report.calibration import frame_reach
from orip.report.drawings.block_view import pyramid_corners
from orip.report.drawings.residual_vectors import frame_extent, large_residual, measured_reach
from orip.report.drawings.svg import round_step
from orip.report.report_input import PhotoVectors, ReportInput
from orip.report.table import length_unit

Figure = Any
"""A `plotly.graph_objects.Figure`: a notebook shows it, ``write_html`` and ``write_image`` write it."""

_COLOURS = {"tie": "#5d6b77", "control": "#b04a3a", "check": "#3c7a52", "rejected": "#8a8f94", "photo": "#2c5d86"}
_LOST = "#b04a3a"
_LENGTH = 0.1
"""Part of the frame or block at which a large residual or error is drawn."""


class Plots:
    """Figures of a solution, ``solution.plot``: those of the report as figures of plotly.

    Each method returns a new `plotly.graph_objects.Figure`.
    """

    def __init__(self, given: Callable[[], ReportInput]) -> None:
        self._input = given

    def __repr__(self) -> str:
        return "<figures: residuals(), plan(), block(), distortion(), normalised_residuals(), convergence()>"

    def residuals(self, photo: str | None = None) -> Figure:
        """Draw the residual vectors of photo points, enlarged; lost weight is in another colour.

        Parameters
        ----------
        photo : str, optional
            One photo; if not given, all photos of each camera together, a camera beside the other.

        Raises
        ------
        UnknownNameError
            If the photo has no photo points.
        """
        given = self._input()
        found = given.photo_vectors
        if photo is not None:
            names = list(found)
            name = names[row_of(photo, names, "photo", record_key)]
            camera = given.photos[record_key(name)].camera if record_key(name) in given.photos else ""
            return _vectors([found[name]], given, camera, f"Residuals of photo {name}")
        of_camera: dict[str, list[PhotoVectors]] = {}
        for name, vectors in found.items():
            record = given.photos.get(record_key(name))
            of_camera.setdefault(record.camera if record is not None else "", []).append(vectors)
        if len(of_camera) <= 1:
            ((camera, mine),) = of_camera.items() or [("", [])]
            return _vectors(mine, given, camera, "Residuals of all photos")
        return _side_by_side(
            [_vectors(mine, given, camera, f"Camera {camera}") for camera, mine in of_camera.items()],
            [f"camera {camera}" for camera in of_camera],
        )

    def plan(self) -> Figure:
        """Draw the block from above: photos, points, and the errors of control and check points, enlarged.

        An error is adjusted minus given; its height is told where the pointer rests.
        """
        given = self._input()
        solution, go = given.solution, _plotly()
        figure = go.Figure(layout=_layout("Plan of the block", f"X ({solution.ground_unit})", solution.ground_unit))
        figure.update_layout(yaxis_title=f"Y ({solution.ground_unit})")
        tie = np.array([kind == "tie" for kind in solution.point_kinds], dtype=bool)
        for name, places, colour, symbol, labels in (
            ("tie points", solution.points.values[tie], "tie", "circle", np.array(solution.points.names)[tie]),
            ("photos", solution.photos.values[:, :3], "photo", "square", np.array(solution.photos.names)),
        ):
            figure.add_scattergl(
                x=places[:, 0], y=places[:, 1], mode="markers", name=name, text=labels, hoverinfo="text",
                marker={"color": _COLOURS[colour], "symbol": symbol, "size": 3 if colour == "tie" else 6},
            )  # fmt: skip
        extent = float(np.nanmax(np.ptp(solution.photos.values[:, :2], axis=0), initial=1.0))
        compared = {kind: compared_points(solution, kind) for kind in COMPARED_KINDS}
        sizes = [np.hypot(*np.nan_to_num(points.difference[:, :2]).T) for points in compared.values()]
        scale = _enlargement(_LENGTH * extent, float(np.max(np.concatenate(sizes), initial=0.0)))
        for kind, points in compared.items():
            if not len(points):
                continue
            rows = [solution.points.names.index(name) for name in points.names]
            start, shift = solution.points.values[rows][:, :2], scale * np.nan_to_num(points.difference[:, :2])
            unit = length_unit(points.difference, solution.ground_unit)
            told = [
                f"{name}<br>" + "<br>".join(f"d{axis} {unit.of(value)}" for axis, value in zip(AXES, row, strict=True))
                for name, row in zip(points.names, points.difference.tolist(), strict=True)
            ]
            figure.add_scatter(**_lines(start, shift), line_color=_COLOURS[kind], showlegend=False, hoverinfo="skip")
            figure.add_scatter(
                x=start[:, 0], y=start[:, 1], mode="markers+text", name=f"{kind} points", text=points.names,
                textposition="top center", hovertext=told, hoverinfo="text",
                marker={"color": _COLOURS[kind], "symbol": "triangle-up", "size": 9},
            )  # fmt: skip
        figure.update_yaxes(scaleanchor="x")
        figure.add_annotation(_corner(f"errors enlarged {scale:g} times"))
        return figure

    def block(self) -> Figure:
        """Draw the block in three dimensions: photos as pyramids, points by their kind."""
        given = self._input()
        solution, go = given.solution, _plotly()
        corners, centres = pyramid_corners(given), solution.photos.values[:, :3]
        figure = go.Figure(
            layout={
                "title": "The block",
                "scene": {"aspectmode": "data"},
                "template": "simple_white",
                "margin": {"l": 0, "r": 0, "b": 0},
            }
        )
        gap = np.full((len(centres), 1, 3), np.nan)
        closed = np.concatenate([corners, corners[:, :1]], axis=1)
        rays = [np.stack([centres, corners[:, corner]], axis=1) for corner in range(corners.shape[1])]
        paths = [np.concatenate([path, gap], axis=1).reshape(-1, 3) for path in (closed, *rays)]
        x, y, z = np.concatenate(paths).T
        figure.add_scatter3d(x=x, y=y, z=z, mode="lines", name="photos", line_color=_COLOURS["photo"], hoverinfo="skip")
        x, y, z = centres.T
        figure.add_scatter3d(
            x=x, y=y, z=z, mode="markers", text=solution.photos.names, hoverinfo="text+x+y+z", showlegend=False,
            marker={"size": 2, "color": _COLOURS["photo"]},
        )  # fmt: skip
        kinds = np.array(list(solution.point_kinds), dtype=object)
        for kind in dict.fromkeys(kinds.tolist()):
            mine = np.flatnonzero(kinds == kind)
            x, y, z = solution.points.values[mine].T
            figure.add_scatter3d(
                x=x, y=y, z=z, mode="markers", name=f"{kind} points", hoverinfo="text+x+y+z",
                text=[solution.points.names[row] for row in mine.tolist()],
                marker={"size": 2 if kind == "tie" else 5, "color": _COLOURS[kind]},
            )  # fmt: skip
        return figure

    def distortion(self, camera: str | None = None) -> Figure:
        """Draw the radial distortion over the radius, before the adjustment (dashed) and after it.

        Parameters
        ----------
        camera : str, optional
            If not given, all cameras.

        Raises
        ------
        UnknownNameError
            If there is no such camera.
        """
        given = self._input()
        names = given.solution.cameras.names
        rows = range(len(names)) if camera is None else [row_of(camera, names, "camera", record_key)]
        figure = _plotly().Figure(layout=_layout("Radial distortion", "radius (mm)", "distortion (µm)"))
        for row in rows:
            before = given.cameras.get(record_key(names[row]))
            reach = frame_reach(given, names[row]) or measured_reach(given, names[row])
            radius = np.linspace(0.0, reach, 81)
            curves = [("adjusted", given.solution.cameras.values[row][RADIAL_PLACES], "solid")]
            if before is not None:
                curves.append(("before", np.array(before.parameters[RADIAL_PLACES]), "dash"))
            for when, coefficients, dash in curves:
                figure.add_scatter(
                    x=radius, y=1e3 * curve_from_polynomial(tuple(coefficients.tolist()), radius), mode="lines",
                    name=f"{names[row]}, {when}", line={"dash": dash},
                )  # fmt: skip
        return figure

    def normalised_residuals(self) -> Figure:
        """Draw the histogram of the normalised residuals w of photo points, and the normal distribution."""
        residuals = self._input().solution.residuals
        used = np.array([kind == PHOTO_POINT.name for kind in residuals.kind]) & (residuals.weight_factor > 0.0)
        w = np.copysign(residuals.w[used], residuals.residual[used])
        w = w[np.isfinite(w)]
        figure = _plotly().Figure(layout=_layout("Normalised residuals of photo points", "w", "number"))
        reach, step = 4.0, 0.25
        beyond = int(np.count_nonzero(np.abs(w) > reach))
        inside = np.clip(w, -reach, reach - 1e-9)
        figure.add_histogram(x=inside, xbins={"start": -reach, "end": reach, "size": step}, name="residuals")
        if beyond:
            figure.update_layout(xaxis_title=f"w; {beyond} beyond ±{reach:g}, in the outermost bars")
        across = np.linspace(-reach, reach, 161)
        expected = w.size * step * np.exp(-(across**2) / 2.0) / np.sqrt(2.0 * np.pi)
        figure.add_scatter(x=across, y=expected, mode="lines", name="expected by chance")
        return figure

    def convergence(self) -> Figure:
        """Draw ENP and sigma0 over the iterations."""
        passes = self._input().solution.iterations
        figure = _plotly().Figure(layout=_layout("Convergence", "iteration", "ENP"))
        number = [step.iteration for step in passes]
        figure.add_scatter(x=number, y=[step.enp for step in passes], name="ENP")
        figure.add_scatter(x=number, y=[step.sigma0 for step in passes], name="sigma0", yaxis="y2")
        figure.update_layout(yaxis2={"title": "sigma0", "overlaying": "y", "side": "right"})
        return figure


def _plotly() -> Any:
    import plotly.graph_objects as go

    return go


def _layout(title: str, across: str, up: str) -> dict[str, Any]:
    return {"title": title, "xaxis_title": across, "yaxis_title": up, "template": "simple_white"}


def _corner(text: str) -> dict[str, Any]:
    return {"text": text, "showarrow": False, "xref": "paper", "yref": "paper", "x": 0, "y": 0, "yanchor": "top",
            "yshift": -35}  # fmt: skip


def _enlargement(length: float, large: float) -> float:
    """Return a round number of times by which a large size is drawn with about a length."""
    return round_step(length / large, 1) if large > 0.0 else 1.0


def _lines(start: FloatArray, shift: FloatArray) -> dict[str, Any]:
    """Return the coordinates of n lines in one trace, parted by gaps."""
    ends = np.stack([start, start + shift, np.full_like(start, np.nan)], axis=1).reshape(-1, 2)
    return {"x": ends[:, 0], "y": ends[:, 1], "mode": "lines"}


def _vectors(photos: Sequence[PhotoVectors], given: ReportInput, camera: str, title: str) -> Figure:
    """Draw the residuals of some photos of a camera in one frame."""
    figure = _plotly().Figure(layout=_layout(title, "x (mm)", "y (mm)"))
    if not photos:
        return figure
    low, high = frame_extent(given, camera, photos)
    scale = _enlargement(_LENGTH * float(np.max(high - low)), large_residual(photos))
    most = 0.5 * float(np.max(high - low))  # very long ones are cut off, as in the report
    figure.add_shape(type="rect", x0=low[0], y0=low[1], x1=high[0], y1=high[1], line={"color": "#616a73", "width": 1})
    xy, residual, sound = (
        np.concatenate([getattr(photo, name) for photo in photos]) for name in ("xy", "residual", "sound")
    )
    name = np.concatenate([[photo.photo] * len(photo.xy) for photo in photos])
    for chosen, what, colour in ((sound, "full weight", _COLOURS["photo"]), (~sound, "lost weight", _LOST)):
        if not chosen.any():
            continue
        shift = scale * residual[chosen]
        length = np.hypot(*shift.T)[:, None]
        shift *= np.minimum(1.0, most / np.maximum(length, 1e-12))
        figure.add_scattergl(
            **_lines(xy[chosen], shift), name=what, line={"color": colour, "width": 1.2},
            hoverinfo="skip",
        )  # fmt: skip
        told = [
            f"photo {photo}<br>vx {1e3 * vx:.2f} µm<br>vy {1e3 * vy:.2f} µm"
            for photo, (vx, vy) in zip(name[chosen].tolist(), residual[chosen].tolist(), strict=True)
        ]
        figure.add_scattergl(
            x=xy[chosen, 0], y=xy[chosen, 1], mode="markers", marker={"size": 3, "color": colour}, text=told,
            hoverinfo="text", showlegend=False,
        )  # fmt: skip
    figure.update_yaxes(scaleanchor="x")
    figure.add_annotation(_corner(f"residuals enlarged {scale:g} times"))
    return figure


def _side_by_side(figures: Sequence[Figure], titles: Sequence[str]) -> Figure:
    from plotly.subplots import make_subplots

    whole = make_subplots(rows=1, cols=len(figures), subplot_titles=[*titles])
    for column, figure in enumerate(figures, start=1):
        whole.add_traces(figure.data, rows=1, cols=column)
        whole.update_yaxes(scaleanchor=f"x{column}" if column > 1 else "x", row=1, col=column)
    whole.update_layout(title="Residuals of all photos", template="simple_white", showlegend=False)
    return whole
