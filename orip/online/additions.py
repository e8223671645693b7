"""What would help most beside what is measured: control, distances or photos, by the search of `orip plan place`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from orip.errors import UsageError
from orip.online.requests import Request
from orip.online.session import LOG, OnlineSession
from orip.workflow.adjust.gathering import block_input_so_far
from orip.workflow.observations.films import mounted_films
from orip.workflow.project.bundle_state import BundleState

_JUDGED = 100
"""Points whose largest standard deviation is to fall, about."""


def what_helps(session: OnlineSession, folder: Path, request: Request) -> dict[str, Any]:
    """Adjust all that is measured in memory, and return what brings the largest standard deviation down most.

    Raises
    ------
    UsageError
        If nothing is measured yet, or there are fewer places than wanted.
    InputError, NotSolvableError
        If what is measured does not suffice for an adjustment.
    """
    # they take their time to import, and a session has to answer soon
    from orip.bundle.additions.placing import USUAL_ERROR, Wanted, place_in_block, told
    from orip.solving.solve import adjust_bundle

    if not len(session.measuring.block.measurements):
        message = "nothing is measured yet"
        raise UsageError(message)
    films = mounted_films(folder, LOG, "heads")
    solved = adjust_bundle(block_input_so_far(BundleState(films.state, session.bundle.name)))
    wanted = Wanted(request.added, request.number, "largest", _JUDGED, USUAL_ERROR)
    return told(place_in_block(solved, wanted), wanted)
