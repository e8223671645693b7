"""`orip camera plot`: curves in characters over one axis, for terminals."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer

from orip.arrays import FloatArray
from orip.cli.completion import cameras
from orip.cli.options import Invocation, command

if TYPE_CHECKING:
    from orip.workflow.records.lists import DistortionCurve


class Characters(NamedTuple):
    """What a plot is drawn with."""

    curve: str
    point: str
    zero: str
    side: str
    corner: str
    base: str


UNICODE = Characters("•", "◇", "╌", "│", "└", "─")
ASCII = Characters("*", "o", "-", "|", "+", "-")


def text_plot(
    curve: tuple[FloatArray, FloatArray],
    points: tuple[FloatArray, FloatArray],
    size: tuple[int, int],
    labels: tuple[str, str],
    characters: Characters,
) -> list[str]:
    """Return the lines of a plot; where a point meets the curve, the point is drawn.

    Parameters
    ----------
    curve, points : pairs of arrays
        x and y; a curve is interpolated between its values. x counts from 0.
    size : (int, int)
        Columns and lines of the field inside the axes.
    labels : (str, str)
        What x and y are, with units.
    """
    width, height = size
    y_all = np.concatenate([curve[1], points[1], [0.0]])
    low, high = float(y_all.min()), float(y_all.max())
    if low == high:
        low, high = -1.0, 1.0
    end = float(max(curve[0].max(initial=0.0), points[0].max(initial=0.0)))
    field = [[" "] * width for _ in range(height)]

    def row_of(y: float) -> int:
        return round((high - y) / (high - low) * (height - 1))

    field[row_of(0.0)] = [characters.zero] * width
    at = np.linspace(0.0, end, width)
    for column, y in enumerate(np.interp(at, *curve).tolist()):
        field[row_of(y)][column] = characters.curve
    for x, y in zip(points[0].tolist(), points[1].tolist(), strict=True):
        field[row_of(y)][round(x / end * (width - 1))] = characters.point
    return _framed(field, (low, high, end), row_of(0.0), labels, characters)


def _framed(
    field: Sequence[Sequence[str]],
    ends: tuple[float, float, float],
    zero: int,
    labels: tuple[str, str],
    characters: Characters,
) -> list[str]:
    low, high, end = ends
    marks = {0: f"{high:z.4g}", len(field) - 1: f"{low:z.4g}", zero: "0"}
    margin = max(map(len, marks.values()))
    lines = [f"{labels[1]}"]
    for row, cells in enumerate(field):
        lines.append(f"{marks.get(row, ''):>{margin}} {characters.side}{''.join(cells)}".rstrip())
    lines.append(f"{'':>{margin}} {characters.corner}{characters.base * len(field[0])}")
    last = f"{end:.4g}  {labels[0]}"
    lines.append(f"{'':>{margin}}  0{last:>{len(field[0]) - 1}}")
    return lines


Name = Annotated[str, typer.Argument(metavar="NAME", autocompletion=cameras, help="A camera.")]
Radius = Annotated[float | None, typer.Option("--radius", min=1e-6, help="Plot up to this radius (mm).")]
Stored = Annotated[bool, typer.Option("--stored", help="As the store has it, even if it has been adjusted.")]
Ascii = Annotated[bool, typer.Option("--ascii", help="Draw with plain characters.")]

_MARGIN = 14
_LINES = 15


def register(app: typer.Typer) -> None:
    """Add the command to the group of commands about cameras, which already exists."""
    group = next(
        registered.typer_instance
        for registered in app.registered_groups
        if _name(registered.typer_instance) == "camera"
    )
    if group is not None:
        _register_plot(group)


def _name(group: typer.Typer | None) -> object:
    return group.info.name if group is not None else None


def _register_plot(group: typer.Typer) -> None:
    @command(group, "plot")
    def plot_command(
        invocation: Invocation, name: Name, radius: Radius = None, stored: Stored = False, ascii_only: Ascii = False
    ) -> None:
        """Plot the radial distortion of a camera over the radius, with the points of the curve it was given as.

        If an adjustment has determined it, the adjusted one is plotted.

        Example: orip camera plot OLYMPUS
        """
        from orip.workflow.project.state import read_project
        from orip.workflow.records.lists import distortion_curve

        found = distortion_curve(
            read_project(invocation.folder, "definitions", "solutions"), name, radius, is_stored=stored
        )
        invocation.terminal.answer("camera-plot", _document(found), "\n".join(_plot(found, ascii_only=ascii_only)))


def _plot(found: DistortionCurve, *, ascii_only: bool) -> list[str]:
    from orip.files.listings.observations import distortion_lines

    width = max(min(shutil.get_terminal_size().columns, 120) - _MARGIN, 20)
    plain = ascii_only or "utf" not in (sys.stdout.encoding or "").lower()
    plot = text_plot(
        (found.radius, 1e3 * found.distortion),
        (found.given_radius, 1e3 * found.given),
        (width, _LINES),
        ("R (mm)", f"D ({'um' if plain else 'µm'}), camera {found.camera}{_source(found)}"),
        ASCII if plain else UNICODE,
    )
    return [
        *plot,
        "",
        *distortion_lines(found.coefficients, found.isp, found.given_radius, found.given, found.residual),
    ]


def _source(found: DistortionCurve) -> str:
    return f", adjusted in bundle {found.bundle}" if found.bundle else ""


def _document(found: DistortionCurve) -> dict[str, Any]:
    from orip.records.camera import ISP_PARAMETERS, RADIAL_PARAMETERS

    return {
        "command": "camera plot",
        "camera": found.camera,
        "form": found.form,
        "bundle": found.bundle or None,
        "polynomial": dict(zip(RADIAL_PARAMETERS, found.coefficients, strict=True)),
        "isp": None if found.isp is None else dict(zip(ISP_PARAMETERS, found.isp, strict=True)),
        "radius": found.radius.tolist(),
        "distortion": found.distortion.tolist(),
        "curve": [
            {"radius": radius, "given": given, "residual": residual}
            for radius, given, residual in zip(
                found.given_radius.tolist(), found.given.tolist(), found.residual.tolist(), strict=True
            )
        ],
    }
