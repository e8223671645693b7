"""`orip restitute`: features from stereo measurements, what there is, and drawings of it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from orip.cli.options import BundleOption, ForceOption, Invocation, add_group, command
from orip.cli.terminal import Terminal, warning_rows
from orip.errors import UsageError
from orip.wording import counted

if TYPE_CHECKING:
    from orip.restitution.feature import Feature
    from orip.restitution.restitute import Restituted

_ABOUT = """Points, lines and areas from stereo measurements, with standard deviations, in the .GEO file.

Example: orip restitute compute STEREO.STE; orip restitute export dxf map.dxf
"""


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    add_group(app, "restitute", _ABOUT, _register)


def _register(group: typer.Typer) -> None:
    command(group, "compute")(compute_command)
    command(group, "show", reads_only=True)(show_command)
    command(group, "export")(export_command)


def compute_command(
    invocation: Invocation,
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Stereo measurements (.STE).")],
    snap: Annotated[
        float, typer.Option("--snap", metavar="DISTANCE", min=0.0, help="Vertices snap within so many ground units.")
    ] = 0.0,
    bundle: BundleOption = None,
) -> None:
    """Compute features from stereo measurements in the last adjustment, and put them into the .GEO file.

    A feature takes the place of the one with its code and name: after another adjustment, give the same files again.

    Example: orip restitute compute STEREO.STE --snap 0.1
    """
    from orip.restitution.restitute import RESTITUTED_FROM, restitute
    from orip.workflow.project.bundle_state import read_bundle
    from orip.workflow.project.commit import commit

    state = read_bundle(invocation.folder, bundle, *RESTITUTED_FROM)
    found = commit(restitute(state, files, snap)).outcome
    terminal = invocation.terminal
    terminal.warn(found.warnings)
    if terminal.json:
        terminal.document("restitute-compute", _computed_document(found))
        return
    unit = state.project.definition.ground_unit
    vertices = [vertex for feature in found.features for vertex in feature.vertices]
    more = f"; {found.snapped} of them snapped" if found.snapped else ""
    noun = "vertex" if len(vertices) == 1 else "vertices"
    features = counted(len(found.features), "feature")
    terminal.say(f"restituted {features} with {len(vertices)} {noun}{more}; written to {found.file}")
    sd = np.median([vertex.sd for vertex in vertices if vertex.sd is not None], axis=0)
    terminal.say(f"standard deviations (median): X {sd[0]:.4f}  Y {sd[1]:.4f}  Z {sd[2]:.4f} {unit}")


def _computed_document(found: Restituted) -> dict[str, object]:
    rows = [{**_row(feature), "largest_w": max(w)} for feature, w in zip(found.features, found.w, strict=True)]
    return {
        "command": "restitute compute",
        "file": found.file,
        "features": rows,
        "snapped": found.snapped,
        "warnings": warning_rows(found.warnings),
    }


def _row(feature: Feature) -> dict[str, object]:
    from orip.restitution.feature import area_of, length_of

    sd = [vertex.sd for vertex in feature.vertices if vertex.sd is not None]
    parallax = [abs(vertex.stereo.y_parallax) for vertex in feature.vertices if vertex.stereo is not None]
    return {
        "kind": feature.kind,
        "code": feature.code,
        "name": feature.name,
        "vertices": len(feature.vertices),
        "length": length_of(feature),
        "area": area_of(feature),
        "largest_sd": np.max(sd, axis=0).tolist() if sd else None,
        "largest_y_parallax": max(parallax, default=None),
    }


def show_command(
    invocation: Invocation,
    code: Annotated[str | None, typer.Option("--code", metavar="CODE", help="Only these.")] = None,
) -> None:
    """Show the features of the .GEO file: vertices, length, area, largest standard deviation and y-parallax.

    Example: orip restitute show --code ROAD
    """
    features, unit = _features(invocation.folder, code)
    rows = [_row(feature) for feature in features]
    terminal = invocation.terminal
    if terminal.json:
        terminal.document("restitute-show", {"command": "restitute show", "ground_unit": unit, "features": rows})
        return
    if not rows:
        terminal.say("there are no such features; 'orip restitute compute' makes some of stereo measurements")
        return
    _tell_features(terminal, features, unit)


def _tell_features(terminal: Terminal, features: tuple[Feature, ...], unit: str) -> None:
    heading = f"{'kind':<6} {'code':<12} {'name':<12} {'vertices':>8} {'length':>12} {'area':>14}"
    lines = [heading + "".join(f"{figure:>9}" for figure in ("sX", "sY", "sZ"))]
    for feature in features:
        row = _row(feature)
        sd = [vertex.sd for vertex in feature.vertices if vertex.sd is not None]
        cells = [f"{value:8.4f}" for value in (np.max(sd, axis=0).tolist() if sd else [math.nan] * 3)]
        lines.append(
            f"{feature.kind:<6} {feature.code:<12} {feature.name:<12} {len(feature.vertices):>8} "
            f"{row['length']:>12.3f} {row['area']:>14.3f} {' '.join(cells)}"
        )
    terminal.data("\n".join([f"lengths and largest standard deviations in {unit}", *lines]))


def export_command(
    invocation: Invocation,
    form: Annotated[str, typer.Argument(metavar="FORMAT", help="geojson, geopackage or dxf.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What is written.")],
    code: Annotated[str | None, typer.Option("--code", metavar="CODE", help="Only these.")] = None,
    force: ForceOption = False,
) -> None:
    """Write the features of the .GEO file for GIS and CAD.

    FORMAT is geojson (longitude and latitude where the project has a crs), geopackage, or dxf (release 12).

    Example: orip restitute export geopackage map.gpkg
    """
    from orip.restitution.feature import FORMATS
    from orip.workflow.project.outputs import TextOutput, require_replaceable, write_output
    from orip.workflow.project.state import read_project

    if form not in FORMATS:
        message = f"{form} is no format; write one of {', '.join(FORMATS)}"
        raise UsageError(message)
    features, _ = _features(invocation.folder, code)
    if not features:
        message = "there are no such features; 'orip restitute compute' makes some, 'orip restitute show' lists them"
        raise UsageError(message)
    project = read_project(invocation.folder).project
    path = project.folder / file
    data = FORMATS[form](features, project.definition.name, project.definition.crs)
    require_replaceable(project, path, force=force)
    write_output(project, TextOutput(path, lambda: [data], "free the file, then repeat the command"))
    terminal, shown = invocation.terminal, project.shown(path)
    if terminal.json:
        terminal.document(
            "restitute-export",
            {"command": "restitute export", "format": form, "file": shown, "features": len(features)},
        )
        return
    terminal.say(f"written  {counted(len(features), 'feature')} to {shown}")


def _features(folder: Path, code: str | None) -> tuple[tuple[Feature, ...], str]:
    from orip.records.names import record_key
    from orip.restitution.restitute import read_geo
    from orip.workflow.project.state import read_project

    project = read_project(folder).project
    wanted = None if code is None else record_key(code)
    found = tuple(one for one in read_geo(project) if wanted is None or record_key(one.code) == wanted)
    return found, project.definition.ground_unit
