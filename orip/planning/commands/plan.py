"""`orip plan`: make a plan, forecast what it will know, show and export it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import BundleOption, DryRunOption, ForceOption, Invocation, add_group, command
from orip.cli.terminal import Terminal
from orip.errors import UsageError
from orip.planning.commands.after import register_after
from orip.planning.commands.choice import register_compare, register_place

if TYPE_CHECKING:
    from orip.planning.designed import Given
    from orip.planning.forecast import Forecast
    from orip.planning.plan import PlannedFlight


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    text = "Plan a flight or a network, and forecast its precision.\n\nExample: orip plan make; orip plan forecast"
    add_group(app, "plan", text, _register)


def _register(group: typer.Typer) -> None:
    _register_make(group)
    _register_forecast(group)
    register_compare(group)
    register_place(group)
    _register_export(group)
    register_after(group)
    _register_show(group)


def _register_show(group: typer.Typer) -> None:
    @command(group, "show")
    def show_command(invocation: Invocation, bundle: BundleOption = None) -> None:
        """Write a page of the plan: map, footprints, overlap, standard deviations of heights, profile of the flight.

        Example: orip plan show
        """
        from orip.planning.designed import forecast_of, outline_of, planned_stations, read_plan
        from orip.planning.forecast_figures import facts_of
        from orip.planning.page import plan_page
        from orip.planning.plan import frame_of
        from orip.workflow.project.outputs import TextOutput, write_output

        given = read_plan(invocation.folder, bundle)
        project = given.state.project
        stations = planned_stations(given)
        found = forecast_of(given, stations)
        frame = frame_of(given.camera, "height")  # along and across are x and y
        is_area = given.settings.kind == "flight" and given.settings.corridor == 0.0
        border = outline_of(given) if is_area else None
        page = plan_page(
            f"Plan of {project.definition.name}", facts_of(found, project.definition.ground_unit), stations, frame,
            given.terrain, found, border,
        )  # fmt: skip
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
        from orip.planning.designed import made_plan, plan_text, read_plan
        from orip.planning.plan import size_warnings
        from orip.workflow.project.outputs import TextOutput, write_output

        given = read_plan(invocation.folder, bundle)
        plan = made_plan(given)
        project = given.state.project
        invocation.terminal.warn(size_warnings(given.settings, project.definition.ground_unit))
        if not dry_run:
            text = plan_text(plan)
            _require_unedited(given, text, force)
            write_output(project, TextOutput(given.path, lambda: [text], "free the file, then repeat the command"))
        _tell_plan(invocation.terminal, plan, project.shown(given.path), project.definition.ground_unit, dry_run)


def _register_forecast(group: typer.Typer) -> None:
    @command(group, "forecast", reads_only=True)
    def forecast_command(
        invocation: Invocation,
        flown: Annotated[
            bool, typer.Option("--flown", help="Of the stations in the .STA file: what was flown of the plan.")
        ] = False,
        bundle: BundleOption = None,
    ) -> None:
        """Forecast precision and reliability of the exposures in the .PLAN file, as an adjustment would give them.

        Control and check points of the .PNT file take part wherever a photo shows them.

        Example: orip plan forecast
        """
        from orip.planning.designed import forecast_of, logged_stations, planned_stations, read_plan
        from orip.planning.flown import as_flown

        given = read_plan(invocation.folder, bundle)
        stations = planned_stations(given)
        if flown:
            stations = as_flown(stations, logged_stations(given))
        _tell_forecast(invocation.terminal, given, forecast_of(given, stations))


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
        from orip.planning.designed import planned_stations, read_plan, require_other_file
        from orip.planning.outputs import FORMATS, exported
        from orip.workflow.project.outputs import TextOutput, require_replaceable, write_output

        if form not in FORMATS:
            message = f"{form} is no format; write one of {', '.join(FORMATS)}"
            raise UsageError(message)
        given = read_plan(invocation.folder, bundle)
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


def _require_unedited(given: Given, text: str, force: bool) -> None:
    """Refuse to replace a plan that differs: someone may have edited it."""
    from orip.files.text.lines import existing_text

    there = existing_text(given.path, given.state.project.shown(given.path))
    if there is not None and there != text and not force:
        shown = given.state.project.shown(given.path)
        message = f"{shown} has another plan, which may have been edited; replace it with --force, or move it away"
        raise UsageError(message)


def _tell_plan(terminal: Terminal, plan: PlannedFlight, shown: str, unit: str, dry_run: bool) -> None:
    from orip.planning.forecast_figures import finite

    if terminal.json:
        terminal.document(
            "plan",
            {
                "command": "plan make",
                "file": shown,
                "dry_run": dry_run,
                "photos": len(plan.stations),
                **{
                    key: finite(getattr(plan, key))
                    for key in ("height", "pixel", "base", "spacing", "speed", "seconds")
                },
                "turns": plan.turns,
                "batteries": plan.batteries,
                "rays": plan.rays,
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
    if plan.rays:
        terminal.say(f"         each point is shown by {plan.rays} convergent photos at least")


def _tell_forecast(terminal: Terminal, given: Given, found: Forecast) -> None:
    from orip.planning.forecast_figures import facts_of, figures_of

    if terminal.json:
        rows = [
            {"code": one.code, "where": one.where, "text": one.text, "remedy": one.remedy} for one in found.diagnosis
        ]
        terminal.document("plan-forecast", {"command": "plan forecast", **figures_of(found), "diagnosis": rows})
        return
    lines = [f"{label:8} {text}" for label, text in facts_of(found, given.state.project.definition.ground_unit)]
    lines += [f"{one.text}; {one.remedy}" for one in found.diagnosis]
    terminal.data("\n".join(lines))
