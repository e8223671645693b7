"""`orip plan follow`: a flight beside its plan while it is flown, from what its receiver says."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from orip.cli.options import BundleOption, Invocation, command
from orip.errors import InputError, UsageError
from orip.wording import first_names

if TYPE_CHECKING:
    from orip.arrays import FloatArray
    from orip.planning.designed import Given
    from orip.planning.following.progress import Progress
    from orip.planning.following.receiver import Fix

_NAMED = 8
_HEIGHTS = ("sea", "ellipsoid")


def register_follow(group: typer.Typer) -> None:
    """Add the command."""

    @command(group, "follow", reads_only=True)
    def follow_command(
        invocation: Invocation,
        source: Annotated[
            str, typer.Argument(metavar="SOURCE", help="NMEA lines: a file, -, tcp://HOST:PORT, or a serial device.")
        ],
        heights: Annotated[
            str, typer.Option("--heights", metavar="WHAT", help="Z of the plan is above the sea or the ellipsoid.")
        ] = "sea",
        within: Annotated[
            float | None,
            typer.Option("--within", min=1e-3, help="How far beside its plan an exposure counts as flown."),
        ] = None,
        baud: Annotated[int, typer.Option("--baud", min=1, help="Speed of a serial line.")] = 9600,
        page: Annotated[bool, typer.Option("--page", help="Show the flight on a page in the browser too.")] = False,
        bundle: BundleOption = None,
    ) -> None:
        """Follow a flight beside its plan: which exposures are flown, what comes next, what has been missed.

        An exposure is flown where the receiver passes it within a quarter of base or spacing (see --within). It ends
        with SOURCE, or with Ctrl-C.

        Example: orip plan follow /dev/ttyUSB0 --baud 38400 --page
        """
        from orip.planning.designed import planned_stations, read_plan
        from orip.planning.following.progress import begin_flight
        from orip.planning.following.receiver import lines_of

        if heights not in _HEIGHTS:
            message = f"--heights {heights}: write one of {', '.join(_HEIGHTS)}"
            raise UsageError(message)
        given = read_plan(invocation.folder, bundle)
        stations = planned_stations(given)
        placed = _placing(given, stations[0].position, heights)
        progress = begin_flight(stations, within)
        wrong = 0
        unit = given.state.project.definition.ground_unit
        invocation.terminal.say(
            f"follow   {len(stations)} exposures, flown where passed within {progress.flight.within:.3g} {unit}; "
            f"Z is above the {heights}"
        )
        with _shown(invocation, progress, unit, page=page) as show, lines_of(source, invocation.folder, baud) as lines:
            try:
                for fix in _fixes(lines):
                    if fix is None:
                        wrong += 1
                        continue
                    before, progress = progress, _moved(progress, placed(fix))
                    show(progress, fix)
                    _tell_passed(invocation, before, progress, unit)
            except KeyboardInterrupt:
                pass  # the way to end
        _tell_end(invocation, progress, wrong)


def _fixes(lines: Iterable[str]) -> Iterator[Fix | None]:
    """Yield positions; None for each line that is damaged."""
    from orip.planning.following.receiver import read_fix

    for line in lines:
        try:
            fix = read_fix(line)
        except ValueError:
            yield None
        else:
            if fix is not None:
                yield fix


def _moved(progress: Progress, place: FloatArray) -> Progress:
    import numpy as np

    from orip.planning.following.progress import move_to

    return move_to(progress, place) if np.isfinite(place).all() else progress


def _placing(given: Given, origin: tuple[float, float, float], heights: str) -> Callable[[Fix], FloatArray]:
    """Return what takes a position to the project's system.

    Raises
    ------
    InputError
        If the project has no crs.
    """
    import numpy as np

    from orip.geometry.ground_crs import ground_crs

    definition = given.state.project.definition
    if definition.crs is None:
        message = "the receiver says longitude and latitude, but the project has no crs; give crs in [project]"
        raise InputError.single(message, "orip.toml")
    system = ground_crs(definition.crs, definition.ground_unit, np.array(origin))

    def placed(fix: Fix) -> FloatArray:
        height = fix.height + fix.separation if heights == "ellipsoid" else fix.height
        place = system.from_geographic(np.array([[np.radians(fix.longitude), np.radians(fix.latitude), height]]))[0]
        if heights == "sea":
            place[2] = height / system.metres_per_unit
        return np.asarray(place)

    return placed


@contextmanager
def _shown(
    invocation: Invocation, progress: Progress, unit: str, *, page: bool
) -> Iterator[Callable[[Progress, Fix], None]]:
    """Serve the page meanwhile, where it is wanted; give what shows how far the flight is."""
    if not page:
        yield lambda _progress, _fix: None
        return
    from orip.planning.following.progress import FollowedFlight
    from orip.web.serving import served_meanwhile

    flight = FollowedFlight(progress, unit)
    with served_meanwhile(flight) as address:
        invocation.terminal.say(f"the flight can be watched at {address}")
        yield flight.show


def _tell_passed(invocation: Invocation, before: Progress, now: Progress, unit: str) -> None:
    changed = [
        (name, new) for name, old, new in zip(now.flight.names, before.states, now.states, strict=True) if old != new
    ]
    if not changed:
        return
    beside, number = now.beside(), now.next
    ahead = (
        ""
        if beside is None or number is None
        else (
            f"; next {now.flight.names[number]} in {beside.ahead:.1f} {unit}, "
            f"{abs(beside.right):.1f} {'right' if beside.right >= 0.0 else 'left'}, "
            f"{abs(beside.above):.1f} {'above' if beside.above >= 0.0 else 'below'}"
        )
    )
    said = ", ".join(f"{name} {state}" for name, state in changed)
    invocation.terminal.say(f"follow   {said}{ahead}")


def _tell_end(invocation: Invocation, progress: Progress, wrong: int) -> None:
    flown, missed, left = (progress.of(state) for state in ("flown", "missed", "planned"))
    if invocation.terminal.json:
        content = {"command": "plan follow", "flown": list(flown), "missed": list(missed), "left": list(left)}
        invocation.terminal.document("plan-follow", {**content, "damaged_lines": wrong})
        return
    lines = [f"{len(flown)} exposures flown, {len(missed)} missed, {len(left)} left"]
    if missed:
        lines.append(f"missed: {first_names(missed, _NAMED)}")
    if wrong:
        lines.append(f"{wrong} lines were damaged, and not read")
    invocation.terminal.data("\n".join(lines))
