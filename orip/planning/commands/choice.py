"""`orip plan compare` and `orip plan place`: which variant, and what is to be added where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, cast, get_args

import typer

from orip.cli.options import BundleOption, Invocation, command
from orip.cli.terminal import Terminal
from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.bundle.additions.placing import Placed, Wanted
    from orip.planning.designed import Given
    from orip.planning.variants import Variant


def register_compare(group: typer.Typer) -> None:
    """Add `orip plan compare`."""

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
        from orip.planning.designed import read_plan
        from orip.planning.variants import variant_of

        given = read_plan(invocation.folder, bundle)
        found = [variant_of(given, text) for text in ["", *(variant or [])]]
        _tell_variants(invocation.terminal, found, given)


def register_place(group: typer.Typer) -> None:
    """Add `orip plan place`."""

    @command(group, "place", reads_only=True)
    def place_command(
        invocation: Invocation,
        count: Annotated[int, typer.Argument(metavar="NUMBER", min=1, help="How many.")],
        what: Annotated[
            str, typer.Option("--what", metavar="WHAT", help="What is added: control, check, distances, photos.")
        ] = "control",
        goal: Annotated[
            str, typer.Option("--goal", metavar="GOAL", help="What is to fall most: largest, mean (sd), camera (C).")
        ] = "largest",
        adjusted: Annotated[
            bool, typer.Option("--adjusted", help="Of the bundle as measured, not of the plan.")
        ] = False,
        error: Annotated[
            float | None, typer.Option("--error", min=1e-9, help="A-priori error; control_error of [plan] otherwise.")
        ] = None,
        longest: Annotated[
            float | None, typer.Option("--longest", min=1e-9, help="Distances of this length at most.")
        ] = None,
        places: Annotated[int, typer.Option("--places", min=3, max=2000, help="Points that are judged, about.")] = 300,
        bundle: BundleOption = None,
    ) -> None:
        """Find where control points, check points, distances or photos help most; print them as lines of a text.

        The lines are those of a .PNT, .LEN or .STA file (photos: of a .PLAN file). Check points stand where the block
        is known least.

        Example: orip plan place 5 >> DRONE.PNT; orip plan place 2 --what distances --adjusted
        """
        from orip.bundle.additions.placing import USUAL_ERROR, Wanted, What, place_in_block
        from orip.bundle.additions.search import Criterion
        from orip.planning.designed import planned_stations, read_plan
        from orip.planning.variants import place_in_plan, solved_bundle

        for option, given_word, known in (("--what", what, get_args(What)), ("--goal", goal, get_args(Criterion))):
            if given_word not in known:
                message = f"{option} {given_word}: write one of {', '.join(known)}"
                raise UsageError(message)
        if longest is not None and what != "distances":
            message = "--longest is for --what distances"
            raise UsageError(message)
        given = None if adjusted else read_plan(invocation.folder, bundle)
        usual = USUAL_ERROR if given is None else given.settings.control_error
        wanted = Wanted(cast("What", what), count, cast("Criterion", goal), places, error or usual, longest)
        if given is None:
            solved, unit = solved_bundle(invocation.folder, bundle)
            found = place_in_block(solved, wanted)
        else:
            unit = given.state.project.definition.ground_unit
            found = place_in_plan(given, planned_stations(given), wanted)
        _tell_places(invocation.terminal, found, wanted, unit)


def _tell_variants(terminal: Terminal, found: list[Variant], given: Given) -> None:
    from orip.planning.forecast_figures import figures_of, short

    rows = []
    for variant in found:
        figures = figures_of(variant.forecast)
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
        median = " ".join(f"{short(value):>8}" for value in row["point_sd_median"])
        length = short(row["camera_sd"].get("C")) if "C" in row["camera_sd"] else "held"
        lines.append(
            f"{row['variant']:{width}}  {row['photos']:6d}  {row['minutes']:7.1f}  {median}  "
            f"{short(row['point_sd_largest'][2]):>9}  {length:>9}  {short(row['smallest_bias_mm']):>9}"
        )
    for variant in found:
        if variant.forecast.held:
            held = ", ".join(variant.forecast.held)
            lines.append(f"{variant.name}: nothing determines {held}; its row is as if {held} were known")
    terminal.data("\n".join(lines))


def _tell_places(terminal: Terminal, found: Placed, wanted: Wanted, unit: str) -> None:
    from orip.bundle.additions.placing import told
    from orip.files.control.stations_text import stations_text
    from orip.files.control.text import distances_text, points_text
    from orip.planning.forecast_figures import short

    placement = found.placement
    if terminal.json:
        terminal.document("plan-place", {"command": "plan place", **told(found, wanted)})
        return
    text = points_text(found.points)
    if found.distances:
        ends = "".join(f"! {line}\n" for line in text.splitlines())
        text = ends + distances_text(found.distances)
    text += stations_text(found.photos) if found.photos else ""
    terminal.data(text.rstrip("\n"))
    unit = "mm" if wanted.criterion == "camera" else unit
    what = {"largest": "largest sd", "mean": "mean sd", "camera": "sd of C"}[wanted.criterion]
    curve = ", ".join(f"{number}: {short(value)}" for number, value in enumerate(placement.curve))
    terminal.say(
        f"place    {what} {short(placement.value)} {unit} with these {_CALLED[wanted.what]}; "
        f"number: {what} of the best first: {curve}"
    )


_CALLED = {"control": "points", "check": "points as control", "distances": "distances", "photos": "photos"}
