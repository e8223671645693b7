"""Replies to requests: what a session has and what it answers, as documents of JSON."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.errors import OripError, UsageError
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.online.answers import Answer, Candidate, Suspect, words_of
from orip.online.block.online_block import OnlineBlock
from orip.online.control_examination import control_as_given
from orip.online.fit import given_of, measured_of, photo_deviations, point_deviations, residuals_of, statistics_of
from orip.online.measuring import Measuring
from orip.online.requests import Request, read_request
from orip.online.session import LOG, OnlineSession
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.photo import PHOTO_PARAMETERS
from orip.wording import counted
from orip.workflow.adjust.gathering import block_input_so_far
from orip.workflow.observations.films import mounted_films
from orip.workflow.project.bundle_state import BundleState


def summary(measuring: Measuring) -> str:
    """Return the state of the block in a line."""
    block = measuring.block
    values, sigma0 = block.values, block.sigma0
    parts = [
        f"{counted(len(block.measurements), 'photo point')} measured",
        f"{counted(len(values.orientations), 'photo')} oriented",
        f"{counted(len(values.points), 'point')} placed",
        "no redundancy" if sigma0 is None else f"sigma0 {sigma0:.3f} with redundancy {block.equations.redundancy}",
    ]
    if measuring.system:
        parts.append(measuring.system)
    if measuring.suspects:
        parts.append(f"{len(measuring.suspects)} suspect")
    return ", ".join(parts)


Shown = dict[str, Any]


@contextmanager
def _at_solution(measuring: Measuring) -> Iterator[OnlineBlock]:
    """Yield the block of a session near its solution with the control as the project gives it, held where it is."""
    measuring.reconsider()
    with control_as_given(measuring.block):
        measuring.approach_solution()
        yield measuring.block


def _shown_values(block: OnlineBlock) -> tuple[dict[str, FloatArray], Mapping[str, FloatArray]]:
    """Return orientations and points of the solution; in a local system its first photo is at the origin."""
    orientations, points = block.at_solution()
    photos = [name for name in block.measurements.photos if name in orientations]
    if block.local is None or len(photos) < _TWO:
        return orientations, points
    return block.local.shown(photos, orientations, points)


_TWO = 2
"""Photos that give origin, axes and scale of a local system."""


def photos_of(measuring: Measuring) -> list[Shown]:
    """Return all photos in which something is measured: elements in project units and degrees, or what is missing."""
    with _at_solution(measuring) as block:
        orientations, _ = _shown_values(block)
        oriented = {name: orientations[name] for name in block.measurements.photos if name in orientations}
        deviations = {} if measuring.system else photo_deviations(block, oriented)
    values = block.values
    elements = {}
    if oriented:
        local = np.array(list(oriented.values()))
        centres = block.ground.to_project(local[:, :3])
        rotations = block.ground.axes_at(centres) @ rotation_from_angles(local[:, 3:])
        degrees = np.degrees(angles_from_rotation(rotations))
        elements = dict(zip(oriented, np.hstack([centres, degrees]).tolist(), strict=True))
    return [
        {
            "photo": name,
            "points": len(block.measurements.points_in(name)),
            "included": len(block.included_of(photos=[name])),
            "waits": "" if name in oriented else values.photos_wait.get(name, ""),
            **(dict(zip(PHOTO_PARAMETERS, elements[name], strict=True)) if name in oriented else {}),
            **({"sd": deviations[name]} if name in deviations else {}),
        }
        for name in block.measurements.photos
    ]


def points_of(measuring: Measuring) -> list[Shown]:
    """Return all points that are measured: coordinates in the project, or what is missing, and numbers of rays."""
    with _at_solution(measuring) as block:
        _, points = _shown_values(block)
        placed = {name: found for name in block.measurements.points if (found := points.get(name)) is not None}
        deviations = {} if measuring.system else point_deviations(block, placed)
    values = block.values
    places = block.ground.to_project(np.array(list(placed.values())).reshape(-1, 3)).tolist()
    coordinates = dict(zip(placed, places, strict=True))
    return [
        {
            "point": name,
            "rays": len(block.measurements.photos_of(name)),
            "included": sum(key.kind == "photo" for key in block.included_of(points=[name])),
            "waits": "" if name in placed else values.points_wait.get(name, ""),
            **(dict(zip("XYZ", coordinates[name], strict=True)) if name in placed else {}),
            **({"sd": deviations[name]} if name in deviations else {}),
        }
        for name in block.measurements.points
    ]


def cameras_of(measuring: Measuring) -> list[Shown]:
    """Return all cameras with the parameters that measuring goes on with, mm, and which are unknown to `solve`."""
    measuring.approach_solution()
    block = measuring.block
    return [
        {
            "camera": camera.name,
            "unknown": list(camera.unknown),
            "adjusted": camera.name in block.values.cameras,
            **dict(zip(CAMERA_PARAMETERS, block.values.cameras.get(camera.name, camera.parameters), strict=True)),
        }
        for camera in block.measurements.inputs.records.cameras.values()
    ]


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
        case "exclude" | "include" if request.observation:
            answer = session.decide(request.observation, is_excluded=request.do == "exclude")
            return {"observation": request.observation, **reply_of(session, answer)}
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
        case "add" | "solve":
            return _ADJUSTED[request.do](session, folder, request)
        case _:
            return shown(session, request)


def _solved(session: OnlineSession, folder: Path, request: Request) -> Reply:
    """Do what `orip measure` and `orip solve` do."""
    # they take their time to import, and a session has to answer soon
    from orip.bundle.methods import Method
    from orip.workflow.adjust.solve import ADJUSTED_FROM, solve
    from orip.workflow.observations.measure import MEASURED_FROM, measure
    from orip.workflow.project.bundle_state import read_bundle
    from orip.workflow.project.commit import commit
    from orip.workflow.project.state import read_project

    method = Method(prune=request.prune)
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


_ADJUSTED: Mapping[str, Callable[[OnlineSession, Path, Request], Reply]] = {"add": what_helps, "solve": _solved}
"""What adjusts everything first."""


def shown(session: OnlineSession, request: Request = SUMMARY) -> Reply:
    """Return what a session has, and is asked to show."""
    measuring = session.measuring
    if len(measuring.block.measurements):
        measuring.try_waiting()
    find = _SHOWN.get(request.what)
    if find is not None:
        return find(session, request)
    return {"summary": summary(measuring), "system": _system(measuring)}


def _shown_suspects(session: OnlineSession, _: Request) -> Reply:
    session.measuring.examine()
    return {"suspects": [_suspect(one) for one in session.measuring.suspects.values()]}


def _shown_advice(session: OnlineSession, _: Request) -> Reply:
    measuring = session.measuring
    advised = measuring.next(measuring.block.measurements.photos, _MOST_ADVISED)
    return {"todo": [_candidate(session, one) for one in advised]}


def _shown_residuals(session: OnlineSession, request: Request) -> Reply:
    photo = session.name_of(request.photo) if request.photo else ""
    return {"residuals": residuals_of(session.measuring, photo, request.point)}


_SHOWN: Mapping[str, Callable[[OnlineSession, Request], Reply]] = {
    "waiting": lambda session, _: {"waiting": list(session.measuring.waiting().values())},
    "suspects": _shown_suspects,
    "todo": _shown_advice,
    "photos": lambda session, _: {"system": _system(session.measuring), "photos": photos_of(session.measuring)},
    "points": lambda session, _: {"system": _system(session.measuring), "points": points_of(session.measuring)},
    "cameras": lambda session, _: {"cameras": cameras_of(session.measuring)},
    "residuals": _shown_residuals,
    "given": lambda session, _: {"given": given_of(session.measuring)},
    "measured": lambda session, _: {"measured": measured_of(session.measuring)},
    "statistics": lambda session, _: {"statistics": statistics_of(session.measuring)},
}


def _system(measuring: Measuring) -> str:
    """Return what coordinates refer to: the ground, or a local system until there is control enough."""
    return "local" if measuring.system else "ground"


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
