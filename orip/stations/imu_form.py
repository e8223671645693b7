"""Options of `orip imu` on how the file of a unit is to be read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer

from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.stations.inertial.files import ImuForm


class FormOptions(NamedTuple):
    """How the file of the unit is to be read."""

    columns: Annotated[
        str | None, typer.Option("--columns", metavar="NAMES", help="Of time,fx,fy,fz,wx,wy,wz in order; -: not used.")
    ] = None
    force_unit: Annotated[str, typer.Option("--force-unit", metavar="UNIT", help="m/s2 or g.")] = "m/s2"
    rate_unit: Annotated[str, typer.Option("--rate-unit", metavar="UNIT", help="rad/s or deg/s.")] = "rad/s"
    mount: Annotated[
        str, typer.Option("--mount", metavar="R,P,Y", help="Roll, pitch, yaw of the unit on the body, degrees.")
    ] = "0,0,0"
    time: Annotated[
        str | None, typer.Option("--time", metavar="SYSTEM", help="gps, week, unix-gps, unix-utc; else what fits.")
    ] = None
    shift: Annotated[float, typer.Option("--shift", metavar="SECONDS", help="Added to the times of the samples.")] = 0.0


def form_of(options: FormOptions) -> ImuForm:
    """Return how a file of a unit is to be read."""
    from orip.stations.inertial.files import COLUMNS, FORCE_UNITS, RATE_UNITS, ImuForm

    names = () if options.columns is None else tuple(word.strip() for word in options.columns.split(","))
    if names and (set(names) - {*COLUMNS, "-"} or any(names.count(name) != 1 for name in COLUMNS)):
        message = f"--columns {options.columns}: write each of {','.join(COLUMNS)} once, and - for what is not used"
        raise UsageError(message)
    for option, unit, known in (
        ("--force-unit", options.force_unit, FORCE_UNITS), ("--rate-unit", options.rate_unit, RATE_UNITS),
    ):  # fmt: skip
        if unit not in known:
            message = f"{option} {unit}: write one of {', '.join(known)}"
            raise UsageError(message)
    mount = three_numbers("--mount", options.mount, 360.0)
    return ImuForm(names, options.force_unit, options.rate_unit, mount, options.shift)


def three_numbers(option: str, text: str, most: float) -> tuple[float, float, float]:
    """Return the numbers of an option, none larger than `most`; raises UsageError."""
    numbers = numbers_of(text)
    if len(numbers) != 3 or not np.all(np.abs(numbers) <= most):
        message = f"{option} {text}: write three numbers from {-most:g} to {most:g}, such as 0.1,0,-0.3"
        raise UsageError(message)
    return numbers[0], numbers[1], numbers[2]


def numbers_of(text: str) -> list[float]:
    """Return numbers between commas; NaN of what is none."""
    from orip.files.text.decimal_numbers import is_number, parse_number

    return [parse_number(part) if is_number(part) else np.nan for part in text.split(",")]
