"""`orip plan`: plan a flight or a network, forecast what it will know, compare variants, and place control."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from orip.cli.options import BundleOption, DryRunOption, ForceOption, Invocation, add_group, command
from orip.cli.terminal import Terminal
from orip.errors import UsageError
from orip.planning.after_commands import register_after

if TYPE_CHECKING:
    from orip.planning.designed import Given, PlacedControl, Variant
    from orip.planning.forecast import Forecast
    from orip.planning.plan import PlannedFlight

_GOALS = ("largest", "mean", "camera")


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    text = "Plan a flight or a network, and forecast its precision.\n\nExample: orip plan make; orip plan forecast"
    add_group(app, "plan", text, _register)


def _register(group: typer.Typer) -> None:
    _register_make(group)
    _register_forecast(group)
    _register_compare(group)
    _register_place(group)
    _register_export(group)
    register_after(group)
    _register_show(group)


def _register_show(group: typer.Typer) -> None:
    @command(group, "show")
    def show_command(invocation: Invocation, bundle: BundleOption = None) -> None:
        """Write a page of the plan: map, footprints, overlap, standard deviations of heights, profile of the flight.

        Example: orip plan show
        """
        from orip.planning.designed import forecast_of, planned_stations
        from orip.planning.page import plan_page
        from orip.planning.plan import frame_of
        from orip.workflow.project.outputs import TextOutput, write_output

        given = _given(invocation.folder, bundle)
        project = given.state.project
        stations = planned_stations(given)
        found = forecast_of(given, stations)
        frame = frame_of(given.camera, "height")  # along and across are x and y
        page = plan_page(
            f"Plan of {project.definition.name}", _facts(given, found), stations, frame, given.terrain, found
        )
        path = project.results / f"{project.definition.control_files}_plan_report.html"
        write_output(project, TextOutput(path, lambda: [page], "free the file, then repeat the command"))
        if invocation.terminal.json:
            invocation.terminal.document("plan-show", {"command": "plan show", "file": project.shown(path)})
            return
        invocation.terminal.say(f"plan     {project.shown(path)} written")


def _register_make(group: typer.Typer) -> None:
    @command(group, "make")
    def make_command(
        invocation: Invocation, bundle: BundleOption = None, force: ForceOption = False, dry_run: DryRunOption = False
    ) -> None:
        """Plan the exposures that [plan] of orip.toml asks for; write them into the .PLAN file.

        Example: orip plan make
        """
        from orip.planning.designed import made_plan, plan_text
        from orip.workflow.project.outputs import TextOutput, write_output

        given = _given(invocation.folder, bundle)
        plan = made_plan(given)
        project = given.state.project
        if not dry_run:
            text = plan_text(plan)
            _require_unedited(given, text, force)
            write_output(project, TextOutput(given.path, lambda: [text], "free the file, then repeat the command"))
        _tell_plan(invocation.terminal, plan, project.shown(given.path), project.definition.ground_unit, dry_run)


def _register_forecast(group: typer.Typer) -> None:
    @command(group, "forecast", reads_only=True)
    def forecast_command(invocation: Invocation, bundle: BundleOption = None) -> None:
        """Forecast precision and reliability of the exposures in the .PLAN file, as an adjustment would give them.

        Control and check points of the .PNT file take part wherever a photo shows them.

        Example: orip plan forecast
        """
        from orip.planning.designed import forecast_of, planned_stations

        given = _given(invocation.folder, bundle)
        found = forecast_of(given, planned_stations(given))
        _tell_forecast(invocation.terminal, given, found)


def _register_compare(group: typer.Typer) -> None:
    @command(group, "compare", reads_only=True)
    def compare_command(
        invocation: Invocation,
        variant: Annotated[
            list[str] | None,
            typer.Option(
                "--variant", metavar="KEY=VALUE...", help="What is different: 'cross_strips=2 rtk=0.02'; repeat it."
            ),
        ] = None,
        bundle: BundleOption = None,
    ) -> None:
        """Compare variants of the plan in one table: precision, reliability, photos, minutes.

        Keys are those of [plan] that are numbers, and control=N (points at the best places), rtk=SD, unknown=C,A3.

        Example: orip plan compare --variant cross_strips=2 --variant "forward=70 side=30"
        """
        from orip.planning.designed import variant_of

        given = _given(invocation.folder, bundle)
        found = [variant_of(given, text) for text in ["", *(variant or [])]]
        _tell_variants(invocation.terminal, found, given)


def _register_place(group: typer.Typer) -> None:
    @command(group, "place", reads_only=True)
    def place_command(
        invocation: Invocation,
        count: Annotated[int, typer.Argument(metavar="NUMBER", min=1, help="Control points.")],
        goal: Annotated[
            str, typer.Option("--goal", metavar="WHAT", help="What is to fall most: largest, mean (sd), camera (C).")
        ] = "largest",
        places: Annotated[int, typer.Option("--places", min=3, max=2000, help="Candidates, about.")] = 300,
        bundle: BundleOption = None,
    ) -> None:
        """Find the places where control points help most; print them as lines of a .PNT file.

        Example: orip plan place 5 >> DRONE.PNT
        """
        from orip.planning.designed import place_control, planned_stations

        if goal not in _GOALS:
            message = f"--goal {goal}: write one of {', '.join(_GOALS)}"
            raise UsageError(message)
        chosen: Literal["largest", "mean", "camera"] = (
            "largest" if goal == "largest" else "mean" if goal == "mean" else "camera"
        )
        given = _given(invocation.folder, bundle)
        found = place_control(given, planned_stations(given), count, chosen, places)
        _tell_places(invocation.terminal, found, goal, given)


def _register_export(group: typer.Typer) -> None:
    @command(group, "export")
    def export_command(
        invocation: Invocation,
        form: Annotated[str, typer.Argument(metavar="FORMAT", help="See the text above.")],
        file: Annotated[Path, typer.Argument(metavar="FILE", help="What is written.")],
        bundle: BundleOption = None,
        force: ForceOption = False,
    ) -> None:
        """Write the planned exposures for pilots and maps.

        FORMAT is geojson, kml, kmz, gpx, csv, qgc (QGroundControl .plan), dji (WPML in a .kmz) or litchi (CSV).

        Example: orip plan export qgc flight.plan
        """
        from orip.planning.designed import planned_stations, require_other_file
        from orip.planning.outputs import FORMATS, exported
        from orip.workflow.project.outputs import TextOutput, require_replaceable, write_output

        if form not in FORMATS:
            message = f"{form} is no format; write one of {', '.join(FORMATS)}"
            raise UsageError(message)
        given = _given(invocation.folder, bundle)
        project = given.state.project
        path = project.folder / file
        data, said = exported(form, planned_stations(given), given)
        require_other_file(given, path)
        require_replaceable(project, path, force=force)
        write_output(project, TextOutput(path, lambda: [data], "free the file, then repeat the command"))
        if invocation.terminal.json:
            invocation.terminal.document(
                "plan-export", {"command": "plan export", "format": form, "file": project.shown(path), "heights": said}
            )
            return
        invocation.terminal.say(f"plan     {project.shown(path)} written; heights are {said}")


def _given(folder: Path, bundle: str | None) -> Given:
    from orip.planning.designed import given_plan
    from orip.workflow.project.state import read_checked_project

    return given_plan(read_checked_project(folder), bundle)


def _require_unedited(given: Given, text: str, force: bool) -> None:
    """Refuse to replace a plan that differs: someone may have edited it."""
    from orip.files.text.lines import existing_text

    there = existing_text(given.path, given.state.project.shown(given.path))
    if there is not None and there != text and not force:
        shown = given.state.project.shown(given.path)
        message = f"{shown} has another plan, which may have been edited; replace it with --force, or move it away"
        raise UsageError(message)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _tell_plan(terminal: Terminal, plan: PlannedFlight, shown: str, unit: str, dry_run: bool) -> None:
    if terminal.json:
        terminal.document(
            "plan",
            {
                "command": "plan make",
                "file": shown,
                "dry_run": dry_run,
                "photos": len(plan.stations),
                **{
                    key: _finite(getattr(plan, key))
                    for key in ("height", "pixel", "base", "spacing", "speed", "seconds")
                },
                "turns": plan.turns,
                "batteries": plan.batteries,
            },
        )
        return
    would = "would be " if dry_run else ""
    terminal.say(f"plan     {len(plan.stations)} photos {would}written to {shown}")
    terminal.say(f"         pixel {plan.pixel:.4g} {unit} on the ground, at {plan.height:.4g} {unit}")
    if plan.batteries:
        terminal.say(
            f"         base {plan.base:.4g}, spacing {plan.spacing:.4g} {unit}; {plan.speed:.3g} {unit}/s, "
            f"{plan.seconds / 60.0:.1f} minutes, {plan.turns} turns, {plan.batteries} batteries"
        )


def _figures(found: Forecast) -> dict[str, Any]:
    """Return the figures of a forecast that are told."""
    import numpy as np

    from orip.records.camera import CAMERA_PARAMETERS

    sd, residuals = found.point_sd, found.solution.residuals
    with np.errstate(invalid="ignore"):
        medians, largest = _columns(sd, "median"), _columns(sd, "max")
    photo = _columns(found.solution.photos.sd, "median")
    cameras = found.solution.cameras.sd[0]
    rows = 2 * len(found.solved.block.photo_points.photo)
    return {
        "point_sd_median": [_finite(value) for value in medians],
        "point_sd_largest": [_finite(value) for value in largest],
        "photo_sd_median": [_finite(value) for value in photo],
        "camera_sd": {
            name: _finite(float(value))
            for name, value in zip(CAMERA_PARAMETERS, cameras, strict=True)
            if name in found.solved.block.cameras[0].unknown
        },
        "redundancy": found.solution.redundancy,
        "redundancy_number_median": _finite(float(np.nanmedian(residuals.redundancy_number[:rows]))),
        "smallest_bias_mm": _finite(found.smallest_bias),
        "external": _finite(found.external),
        "not_determined": [f"{one.group} {one.name} {one.kind}" for one in found.solution.singular],
    }


def _columns(values: Any, what: Literal["median", "max"]) -> list[float]:
    """Return a figure of each column over what is determined."""
    import numpy as np

    kept = [column[np.isfinite(column)] for column in values.T]
    found = np.median if what == "median" else np.max
    return [float(found(column)) if len(column) else math.nan for column in kept]


def _tell_forecast(terminal: Terminal, given: Given, found: Forecast) -> None:
    if terminal.json:
        rows = [
            {"code": one.code, "where": one.where, "text": one.text, "remedy": one.remedy} for one in found.diagnosis
        ]
        terminal.document("plan-forecast", {"command": "plan forecast", **_figures(found), "diagnosis": rows})
        return
    lines = [f"{label:8} {text}" for label, text in _facts(given, found)]
    lines += [f"{one.text}; {one.remedy}" for one in found.diagnosis]
    terminal.data("\n".join(lines))


def _facts(given: Given, found: Forecast) -> list[tuple[str, str]]:
    """Return what a forecast says, each line with what it is about."""
    figures, solution = _figures(found), found.solution
    unit = given.state.project.definition.ground_unit
    facts = [
        (
            "block",
            (
                f"{len(solution.photos.names)} photos, {len(solution.points.names)} points, "
                f"redundancy {solution.redundancy}, each {_shown(figures['redundancy_number_median'])} (median)"
            ),
        ),
        (
            "points",
            (
                f"sd X Y Z  {_row(figures['point_sd_median'])} {unit} (median), "
                f"{_row(figures['point_sd_largest'])} (largest)"
            ),
        ),
        (
            "photos",
            (
                f"sd X0 Y0 Z0  {_row(figures['photo_sd_median'][:3])} {unit}; OMEGA PHI KAPPA "
                f"{_row(figures['photo_sd_median'][3:])} degrees (median)"
            ),
        ),
    ]
    if figures["camera_sd"]:
        parts = [f"{name} {_shown(value)}" for name, value in figures["camera_sd"].items()]
        facts.append(("camera", f"sd {', '.join(parts)}"))
    bias, external = _shown(figures["smallest_bias_mm"]), _shown(figures["external"])
    text = f"of {bias} mm are found in a photo point; undetected they move a result by {external} of its sd at most"
    return [*facts, ("blunders", f"{text} (medians)")]


def _row(values: list[float | None]) -> str:
    return " ".join(map(_shown, values))


def _shown(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _tell_variants(terminal: Terminal, found: list[Variant], given: Given) -> None:
    rows = []
    for variant in found:
        figures = _figures(variant.forecast)
        rows.append(
            {
                "variant": variant.name,
                "photos": len(variant.plan.stations),
                "minutes": variant.plan.seconds / 60.0,
                "point_sd_median": figures["point_sd_median"],
                "point_sd_largest": figures["point_sd_largest"],
                "camera_sd": figures["camera_sd"],
                "redundancy_number_median": figures["redundancy_number_median"],
                "smallest_bias_mm": figures["smallest_bias_mm"],
                "not_determined": figures["not_determined"],
            }
        )
    if terminal.json:
        terminal.document("plan-compare", {"command": "plan compare", "variants": rows})
        return
    unit = given.state.project.definition.ground_unit
    width = max(len(row["variant"]) for row in rows)
    head = f"{'variant':{width}}  photos  minutes  sd X Y Z (median, {unit})    largest Z  sd C (mm)  bias (mm)"
    lines = [head]
    for row in rows:
        median = " ".join(f"{_shown(value):>8}" for value in row["point_sd_median"])
        length = _shown(row["camera_sd"].get("C")) if "C" in row["camera_sd"] else "held"
        lines.append(
            f"{row['variant']:{width}}  {row['photos']:6d}  {row['minutes']:7.1f}  {median}  "
            f"{_shown(row['point_sd_largest'][2]):>9}  {length:>9}  {_shown(row['smallest_bias_mm']):>9}"
        )
    terminal.data("\n".join(lines))


def _tell_places(terminal: Terminal, found: PlacedControl, goal: str, given: Given) -> None:
    placement = found.placement
    points = [
        {"name": point.name, "coordinates": list(point.coordinates), "error": point.errors[0]} for point in found.points
    ]
    if terminal.json:
        content = {"command": "plan place", "goal": goal, "points": points}
        terminal.document("plan-place", {**content, "value": placement.value, "curve": list(placement.curve)})
        return
    unit = "mm" if goal == "camera" else given.state.project.definition.ground_unit
    for point in found.points:
        numbers = " ".join(f"{value:.3f}" for value in point.coordinates if value is not None)
        errors = " ".join(f"{error:g}" for error in point.errors if error is not None)
        terminal.data(f"{point.name}  {numbers}  {errors}")
    what = {"largest": "largest sd", "mean": "mean sd", "camera": "sd of C"}[goal]
    curve = ", ".join(f"{number}: {_shown(value)}" for number, value in enumerate(placement.curve))
    terminal.say(
        f"place    {what} {_shown(placement.value)} {unit} with these points; number: {what} of the best first: {curve}"
    )
