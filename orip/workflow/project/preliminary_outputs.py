"""PRELIM_RESULT.OUT, and BUNDLE.PRE as a command changes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from msgspec import Struct

from orip.arrays import FloatArray
from orip.files.control.preliminary_text import preliminary_text, read_preliminary
from orip.files.listings.preliminary import preliminary_listing
from orip.files.text.lines import read_lines
from orip.prelim.ground import orientations_in_project, points_in_project
from orip.records.ground import GroundSystem
from orip.records.names import COMMENT_MARKS
from orip.records.observations.control import PreliminaryPoint
from orip.records.results.preliminary import PreliminaryValues
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import run_id
from orip.workflow.project.text_output import EditedText, TextOutput, digest_of_text
from orip.workflow.project.texts import raise_complaints

_REMEDY = "the file is unchanged"


class PreliminaryText(Struct, frozen=True):
    """BUNDLE.PRE as it was read; `digest` is None where there is none, `owner` names project and user."""

    path: Path
    digest: str | None
    comments: tuple[str, ...]
    points: tuple[PreliminaryPoint, ...]
    owner: str = ""

    def edited(self, points: Sequence[PreliminaryPoint], ground_unit: str) -> EditedText:
        """Return the file with other points; the comments that it begins with stay."""
        return EditedText(self.path, self.digest, self._with(points, ground_unit), _REMEDY)

    def output(self, points: Sequence[PreliminaryPoint], ground_unit: str) -> TextOutput:
        """Return the file with other points, to be written after the stores."""
        return TextOutput(self.path, lambda: [self._with(points, ground_unit)], _REMEDY)

    def _with(self, points: Sequence[PreliminaryPoint], ground_unit: str) -> str:
        comments: Sequence[str] = self.comments
        if not any(line.strip() for line in comments):
            comments = [f"! Preliminary coordinates, {ground_unit}: name X Y Z [sX sY sZ]{self.owner}"]
        return "".join(f"{line}\n" for line in comments) + preliminary_text(points)


def read_preliminary_text(project: ProjectFolder, bundle: str) -> PreliminaryText:
    """Read BUNDLE.PRE; one that is missing has no points.

    Raises
    ------
    InputError
        With everything that is wrong in it.
    """
    path = project.preliminary(bundle)
    shown, digest = project.shown(path), digest_of_text(path)
    found = read_preliminary(path, shown)
    raise_complaints(found.complaints)
    lines = read_lines(path, shown, may_be_absent=True).value
    comments = takewhile(lambda line: not line.strip() or line.strip().startswith(COMMENT_MARKS), lines)
    owner = f"; {project.owner}"
    return PreliminaryText(path, digest, tuple(comments), tuple(found.value), owner)


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
