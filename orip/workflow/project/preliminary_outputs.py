"""PRELIM_RESULT.OUT: written whenever preliminary values were computed, also on the way to a solution."""

from __future__ import annotations

import math

from msgspec import Struct

from orip.arrays import FloatArray
from orip.files.listings.preliminary import preliminary_listing
from orip.prelim.ground import orientations_in_project, points_in_project
from orip.records.ground import GroundSystem
from orip.records.observations.control import PreliminaryPoint
from orip.records.results.preliminary import PreliminaryValues
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import run_id
from orip.workflow.project.text_output import TextOutput

_DIGITS = 3
"""Significant digits of a standard deviation in BUNDLE.PRE; coordinates have as many decimals as it."""


class ListedValues(Struct, frozen=True):
    """Preliminary values as files have them: project coordinates, degrees.

    Parameters
    ----------
    values : PreliminaryValues
        Its absolute orientation lists control as the project has it.
    orientations : array (number of photos, 6)
        X0 Y0 Z0 OMEGA PHI KAPPA; NaN where not found.
    points : tuple of PreliminaryPoint
    """

    values: PreliminaryValues
    orientations: FloatArray
    points: tuple[PreliminaryPoint, ...]


def listed_values(values: PreliminaryValues, ground: GroundSystem) -> ListedValues:
    """Transform what the chain found to the project's coordinates; its absolute orientation is in them already."""
    return ListedValues(
        values,
        orientations_in_project(values.photos, ground),
        tuple(_rounded(point) for point in points_in_project(values.points, ground)),
    )


def _rounded(point: PreliminaryPoint) -> PreliminaryPoint:
    """Return a point without insignificant digits."""
    known = [deviation for deviation in point.deviations or () if deviation > 0.0]
    if point.deviations is None or not known:
        return point
    decimals = _DIGITS - 1 - math.floor(math.log10(min(known)))
    x, y, z, sx, sy, sz = (round(number, decimals) for number in (*point.coordinates, *point.deviations))
    return PreliminaryPoint(point.name, (x, y, z), (sx, sy, sz))


def preliminary_output(project: ProjectFolder, bundle: str, found: ListedValues) -> TextOutput:
    """Return PRELIM_RESULT.OUT of a bundle."""
    definition = project.definition
    orientations = found.orientations.tolist()

    def listing() -> list[str]:
        text = preliminary_listing(
            found.values,
            orientations,
            found.points,
            definition.ground_unit,
            (("Project", definition.name), ("User", definition.user), ("Bundle", bundle)),
            run_id("prelim", orientations),
        )
        return [text]

    return TextOutput(project.preliminary_listing(bundle), listing, "remove the cause, then repeat the command")
