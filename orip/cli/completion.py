"""What completion of the shell offers for names: of bundles, photos, cameras, points, control and samples.

What cannot be read offers nothing: a shell has no place for messages while it completes.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from orip.errors import OripError

if TYPE_CHECKING:
    from orip.workflow.project.state import ProjectState


def samples(incomplete: str) -> list[str]:
    """Return the names of the sample projects."""
    from orip.workflow.sample_projects import SAMPLES

    return that_begin(SAMPLES, incomplete)


def bundles(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the project's bundles."""
    state = _state(context)
    return that_begin(state.project.bundle_names if state else (), incomplete)


def photos(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the project's photos."""
    return _records(context, "photos", incomplete)


def cameras(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the project's cameras."""
    return _records(context, "cameras", incomplete)


def templates(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the project's templates."""
    return _records(context, "templates", incomplete)


def points(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the points that are measured in photos."""
    state = _state(context, with_points=True)
    observations = state.measured.observations.values() if state else ()
    return that_begin((point for bundle in observations for point in bundle.points), incomplete)


def of_results(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the cameras, photos or points, whichever the argument before asks for."""
    named = {
        "cameras": (cameras,),
        "photos": (photos,),
        "points": (points,),
        "residuals": (photos,),
        "covariance": (cameras, photos, points),
    }
    offered = named.get(str(context.params.get("what")), ())
    return [name for names in offered for name in names(context, incomplete)]


def lines_of_control(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names in the control text that a group of commands is about: `orip control points`."""
    from orip.files.control.editing import FORMS
    from orip.workflow.observations.control import list_control
    from orip.workflow.project.state import read_project

    group = str(context.parent.info_name) if context.parent else ""
    kind = next((kind for kind in FORMS if kind == group), None)
    if kind is None:
        return []
    try:
        table = list_control(read_project(folder_of(context)), kind, context.params.get("bundle"))
    except (OripError, OSError):
        return []
    return that_begin((fields[0] or "" for _, fields, _ in table.rows), incomplete)


def of_group(context: typer.Context, incomplete: str) -> list[str]:
    """Return the names of the records that a group of commands is about: `orip photo`, `orip camera`."""
    group = str(context.parent.info_name) if context.parent else ""
    if group == "bundle":
        return bundles(context, incomplete)
    return _records(context, f"{group}s", incomplete) if group in {"camera", "photo", "template"} else []


def _records(context: typer.Context, kind: str, incomplete: str) -> list[str]:
    state = _state(context)
    if state is None:
        return []
    stored = [stored.record.name for stored in getattr(state.definitions, kind)]
    return that_begin([*(record.name for record in getattr(state.project.definition, kind)), *stored], incomplete)


def _state(context: typer.Context, *, with_points: bool = False) -> ProjectState | None:
    """Return the project that the command line is about; None if it cannot be read."""
    from orip.workflow.project.state import read_project

    parts = ("definitions", "marks", "observations") if with_points else ("definitions",)
    try:
        return read_project(folder_of(context), *parts)
    except (OripError, OSError):
        return None


def folder_of(context: typer.Context) -> Path:
    """Return the folder that the command line is about."""
    return Path(context.find_root().params.get("folder") or Path())


def that_begin(names: Iterable[str], incomplete: str) -> list[str]:
    """Return the names that begin so, each once."""
    return [name for name in dict.fromkeys(names) if name.startswith(incomplete)]
