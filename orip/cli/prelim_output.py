"""What the terminal shows of preliminary values, and their JSON documents."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from orip.cli.terminal import Terminal, warning_rows
from orip.errors import NotSolvableError
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.photo import PHOTO_PARAMETERS
from orip.wording import counted, first_names

if TYPE_CHECKING:
    from orip.records.preliminary import (
        ModelCoordinates,
        NotOriented,
        PartialBlock,
        PhotoStart,
        PreliminaryValues,
        RelativeOrientation,
        SimilarityStep,
    )
    from orip.workflow.adjust.prelim import PrelimOutcome
    from orip.workflow.adjust.prelim_steps import Relative, SimilaritySteps


_SHOWN_WAYS = 30
_SHOWN_NAMES = 10


def tell_chain(terminal: Terminal, outcome: PrelimOutcome) -> None:
    """Say what was done for each photo, and what changed."""
    values, project = outcome.values, outcome.given.project
    terminal.warn(outcome.given.warnings)
    oriented = [photo for photo in values.photos if photo.rotation is not None]
    terminal.say(
        f"prelim   {outcome.given.bundle}: {len(oriented)} of {len(values.photos)} photos oriented, "
        f"{len(values.points)} points"
    )
    for how, names in _by_way(oriented)[:_SHOWN_WAYS]:
        terminal.say(f"         {names}: {how}")
    if (more := len(_by_way(oriented)) - _SHOWN_WAYS) > 0:
        terminal.say(f"         and {more} more lines: see {project.shown(outcome.listing)}")
    for camera in values.cameras:
        c, dx, dy = camera.parameters[:3]
        terminal.say(f"camera   {camera.name} is unknown; the photos fit with C {c:.3f}, DX {dx:.3f}, DY {dy:.3f}")
    if oriented:
        for finding in values.findings:
            terminal.say(f"note     {finding}", "yellow")
    if outcome.photos or outcome.points:
        terminal.say(f"update   {len(outcome.photos)} photos and {len(outcome.points)} points have new values")
    elif oriented:
        terminal.say("update   unchanged: photos and points have these values already")
    else:
        terminal.say("update   nothing: no photo is oriented absolutely")
    preliminary = project.shown(project.preliminary(outcome.given.bundle))
    if outcome.typed:
        terminal.say(f"kept     {counted(outcome.typed, 'point')} of {preliminary} typed by hand (no sX sY sZ)")
    if outcome.others:
        terminal.say(f"kept     {outcome.others} points of {preliminary} that were not computed")
    terminal.say(f"wrote    {project.shown(outcome.listing)}")


def raise_failures(failures: Sequence[NotOriented]) -> None:
    """End the command with what could not be oriented, if anything could not.

    Raises
    ------
    NotSolvableError
    """
    if failures:
        raise NotSolvableError("\n".join(f"{_names(failure)}: {failure.reason}" for failure in failures))


def chain_document(outcome: PrelimOutcome) -> dict[str, Any]:
    """Return what `orip prelim --json` prints."""
    project = outcome.given.project
    pairs = zip(outcome.values.photos, outcome.orientations.tolist(), strict=True)
    return {
        "command": "prelim",
        "bundle": outcome.given.bundle,
        "photos": {
            photo.name: {
                "oriented": photo.rotation is not None,
                "how": photo.how,
                **({} if photo.rotation is None else dict(zip(PHOTO_PARAMETERS, row, strict=True))),
            }
            for photo, row in pairs
        },
        "points": {
            point.name: {"X": point.coordinates[0], "Y": point.coordinates[1], "Z": point.coordinates[2]}
            for point in outcome.coordinates
        },
        "cameras": {
            camera.name: dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True))
            for camera in outcome.values.cameras
        },
        "findings": list(outcome.values.findings),
        "unchanged": not (outcome.photos or outcome.points),
        "changed_photos": list(outcome.photos),
        "changed_points": list(outcome.points),
        "listing": project.shown(outcome.listing),
        "warnings": warning_rows(outcome.given.warnings),
    }


def relative_document(found: Relative) -> dict[str, Any]:
    """Return relative orientations: mm, metres at photo scale, degrees."""
    return {
        "command": "prelim relative",
        "models": [_model(model) for model in found.oriented],
        "failures": [_failure(failure) for failure in found.failures],
    }


def similarity_document(found: SimilaritySteps) -> dict[str, Any]:
    """Return bridgings or connections."""
    return {
        "command": "prelim",
        "steps": [_step(step) for step in found.steps],
        "failures": [_failure(failure) for failure in found.failures],
    }


def absolute_document(values: PreliminaryValues, ground_unit: str) -> dict[str, Any]:
    """Return the absolute orientation; null where there is none."""
    unit = {"scale_unit": f"{ground_unit}/m", "shift_unit": ground_unit}
    return {
        "command": "prelim absolute",
        "absolute": None if values.absolute is None else {**_step(values.absolute), **unit},
        "findings": list(values.findings),
    }


def coordinates_document(found: ModelCoordinates) -> dict[str, Any]:
    """Return the model coordinate list."""
    return {
        "command": "prelim show",
        "after": found.stage,
        "systems": [_system(system, found) for system in found.systems],
    }


def without_absolute(hows: Sequence[str]) -> str:
    """Return why a block is on the ground without an absolute orientation, from how its photos were oriented."""
    if "given" in hows:
        return "the block was oriented absolutely by the photos whose orientation is given"
    return "the photos were oriented absolutely in one step, by resection from control"


def _by_way(photos: Sequence[PhotoStart]) -> list[tuple[str, str]]:
    """Return each way in which photos were oriented, and the names of these photos."""
    ways: dict[str, list[str]] = {}
    for photo in photos:
        ways.setdefault(photo.how, []).append(photo.name)
    return [(how, first_names(names, _SHOWN_NAMES)) for how, names in ways.items()]


def _model(model: RelativeOrientation) -> dict[str, Any]:
    import numpy as np

    columns = (model.left_xy, model.right_xy, model.parallax, model.parallax_deviation, model.weight_factor)
    points = [
        {"point": name, "left": left, "right": right, "py": py, "spy": spy, "weight_factor": weight, "in_front": front}
        for name, left, right, py, spy, weight, front in zip(
            model.points, *(column.tolist() for column in columns), model.in_front.tolist(), strict=True
        )
    ]
    return {
        "model": model.model, "left": model.left, "right": model.right, "row": model.row, "column": model.column,
        "npts": len(model.points), "its": model.iterations, "seuw": model.seuw, "mres": model.max_residual,
        "base": model.base.tolist(), "base_sd": model.base_deviation.tolist(),
        "angles": np.degrees(model.angles).tolist(), "angles_sd": np.degrees(model.angle_deviation).tolist(),
        "points": points, "remarks": list(model.remarks),
    }  # fmt: skip


def _step(step: SimilarityStep) -> dict[str, Any]:
    import numpy as np

    points = [
        {"point": name, "xyz": _numbers(xyz), "residuals": _numbers(v), "weight_factors": _numbers(weight)}
        for name, xyz, v, weight in zip(
            step.points, step.coordinates.tolist(), step.residuals.tolist(), step.weight_factor.tolist(), strict=True
        )
    ]
    return {
        "step": step.step, "from": step.source, "to": step.target or None, "photo": step.common_photo or None,
        "pnt": len(step.points), "its": step.iterations, "s0": step.s0, "mres": step.max_residual,
        "scale": step.scale, "scale_sd": step.scale_deviation,
        "shift": step.shift.tolist(), "shift_sd": step.shift_deviation.tolist(),
        "angles": np.degrees(step.angles).tolist(), "angles_sd": np.degrees(step.angle_deviation).tolist(),
        "points": points, "remarks": list(step.remarks),
    }  # fmt: skip


def _system(system: PartialBlock, found: ModelCoordinates) -> dict[str, Any]:
    return {
        "name": system.name or "ground",
        "photos": {found.photos[row]: _numbers(xyz) for row, xyz in zip(system.photos, system.centres, strict=True)},
        "points": {
            found.points[row]: {"xyz": _numbers(xyz), "sd": _numbers(sd)}
            for row, xyz, sd in zip(system.points, system.coordinates, system.deviations, strict=True)
        },
    }


def _numbers(values: Sequence[float]) -> list[float | None]:
    return [None if value != value else float(value) for value in values]


def _failure(failure: NotOriented) -> dict[str, str]:
    return {"name": failure.name, "other": failure.other, "reason": failure.reason}


def _names(failure: NotOriented) -> str:
    return f"{failure.name} and {failure.other}" if failure.other else failure.name
