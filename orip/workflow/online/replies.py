"""Replies to requests: what a session says, as documents of JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from orip.errors import OripError, UsageError
from orip.online.answers import Answer, Candidate, Suspect, words_of
from orip.online.summary import summary
from orip.workflow.online.requests import Request, read_request
from orip.workflow.online.session import OnlineSession
from orip.workflow.online.showing import cameras_of, photos_of, points_of, residuals_of, statistics_of

Reply = dict[str, Any]

SUMMARY = Request("show")
"""What is told first."""

_MOST_ADVISED = 20
"""What to measure next that is shown."""


def reply_to(session: OnlineSession, folder: Path, line: str) -> Reply | None:
    """Return the reply to a line; None: the session ends. A faulty request is answered with what is wrong."""
    try:
        request = read_request(line)
        return None if request.do == "quit" else _carried_out(session, folder, request)
    except OripError as error:
        return {"error": str(error)}


def _carried_out(session: OnlineSession, folder: Path, request: Request) -> Reply:
    match request.do:
        case "measure":
            return reply_of(session, session.measure(request.photo, request.point, request.xy))
        case "exclude":
            return reply_of(session, session.exclude(request.photo, request.point))
        case "include":
            return reply_of(session, session.include(request.photo, request.point))
        case "remove":
            session.remove(request.photo, request.point)
            return {"photo": request.photo, "point": request.point, "state": "removed"}
        case "undo":
            undone = session.undo()
            return {"state": "removed"} if undone is None else reply_of(session, undone)
        case "relinearise":
            if not len(session.measuring.block.measurements):
                message = "nothing is measured yet"
                raise UsageError(message)
            session.measuring.relinearise()
            return {"summary": summary(session.measuring)}
        case "solve":
            return _solved(session, folder, prune=request.prune)
        case _:
            return shown(session, request)


def _solved(session: OnlineSession, folder: Path, *, prune: bool) -> Reply:
    """Do what `orip measure` and `orip solve` do."""
    # they take their time to import, and a session has to answer soon
    from orip.bundle.methods import Method
    from orip.workflow.adjust.solve import ADJUSTED_FROM, solve
    from orip.workflow.observations.measure import MEASURED_FROM, measure
    from orip.workflow.project.bundle_state import read_bundle
    from orip.workflow.project.commit import commit
    from orip.workflow.project.state import read_project

    method = Method(prune=prune)
    commit(measure(read_project(folder, *MEASURED_FROM)))
    outcome = commit(solve(read_bundle(folder, session.bundle.name, *ADJUSTED_FROM), method=method)).outcome
    solution = outcome.solution
    return {
        "status": solution.status,
        "sigma0": solution.sigma0,
        "left out": list(outcome.left_out),
        "held": [one.text for one in solution.diagnosis if one.code == "pruned"],
        "files": [path.name for path in outcome.files],
    }


def shown(session: OnlineSession, request: Request = SUMMARY) -> Reply:
    """Return what a session has, and is asked to show."""
    measuring = session.measuring
    if len(measuring.block.measurements):
        measuring.try_waiting()
    match request.what:
        case "waiting":
            return {"waiting": list(measuring.waiting().values())}
        case "suspects":
            measuring.examine()
            return {"suspects": [_suspect(one) for one in measuring.suspects.values()]}
        case "todo":
            advised = measuring.next(measuring.block.measurements.photos, _MOST_ADVISED)
            return {"todo": [_candidate(session, one) for one in advised]}
        case "photos":
            return {"photos": photos_of(measuring)}
        case "points":
            return {"points": points_of(measuring)}
        case "cameras":
            return {"cameras": cameras_of(measuring)}
        case "residuals":
            photo = session.name_of(request.photo) if request.photo else ""
            return {"residuals": residuals_of(measuring, photo, request.point)}
        case "statistics":
            return {"statistics": statistics_of(measuring)}
        case _:
            return {"summary": summary(measuring)}


def reply_of(session: OnlineSession, answer: Answer) -> Reply:
    """Return the answer to a measurement."""
    return {
        "photo": answer.photo,
        "point": answer.point,
        "state": answer.state,
        "text": answer.text,
        "w": answer.w,
        "limit": answer.limit,
        "redundancy": list(answer.redundancy),
        "sigma0": answer.sigma0,
        "sigma0 before": answer.sigma0_before,
        "suspects": [_suspect(one) for one in answer.suspects],
        "cleared": [words_of(key) for key in answer.cleared],
        "oriented": list(answer.oriented),
        "placed": list(answer.placed),
        "next": [_candidate(session, one) for one in answer.next],
        "pending": answer.is_pending,
    }


def reconsidered_of(session: OnlineSession, answer: Answer) -> Reply:
    """Return what is told of an answer that has changed, or that took longer than was waited for."""
    # takes its time to import
    from orip.schemas.catalogue import identifier

    return {"schema": identifier("online-reconsidered"), "command": "online", "reconsidered": reply_of(session, answer)}


def _candidate(session: OnlineSession, candidate: Candidate) -> Reply:
    x, y = session.to_log(candidate.photo, candidate.xy)
    ellipse = candidate.ellipse
    within = "" if ellipse is None else f", ellipse {ellipse[0]:.3f} x {ellipse[1]:.3f} mm at {ellipse[2]:.0f}°"
    name = candidate.point or "a new point"
    return {
        "photo": candidate.photo,
        "point": candidate.point,
        "x": round(x, 4),
        "y": round(y, 4),
        "mm": list(session.to_photo(candidate.photo, candidate.xy)),
        "ellipse": None if ellipse is None else list(ellipse),
        "gain": candidate.gain,
        "text": f"{name} in {candidate.photo}, expected at {x:.3f}, {y:.3f}{within}: {candidate.why}",
    }


def _suspect(suspect: Suspect) -> Reply:
    return {
        "observation": words_of(suspect.key),
        "photo": suspect.key.photo,
        "point": suspect.key.point,
        "w": suspect.w,
        "limit": suspect.limit,
        "alike": [words_of(key) for key in suspect.alike],
    }
