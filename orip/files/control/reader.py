"""All control files of a project, read together; angles in gon or radians are taken to degrees."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from orip.files.control.covariances_text import parse_covariances, with_own_correlations
from orip.files.control.stations_text import parse_differences, parse_stations_and_reference
from orip.files.control.text import parse_directions, parse_distances, parse_elements, parse_figures, parse_points
from orip.files.text.lines import read_lines
from orip.files.text.shown import Parsed
from orip.records.control import (
    Control,
    FigurePoint,
    GivenDirection,
)
from orip.structs import replace


def in_degrees(control: Control, degrees: float) -> Control:
    """Return control whose elements, directions and given directions have angles in degrees.

    Exposure stations and differences between them are written by programs, in degrees.

    Parameters
    ----------
    degrees : float
        Of a unit of the files; 1: nothing is to be done.
    """
    if degrees == 1.0:
        return control
    from orip.records.observation_kinds import ANGULAR_UNKNOWNS  # takes arrays

    return replace(
        control,
        elements=tuple(
            replace(one, value=one.value * degrees, error=one.error * degrees) if one.kind in ANGULAR_UNKNOWNS else one
            for one in control.elements
        ),
        directions=tuple(
            replace(
                line,
                direction=line.direction * degrees,
                direction_error=line.direction_error * degrees,
                zenith=None if line.zenith is None else line.zenith * degrees,
                zenith_error=None if line.zenith_error is None else line.zenith_error * degrees,
            )
            for line in control.directions
        ),
        given_directions=tuple(replace(line, error=line.error * degrees) for line in control.given_directions),
    )


Content = TypeVar("Content")


def read_control_file(
    parse: Callable[[Parsed[list[str]], str], Parsed[Content]], folder: Path, name: str
) -> Parsed[Content]:
    """Read a file with the function that parses its kind; a file that is absent has no records."""
    return parse(read_lines(folder / name, name, may_be_absent=True), name)


def read_control(folder: Path, base: str) -> Parsed[Control]:
    """Read the control files of a project; those that are absent are empty.

    Parameters
    ----------
    folder : Path
        The project folder.
    base : str
        File name without extension, the project's `control_files`.
    """
    points = read_control_file(parse_points, folder, f"{base}.PNT")
    elements = read_control_file(parse_elements, folder, f"{base}.ELE")
    distances = read_control_file(parse_distances, folder, f"{base}.LEN")
    directions = read_control_file(parse_directions, folder, f"{base}.DIR")
    stations = read_control_file(parse_stations_and_reference, folder, f"{base}.STA")
    figures = read_control_file(parse_figures, folder, f"{base}.CON")
    differences = read_control_file(parse_differences, folder, f"{base}.REL")
    correlations = read_control_file(partial(parse_covariances, points=points.value), folder, f"{base}.COV")
    texts: tuple[Parsed[Any], ...] = (
        points, elements, distances, directions, figures, stations, differences, correlations
    )  # fmt: skip
    own, between = with_own_correlations(points.value, correlations.value)
    given = (own, elements.value, distances.value, directions.value, *stations.value, differences.value, between)
    on_figures = tuple(line for line in figures.value if isinstance(line, FigurePoint))
    lines = tuple(line for line in figures.value if isinstance(line, GivenDirection))
    complaints = tuple(complaint for text in texts for complaint in text.complaints)
    return Parsed(Control(*given, on_figures, lines), complaints, points.warnings)
