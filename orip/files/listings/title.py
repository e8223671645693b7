"""The title block that all listings begin with, and the run id in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from orip.files.identification import RUN_LABEL
from orip.files.text.table import PAGE_WIDTH, one_line, paragraph
from orip.records.results.tests import Status
from orip.version import __version__

if TYPE_CHECKING:
    from orip.records.results.solution import Solution

STATUS_REMARK: dict[Status, str] = {
    "converged": "",
    "doubtful": (
        "DOUBTFUL: the adjustment converged, but many observations are down-weighted, or sigma0_all is much larger "
        "than sigma0. A-priori errors are probably too small, or the model is wrong."
    ),
    "not_converged": "NOT CONVERGED: the values are those of the last iteration. Do not use them.",
    "not_determined": "NOT DETERMINED: the observations leave the block free; see the notes. Do not use its values.",
    "stopped": "STOPPED before convergence: the values are those of the last iteration. Do not use them.",
}


def title_block(title: str, run: str, facts: Sequence[tuple[str, str]]) -> list[str]:
    """Return the first lines of a listing.

    Parameters
    ----------
    title : str
        What the listing is, for example "BUNDLE ADJUSTMENT: RESULTS".
    run : str
        Run id of the stores that the listing was written from.
    facts : sequence of (label, text)
        Project, user, bundle, status, ... in this order.
    """
    program = f"orip {__version__}"
    pairs = [(label, one_line(text)) for label, text in (*facts, (RUN_LABEL, run))]
    width = max(len(label) for label, _ in pairs)
    return [
        title + program.rjust(max(PAGE_WIDTH - len(title), len(program) + 2)),
        "=" * PAGE_WIDTH,
        *(f"{label.ljust(width)}  {text}".rstrip() for label, text in pairs),
    ]


def bundle_title(title: str, solution: Solution) -> list[str]:
    """Return the first lines of a listing of one bundle adjustment, with a remark where its status asks for one."""
    facts = (
        ("Project", solution.project),
        ("User", solution.user),
        ("Bundle", solution.bundle),
        ("Status", solution.status.replace("_", " ")),
    )
    lines = title_block(title, solution.run, facts)
    remark = STATUS_REMARK[solution.status]
    return [*lines, "", *paragraph(remark, indent=0)] if remark else lines
