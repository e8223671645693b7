"""BUNDLE.PRE as a command changes it: its points, and the comments that it begins with."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path

from msgspec import Struct

from orip.files.control.preliminary_text import preliminary_text, read_preliminary
from orip.files.text.lines import read_lines
from orip.records.names import COMMENT_MARKS
from orip.records.observations.control import PreliminaryPoint
from orip.workflow.project.folder import ProjectFolder
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
