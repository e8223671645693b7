"""`orip match`: tie points."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import BundleOption, ForceOption, Invocation, command
from orip.cli.terminal import Terminal, warning_rows

if TYPE_CHECKING:
    from orip.pictures.forecast import Forecast
    from orip.pictures.match import MatchOutcome


def register(app: typer.Typer) -> None:
    """Add the command."""

    @command(app, "match")
    def match_command(
        invocation: Invocation,
        images: Annotated[
            Path | None,
            typer.Option("--images", metavar="DIR", help="Images named as the photos (default: project folder)."),
        ] = None,
        points: Annotated[
            int, typer.Option("--points", metavar="N", min=10, max=10_000, help="Tie points of a photo, about.")
        ] = 300,
        features: Annotated[
            bool, typer.Option("--features", help="Places of the features, without least-squares matching.")
        ] = False,
        bundle: BundleOption = None,
        force: ForceOption = False,
    ) -> None:
        """Measure tie points in the images of the photos, and write them to TIES.MEA.

        Features (SIFT) are compared between photos and joined to points; least-squares matching gives each ray its
        coordinates and a-priori errors. What was found is kept in .orip-matching: a run that was killed goes on where
        it was.

        Example: orip match --images ../flight
        """
        from orip.pictures.match import MatchRequest, match_photos
        from orip.pictures.tie_points import TieSettings
        from orip.threads import limited_threads
        from orip.workflow.project.commit import commit
        from orip.workflow.records.commands import read_records

        state = read_records(invocation.folder)
        request = MatchRequest(
            state.project.bundle_name(bundle), images, TieSettings(points, refines=not features), replaces=force
        )
        with limited_threads(invocation.terminal.threads):
            change = match_photos(state, request, foreteller(invocation.terminal))
        tell(invocation.terminal, commit(change).outcome)


def foreteller(terminal: Terminal) -> Callable[[Forecast], None]:
    """Return what prints forecasts."""
    from orip.pictures.forecast import words

    return lambda forecast: terminal.say(f"forecast {words(forecast)}")


def tell(terminal: Terminal, outcome: MatchOutcome) -> None:
    """Print what was matched."""
    from orip.pictures.match import FATE_WORDS
    from orip.wording import counted

    terminal.warn(outcome.warnings)
    found = outcome.found
    rejected = {FATE_WORDS[fate]: count for fate, count in found.fates.items() if fate in FATE_WORDS}
    if terminal.json:
        terminal.document(
            "match",
            {
                "command": "match",
                "file": outcome.shown,
                "photos": [
                    {"name": name, "features": count, "rays": rays}
                    for name, count, rays in zip(outcome.photos, found.features, outcome.rays, strict=True)
                ],
                "pairs": found.pairs,
                "compared_pairs": found.compared,
                "tracks": found.joined,
                "contradictory_tracks": found.contradictory,
                "points": len(found.tracks),
                "rays": len(found.place),
                "rejected_rays": rejected,
                "error_factor": found.factor,
                "warnings": warning_rows(outcome.warnings),
            },
        )
        return
    terminal.say(f"match    {counted(len(outcome.photos), 'photo')}, {found.pairs} of {found.compared} pairs connected")
    terminal.say(
        f"         {counted(found.joined, 'track')}, {found.contradictory} more contradict themselves: left out"
    )
    if rejected:
        terminal.say(f"         rejected rays: {', '.join(f'{count} {word}' for word, count in rejected.items())}")
    if found.factor is not None:
        terminal.say(f"         a-priori errors are {found.factor:.2f} times those of the patches: so the rays fit")
    points, rays = len(found.tracks), len(found.place)
    terminal.say(f"         {counted(points, 'tie point')} with {counted(rays, 'ray')}")
    terminal.say(f"wrote    {outcome.shown}; 'orip run' adjusts it")
