"""`orip imu noise`: noise of a unit from a record in which it stands; options on how files of units are read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from orip.cli.options import Invocation, command
from orip.errors import Complaint, InputError

if TYPE_CHECKING:
    from orip.stations.inertial.allan import AxisNoise, StandingNoise


from typing import TYPE_CHECKING, NamedTuple

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


_PER_HOUR, _PER_ROOT_HOUR = 3600.0, 60.0
_MICRO_G = 9.80665e-6


def register_noise(group: typer.Typer) -> None:
    """Add the command."""

    @command(group, "noise", reads_only=True)
    def noise_command(
        invocation: Invocation,
        imu: Annotated[Path, typer.Argument(metavar="IMU", help="Samples of the unit: a table, also .gz.")],
        form: FormOptions,
    ) -> None:
        """Noise of a unit from a record in which it stands still: Allan variance, and what --noise needs.

        The longer the better: random walk shows within minutes, bias instability and the walk of biases in hours.

        Example: orip imu noise standing.csv --rate-unit deg/s
        """
        from orip.stations.inertial.allan import is_long_enough, moved_at, standing_noise
        from orip.stations.inertial.files import read_imu

        path = invocation.folder / imu
        read = read_imu(path, path.name, form_of(form))
        if read.complaints:
            raise InputError(read.complaints)
        if not is_long_enough(read.value):
            seconds = float(read.value.time[-1] - read.value.time[0])
            text = f"the record lasts {seconds:.0f} s; 120 s are needed, and hours are better"
            raise InputError([Complaint(text, path.name)])
        moved = moved_at(read.value)
        if moved is not None:
            text = f"the unit moves {moved:.0f} s after the beginning; give a part in which it stands all the time"
            raise InputError([Complaint(text, path.name)])
        _tell(invocation, standing_noise(read.value), path)


def _tell(invocation: Invocation, found: StandingNoise, path: Path) -> None:
    terminal, settings = invocation.terminal, found.settings()
    values = [float(getattr(settings, name)) for name in settings.__struct_fields__]
    if terminal.json:
        document = {
            "command": "imu noise",
            "file": path.name,
            "duration": found.duration,
            "gyro": [_row(axis) for axis in found.gyro],
            "accelerometer": [_row(axis) for axis in found.accelerometer],
            "gyro_mean": found.gyro_mean.tolist(),
            "force_mean": found.force_mean.tolist(),
            "noise": values,
        }
        terminal.document("imu-noise", document)
        return
    terminal.point("record", f"{found.duration:.0f} s, standing; averages of {found.gyro[0].tau[-1]:.0f} s at most")
    for label, text in _lines(found):
        terminal.point(label, text)
    numbers = ",".join(f"{value:.3g}" for value in values)
    terminal.point("use", f"--noise {numbers}")
    terminal.point("", f"in orip.toml: noise = [{numbers.replace(',', ', ')}]")


def _row(axis: AxisNoise) -> dict[str, object]:
    return {
        "random_walk": axis.random_walk,
        "instability": axis.instability,
        "bias_walk": axis.bias_walk,
        "tau": axis.tau.tolist(),
        "deviation": axis.deviation.tolist(),
    }


def _lines(found: StandingNoise) -> Iterator[tuple[str, str]]:
    degree = np.pi / 180.0
    kinds: Sequence[tuple[str, tuple[AxisNoise, ...], tuple[float, str], tuple[float, str], tuple[float, str]]] = (
        ("gyros", found.gyro, (degree / _PER_ROOT_HOUR, "degrees/√h"), (degree / _PER_HOUR, "degrees/h"),
         (degree / _PER_HOUR / _PER_ROOT_HOUR, "degrees/h/√h")),
        ("forces", found.accelerometer, (_MICRO_G, "µg/√Hz"), (_MICRO_G, "µg"), (_MICRO_G / _PER_ROOT_HOUR, "µg/√h")),
    )  # fmt: skip
    for label, axes, white, flat, walk in kinds:
        yield label, f"random walk {_three([axis.random_walk for axis in axes], *white)} (forward, right, down)"
        yield "", f"bias instability {_three([axis.instability for axis in axes], *flat)}"
        yield "", f"random walk of the bias {_three([axis.bias_walk for axis in axes], *walk)}"


def _three(values: Sequence[float], unit: float, name: str) -> str:
    return ", ".join(f"{value / unit:.3g}" if value > 0.0 else "none seen" for value in values) + f" {name}"
