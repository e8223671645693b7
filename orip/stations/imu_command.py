"""`orip imu`: a smoothed trajectory with attitudes from inertial data and positions."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer
from msgspec.structs import asdict

from orip.cli.options import DryRunOption, Invocation, add_group, command
from orip.cli.terminal import warning_rows
from orip.errors import UsageError
from orip.stations.imu_noise_command import FormOptions, form_of, numbers_of, three_numbers

if TYPE_CHECKING:
    from collections.abc import Iterator

    from orip.arrays import FloatArray
    from orip.records.epochs import Epochs
    from orip.stations.inertial.dense import ImuResult
    from orip.stations.inertial.samples import ImuNoise


class ModelOptions(NamedTuple):
    """What is known of unit and antenna."""

    lever_arm: Annotated[
        str, typer.Option("--lever-arm", metavar="F,R,D", help="Unit to antenna: forward, right, down, m.")
    ] = "0,0,0"
    noise: Annotated[
        str,
        typer.Option(
            "--noise", metavar="GRADE", help="mems, tactical, navigation, or six numbers: see orip imu smooth --help."
        ),
    ] = "mems"
    as_given: Annotated[bool, typer.Option("--as-given", help="Do not estimate the noise from the data.")] = False
    rate: Annotated[float, typer.Option("--rate", metavar="HZ", help="Of the trajectory.", min=1.0, max=500.0)] = 50.0
    forward: Annotated[bool, typer.Option("--forward", help="Write that of the filter alone, not smoothed.")] = False


class EventOptions(NamedTuple):
    """When photos were taken, for stations and relative control."""

    events: Annotated[
        Path | None,
        typer.Option("--events", metavar="FILE", help="When photos were taken: writes .STA and .REL of the project."),
    ] = None
    photos: Annotated[
        Path | None,
        typer.Option("--photos", metavar="PATH", help="Times of photos: a table, or the folder of the image files."),
    ] = None
    names: Annotated[
        str | None, typer.Option("--names", metavar="PATTERN", help="Photos by the number of the event: 'DJI_{:04d}'.")
    ] = None
    offset: Annotated[
        float | None, typer.Option("--offset", metavar="SECONDS", help="Event less photo time; else found.")
    ] = None
    camera: Annotated[str | None, typer.Option("--camera", metavar="NAME", help="Camera of new photos.")] = None
    replace: Annotated[bool, typer.Option("--replace", help="Replace stations and differences that are there.")] = False


def register(app: typer.Typer) -> None:
    """Add the group of commands; without the name of one of them it is `smooth`."""
    text = (
        "Smooth a trajectory with attitudes from inertial data and positions; noise of a unit.\n\n"
        "'orip imu IMU GNSS' is 'orip imu smooth IMU GNSS'.\n\n"
        "Example: orip imu imu.csv flight.pos --mount 180,0,-90"
    )
    add_group(app, "imu", text, _register, default="smooth")


def _register(group: typer.Typer) -> None:
    from orip.stations.imu_noise_command import register_noise

    @command(group, "smooth")
    def smooth_command(
        invocation: Invocation,
        imu: Annotated[Path, typer.Argument(metavar="IMU", help="Samples of the unit: a table, or a log; also .gz.")],
        positions: Annotated[Path, typer.Argument(metavar="GNSS", help="Positions: a solution of RTKLIB (.pos).")],
        form: FormOptions,
        model: ModelOptions,
        exposures: EventOptions,
        output: Annotated[
            Path | None, typer.Option("--output", "-o", metavar="FILE", help="Instead of IMU.sbet.")
        ] = None,
        dry_run: DryRunOption = False,
    ) -> None:
        """Smooth a trajectory with attitudes from inertial data and positions; write SBET and SMRMSG.

        The body has its axes forward, to the right, down. The attitude at the beginning follows from what both have
        observed, without a magnetometer. Six numbers of --noise: gyroscope rad/s/sqrt(Hz), accelerometer
        m/s2/sqrt(Hz), random walks of their biases, first biases (rad/s, m/s2).

        With --events the photos of a project get exposure stations with the covariances of position and attitude
        (.STA) and the differences between successive exposures (.REL).

        Example: orip imu smooth imu.csv flight.pos --mount 180,0,-90 --lever-arm 0.1,0,-0.3
        """
        from orip.files.text.atomic import write_output
        from orip.stations.in_project import require_trajectory
        from orip.stations.inertial.processing import ImuFiles, process_imu

        folder = invocation.folder
        if model.forward and exposures.events is not None:
            message = "--forward is to compare with; stations and relative control (--events) need the smoother"
            raise UsageError(message)
        files = ImuFiles(
            folder / imu, folder / positions, form_of(form), _noise(model.noise),
            three_numbers("--lever-arm", model.lever_arm, 50.0), _time(form.time), model.rate, not model.as_given,
            _epochs(folder, exposures.events), model.forward,
        )  # fmt: skip
        target = folder / (output or Path(f"{imu.name.split('.')[0] or imu.name}.sbet"))
        deviations = target.with_suffix(".smrmsg")
        for path in (target, deviations):
            require_trajectory(path, (files.imu, files.positions))
        result = process_imu(files)
        if files.events is not None:
            _write_stations(invocation, result, files.events, exposures, dry_run=dry_run)
        if not dry_run:
            for path, data in ((deviations, result.smrmsg), (target, result.sbet)):
                write_output(path, data)
        _tell(invocation, result, target, dry_run=dry_run, has_events=files.events is not None)

    register_noise(group)


def _epochs(folder: Path, name: Path | None) -> Epochs | None:
    """Return the epochs of a file; None without a name."""
    if name is None:
        return None
    from orip.errors import Complaint, InputError
    from orip.stations.imported import read_epochs

    found = read_epochs(folder / name, name.name)
    if found.complaints:
        raise InputError(found.complaints)
    if not len(found.value):
        raise InputError([Complaint("there are no epochs in this file", name.name)])
    return found.value


def _write_stations(
    invocation: Invocation, result: ImuResult, events: Epochs, options: EventOptions, *, dry_run: bool
) -> None:
    from orip.stations.exposures import Matching
    from orip.stations.imported import ImportSettings
    from orip.stations.smoothed import import_smoothed
    from orip.workflow.project.commit import carry_out
    from orip.workflow.records.commands import read_records

    matching = Matching(options.names, options.offset)
    settings = ImportSettings(matching, camera=options.camera, replaces=options.replace)
    photo_times = _epochs(invocation.folder, options.photos)
    edit = partial(
        import_smoothed, result=result, events=events, photo_times=photo_times, settings=settings, dry_run=dry_run
    )
    outcome = carry_out(read_records(invocation.folder), edit).outcome
    invocation.terminal.warn(outcome.warnings)
    count, would = len(outcome.stations), "would be " if dry_run else ""
    base = outcome.shown.removesuffix(".STA")
    invocation.terminal.point("stations", f"{count} {would}written to {base}.STA, their differences to {base}.REL")


def _noise(text: str) -> ImuNoise:
    from orip.stations.inertial.processing import NOISES
    from orip.stations.inertial.samples import ImuNoise

    if text in NOISES:
        return NOISES[text]
    numbers = numbers_of(text)
    if len(numbers) != 6 or not np.all(np.array(numbers) > 0.0):
        message = f"--noise {text}: write one of {', '.join(NOISES)}, or six numbers above 0 (orip imu smooth --help)"
        raise UsageError(message)
    return ImuNoise(*numbers)


def _time(word: str | None) -> str:
    known = ("gps", "week", "unix-gps", "unix-utc")
    if word is not None and word not in known:
        message = f"--time {word}: write one of {', '.join(known)}"
        raise UsageError(message)
    return word or ""


def _tell(invocation: Invocation, result: ImuResult, target: Path, *, dry_run: bool, has_events: bool) -> None:
    terminal = invocation.terminal
    terminal.warn(result.warnings)
    if terminal.json:
        terminal.document("imu", _document(result, target, dry_run=dry_run))
        return
    for label, text in _lines(result):
        terminal.point(label, text)
    names = f"{target.name}, {target.with_suffix('.smrmsg').name}"
    terminal.point("would write" if dry_run else "wrote", names)
    if not (dry_run or has_events):
        own = f"orip stations import {target.name} --deviations {target.with_suffix('.smrmsg').name} --events FILE"
        terminal.point("next", own)


def _lines(result: ImuResult) -> Iterator[tuple[str, str]]:
    states = result.trajectory
    seconds = float(result.time[-1] - result.time[0])
    yield "imu", f"{seconds:.1f} s, {len(states.residual)} positions, times of the samples: {result.time_system}"
    course, change = np.degrees(states.alignment.deviation), states.alignment.change
    way = f"by velocity changes of {change:.1f} m/s" if np.isfinite(change) else "by gyrocompass, standing"
    yield "aligned", f"{way}; course to about {course:.1f} degrees"
    if states.standing:
        yield "standing", f"{states.standing} states stand: zero velocity is observed there"
    rms = 1000.0 * np.sqrt(np.mean(states.residual**2, axis=0))
    yield "residual", f"{rms[0]:.0f}, {rms[1]:.0f}, {rms[2]:.0f} mm RMS of the positions (east, north, up)"
    factors = states.factors
    others = f"of positions {factors.position:.2f}, of velocities {factors.velocity:.2f}"
    unit = f"of gyroscopes {factors.gyro:.2f} times what was given, of accelerometers {factors.accelerometer:.2f}"
    yield "noise", f"{unit}, {others}"
    tested = result.tested[np.isfinite(result.tested)]
    if len(tested):
        ratio = float(np.sqrt(np.mean(tested) / 3.0))
        yield "test", f"{len(tested)} positions differ from those predicted by {ratio:.2f} standard deviations"
    if result.is_forward:
        yield from _forward_lines(result)
    yield "sd", f"{_ranges(1000.0 * result.place_deviation, 1)} mm (east, north, up; median and largest)"
    angles = np.degrees(result.angle_deviation)
    yield "", f"{_ranges(angles, 4)} degrees (roll, pitch, heading; median and largest)"


def _forward_lines(result: ImuResult) -> Iterator[tuple[str, str]]:
    """Say how the filter differs from the smoother, and by what it should."""
    found = result.against_smoother()
    yield (
        "filter",
        f"from the smoother {1000.0 * found.place:.0f} mm and {np.degrees(found.attitude):.4f} degrees (RMS)",
    )
    yield "", f"{found.place_ratio:.2f} and {found.attitude_ratio:.2f} times what the standard deviations of both say"
    smoothed = np.degrees(found.smoothed_attitude)
    yield "", f"sd of the smoother {1000.0 * found.smoothed_place:.0f} mm and {smoothed:.4f} degrees"


def _ranges(values: FloatArray, decimals: int) -> str:
    middle, largest = np.median(values, axis=0), values.max(axis=0)
    return ", ".join(f"{one:.{decimals}f} to {other:.{decimals}f}" for one, other in zip(middle, largest, strict=True))


def _document(result: ImuResult, target: Path, *, dry_run: bool) -> dict[str, object]:
    states = result.trajectory
    factors = states.factors
    return {
        "command": "imu smooth",
        "files": [target.name, target.with_suffix(".smrmsg").name],
        "dry_run": dry_run,
        "time_system": result.time_system,
        "begin": float(result.time[0]),
        "end": float(result.time[-1]),
        "positions": len(states.residual),
        "residual_rms": np.sqrt(np.mean(states.residual**2, axis=0)).tolist(),
        "factors": asdict(factors),
        "place_sd": np.median(result.place_deviation, axis=0).tolist(),
        "forward": result.is_forward,
        "standing": states.standing,
        "innovations": None if np.isnan(result.tested).all() else float(np.sqrt(np.nanmean(result.tested) / 3.0)),
        "angle_sd": np.median(result.angle_deviation, axis=0).tolist(),
        "gyro_bias": states.gyro_bias[-1].tolist(),
        "accelerometer_bias": states.accelerometer_bias[-1].tolist(),
        "warnings": warning_rows(result.warnings),
    }
