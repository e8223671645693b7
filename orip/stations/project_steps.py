"""Steps of `orip run` and `orip status` with `[gnss]`, `[gnss_network]` or `[imu]`: from receivers' files to control.

What they write says what it was made from: a digest of the files and settings, in a comment of `NAME.pos` and of the
.STA and .PNT files. A step whose digest is another now is out of date.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.control.stations_text import read_stations
from orip.files.stores.digest import record_digest
from orip.files.text.atomic import write_output
from orip.files.text.lines import read_lines
from orip.files.text.regular_file import file_digest
from orip.files.text.shown import Parsed
from orip.records.epochs import Epochs
from orip.records.names import record_key
from orip.records.receivers import EventSettings, GnssSettings, ImuSettings, NetworkSettings
from orip.stations.exposures import Matching
from orip.stations.imported import (
    ImportedStations,
    ImportFiles,
    ImportSettings,
    has_rolling_shutter,
    import_stations,
    read_epochs,
)
from orip.structs import replace
from orip.wording import agreeing, first_names
from orip.workflow.project.commit import Change, commit
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import Step
from orip.workflow.project.state import ProjectState
from orip.workflow.records.initialise import INITIALISED_FROM

T = TypeVar("T")

_MARK = "orip run, from"
"""Before the digest of what an output was made from."""


class Processed(NamedTuple):
    """A step that was done: its label, what is said of it, and what is doubtful."""

    label: str
    text: str
    warnings: tuple[ProjectWarning, ...]


class _Task(Struct, frozen=True):
    """A step: its command, what it reads and is set to, and the text that says what that was made from."""

    command: str
    files: tuple[Path, ...]
    settings: GnssSettings | ImuSettings | NetworkSettings
    output: Path
    wants_motions: bool = False


def station_steps(state: ProjectState) -> Iterator[Step]:
    """Yield whether positions and stations have to be computed."""
    for task in _tasks(state.project):
        missing = [path for path in task.files if not path.exists() and path != solution_of_project(state.project)]
        if missing:
            text = f"{state.project.shown(missing[0])} is not there; copy it, or correct orip.toml"
            yield Step(task.command, "missing", text, "orip run")
        elif not task.output.exists() or _made_from(task.output) is None:
            yield Step(task.command, "missing", f"{state.project.shown(task.output)} has not been computed", "orip run")
        elif _made_from(task.output) != _digest(task):
            text = "files or settings have changed since"
            yield Step(task.command, "out of date", text, "orip run")
        else:
            yield Step(task.command, "up to date", f"{state.project.shown(task.output)} is of these files")


def process_stations(state: ProjectState) -> Iterator[Processed]:
    """Do the steps that are out of date; yield what was done.

    Raises
    ------
    InputError
        With what is wrong with the files.
    """
    for task in _tasks(state.project):
        if task.output.exists() and _made_from(task.output) == _digest(task):
            continue
        if isinstance(task.settings, NetworkSettings):
            yield _marks(state.read_again(*INITIALISED_FROM), task, task.settings)
        elif isinstance(task.settings, GnssSettings) and task.output == solution_of_project(state.project):
            yield _positions(state.project, task, task.settings)
        else:
            yield _stations(state.read_again(*INITIALISED_FROM), task, task.settings)


def solution_of_project(project: ProjectFolder) -> Path:
    """Return where the positions of `[gnss]` are written."""
    return project.folder / f"{project.definition.project_files}.pos"


def _tasks(project: ProjectFolder) -> Iterator[_Task]:
    gnss, imu, network = project.definition.gnss, project.definition.imu, project.definition.gnss_network
    if network is not None:
        names = (*network.marks, *network.orbits, *([network.antex] if network.antex else []))
        points = project.folder / f"{project.definition.control_files}.PNT"
        yield _Task("orip gnss network", tuple(project.folder / name for name in names), network, points)
    stations = project.folder / f"{project.definition.control_files}.STA"
    solution = solution_of_project(project)
    if gnss is not None:
        names = (gnss.rover, gnss.base, *gnss.orbits, *([gnss.antex] if gnss.antex else []))
        files = [project.folder / name for name in names]
        yield _Task("orip gnss", tuple(files), gnss, solution)
    last = imu or gnss
    if last is None or not last.events:
        return
    events = [project.folder / name for name in (last.events, last.photo_times) if name]
    if imu is None:
        yield _Task("orip stations import", (solution, *events), last, stations, has_rolling_shutter(project))
        return
    positions = project.folder / imu.positions if imu.positions else solution
    samples = project.folder / imu.samples
    yield _Task("orip imu", (samples, positions, *events), imu, stations, has_rolling_shutter(project))


def _digest(task: _Task) -> str:
    """Return the digest of files and settings; of a folder its names."""
    parts = []
    for path in task.files:
        if path.is_dir():
            parts.append((path.name, *sorted(entry.name for entry in path.iterdir())))
        else:
            parts.append((path.name, file_digest(path) if path.is_file() else ""))
    wanted = ("motions",) if task.wants_motions else ()
    return record_digest((tuple(parts), task.settings, task.command, *wanted))


def _made_from(path: Path) -> str | None:
    """Return the digest that an output says; None where it says none."""
    for line in read_lines(path, path.name).value:
        if line.startswith(("%", "!")) and _MARK in line:
            return line.rpartition(_MARK)[2].strip()
    return None


def _positions(project: ProjectFolder, task: _Task, settings: GnssSettings) -> Processed:
    from orip.stations.gnss.processing import GnssFiles, process_gnss
    from orip.stations.in_project import require_solution

    rover, base, *orbits = task.files[: len(settings.orbits) + 2]
    require_solution(task.output, task.files)
    files = GnssFiles(
        rover, base, tuple(orbits), settings.way, settings.base_place, settings.rover_height, settings.base_height,
        settings.elevation, settings.systems, settings.frequencies,
        project.folder / settings.antex if settings.antex else None, settings.rover_antenna, settings.base_antenna,
    )  # fmt: skip
    result = process_gnss(files)
    write_output(task.output, f"{result.text}% {_MARK} {_digest(task)}\n")
    solution = result.joined.solution
    fixed = int(solution.is_fixed.sum())
    text = f"{len(solution)} positions, {fixed} fixed, in {project.shown(task.output)}"
    return Processed("gnss", text, result.warnings)


def _marks(state: ProjectState, task: _Task, settings: NetworkSettings) -> Processed:
    """Write the marks of a network into the control points, in the place of those that were written before."""
    from orip.stations.gnss.network_processing import process_network
    from orip.stations.gnss.processing import GnssFiles
    from orip.stations.network_points import network_points

    project, place = state.project, settings.hold_place
    marks, orbits = task.files[: len(settings.marks)], task.files[len(settings.marks) :][: len(settings.orbits)]
    files = GnssFiles(
        marks[0], marks[0], orbits, "static", elevation=settings.elevation, systems=settings.systems,
        frequencies=settings.frequencies, antex=project.folder / settings.antex if settings.antex else None,
    )  # fmt: skip
    result = process_network(list(marks), None if place is None else (settings.hold, np.array(place)), files)
    # marks that stand there without having been computed are somebody's
    replaces = task.output.exists() and _made_from(task.output) is not None
    outcome = commit(_with_digest(network_points(state, result=result, replaces=replaces), task)).outcome
    text = f"{len(result.names)} marks by {len(result.pairs)} baselines in {', '.join(outcome.files)}"
    return Processed("network", text, (*result.warnings, *outcome.warnings))


def _stations(state: ProjectState, task: _Task, settings: GnssSettings | ImuSettings) -> Processed:
    """Write stations, and with an inertial unit the differences between them."""
    if isinstance(settings, ImuSettings):
        change, warnings = _smoothed(state, task, settings)
        relative = ", with the differences between them"
    else:
        change, warnings, relative = _imported(state, settings), (), ""
    outcome = commit(_with_digest(change, task)).outcome
    text = f"{len(outcome.stations)} in {outcome.shown}{relative}"
    return Processed("stations", text, (*warnings, *outcome.warnings, *_left_over(task.output, outcome)))


def _left_over(path: Path, outcome: ImportedStations) -> Iterator[ProjectWarning]:
    """Say which stations of the file were not computed now."""
    computed = {record_key(station.photo) for station in outcome.stations}
    names = [station.photo for station in read_stations(path, outcome.shown).value]
    others = [name for name in names if record_key(name) not in computed]
    if others:
        have = agreeing(len(others), "has a station", "have stations")
        remedy = f"take out what is wrong now: orip control stations kill {others[0]}"
        text = f"{first_names(others, 3)} {have} from an earlier run or from elsewhere; {remedy}"
        yield ProjectWarning("station-left", outcome.shown, text)


def _with_digest(change: Change[T], task: _Task) -> Change[T]:
    """Return a change whose output says what it was made from."""
    texts = tuple(
        replace(text, text=_marked(text.text, _digest(task))) if text.path == task.output else text
        for text in change.edited_texts
    )
    return replace(change, edited_texts=texts)


def _marked(text: str, digest: str) -> str:
    kept = [line for line in text.splitlines(keepends=True) if not (line.startswith("!") and _MARK in line)]
    return f"! {_MARK} {digest}\n" + "".join(kept)


def _imported(state: ProjectState, settings: EventSettings) -> Change[ImportedStations]:
    photo_times = Path(settings.photo_times) if settings.photo_times else None
    files = ImportFiles(Path(solution_of_project(state.project).name), Path(settings.events), photo_times)
    return import_stations(state, files, _import_settings(settings))


def _smoothed(
    state: ProjectState, task: _Task, settings: ImuSettings
) -> tuple[Change[ImportedStations], tuple[ProjectWarning, ...]]:
    """Return stations and differences, and what is doubtful of the trajectory."""
    from orip.stations.inertial.files import COLUMNS, ImuForm
    from orip.stations.inertial.processing import NOISES, ImuFiles, process_imu
    from orip.stations.inertial.samples import ImuNoise
    from orip.stations.smoothed import import_smoothed

    if not settings.positions and state.project.definition.gnss is None:
        message = '[imu] needs positions: name a solution of RTKLIB, positions = "flight.pos", or write [gnss] too'
        raise InputError([Complaint(message, state.project.shown(state.project.text))])
    names = settings.columns
    if names and (set(names) - {*COLUMNS, "-"} or any(names.count(name) != 1 for name in COLUMNS)):
        message = f"columns of [imu] name each of {', '.join(COLUMNS)} once, and '-' what is not used"
        raise InputError([Complaint(message, state.project.shown(state.project.text))])
    form = ImuForm(names, settings.force_unit, settings.rate_unit, settings.mount, settings.shift)
    noise = NOISES[settings.grade] if settings.noise is None else ImuNoise(*settings.noise)
    samples, positions, *events = task.files
    times = [_epochs(path, state.project.shown(path)) for path in events]
    system = "" if settings.time == "fitting" else settings.time
    files = ImuFiles(
        samples, positions, form, noise, settings.lever_arm, system, estimates_noise=not settings.as_given,
        events=times[0],
    )  # fmt: skip
    photo_times = times[1] if len(times) > 1 else None
    result = process_imu(files)
    change = import_smoothed(state, result, times[0], photo_times, _import_settings(settings), dry_run=False)
    return change, result.warnings


def _import_settings(settings: EventSettings) -> ImportSettings:
    matching = Matching(settings.photo_names or None, settings.event_offset)
    return ImportSettings(matching, replaces=True)


def _epochs(path: Path, shown: str) -> Epochs:
    found: Parsed[Epochs] = read_epochs(path, shown)
    complaints: Sequence[Complaint] = found.complaints
    if not complaints and not len(found.value):
        complaints = (Complaint("there are no epochs in this file", shown),)
    if complaints:
        raise InputError(complaints)
    return found.value
