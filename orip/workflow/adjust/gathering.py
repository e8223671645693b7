"""Gathering the input of a bundle's block from stores and control texts, and files that are not read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from orip.bundle.assemble import BlockInput
from orip.errors import UNREAD_FILE, InputError, ProjectWarning
from orip.files.text.decimal_numbers import control_texts_of_folder, tables_in_folder
from orip.records.coded_names import coded
from orip.records.control import Control
from orip.records.ground import TerrainModel
from orip.records.names import record_key
from orip.wording import first_names
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.texts import raise_complaints

_FEWEST = 2
"""Names that a table shares with the project; more than one, as a single one may be a number by chance."""

_MOST = 0.5
"""Part of the measured points that a table of control has at most: of all points it is a result."""

_NAMED = 3
_CONTROL = ".pnt"


def unread_files(bundle: BundleState, control: Control) -> Iterator[ProjectWarning]:
    """Yield a warning for each table of control points, or of projection centres, that the bundle has not.

    Parameters
    ----------
    bundle : BundleState
        With definitions and observations.
    control : Control
        What is read.
    """
    project = bundle.project
    measured = coded(bundle.observations.points).occurring()
    has_control = not {point.name for point in control.points}.isdisjoint(measured)
    photos = (
        {record_key(name): name for name in coded(bundle.observations.photos).occurring()}
        if not control.stations
        else {}
    )
    if has_control and not photos:
        return
    if not has_control:
        yield from _workbooks(project, bundle.name)
        yield from _without_points(project, bundle, control)
    known_points = frozenset[str]() if has_control else frozenset(measured)
    for path, names in tables_in_folder(project.folder).items():
        known = [name for name in names if name in known_points]
        placed = [photos[key] for name in names if (key := record_key(name.partition(".")[0])) in photos]
        base = project.control_base(bundle.name)
        if path.suffix.lower() == _CONTROL and not has_control and len(known) >= _FEWEST and path.stem != base:
            text = _of_another_name(known, path.stem, base)
        elif path.suffix.lower() == _CONTROL:
            continue
        elif not has_control and _FEWEST <= len(known) <= _MOST * len(measured):
            text = _text(known, "control", f"{base}.PNT (name X Y Z and their errors, separated by blanks)")
        elif len(placed) >= _FEWEST:
            text = _text(placed, "projection centres", f"{base}.STA, see 'orip stations import'")
        else:
            continue
        yield ProjectWarning(UNREAD_FILE, project.shown(path), text)


def _without_points(project: ProjectFolder, bundle: BundleState, control: Control) -> Iterator[ProjectWarning]:
    """Yield a warning of a file of control points that has none, where nothing else gives the ground system."""
    path = project.folder / f"{project.control_base(bundle.name)}.PNT"
    given = control.points or control.stations or control.elements or bundle.definition.datum == "free"
    if given or not path.exists():
        return
    text = (
        "there is no control point in this file; write each as a line, name X Y Z and their errors, separated by blanks"
    )
    yield ProjectWarning(UNREAD_FILE, project.shown(path), text)


_WORKBOOKS = frozenset({".xls", ".xlsx", ".ods"})


def _workbooks(project: ProjectFolder, bundle: str) -> Iterator[ProjectWarning]:
    """Yield a warning for each workbook in a folder whose control is nowhere else."""
    for path in sorted(project.folder.iterdir()):
        if path.suffix.lower() in _WORKBOOKS:
            text = (
                "this file is not read: workbooks are no texts, and the project has no control; save its control as "
                f"{project.control_base(bundle)}.PNT (name X Y Z and their errors, separated by blanks)"
            )
            yield ProjectWarning(UNREAD_FILE, project.shown(path), text)


def control_of_another_name(bundle: BundleState) -> Iterator[ProjectWarning]:
    """Yield a warning for each control text whose name is that of no bundle, and that names what is measured."""
    project = bundle.project
    base = project.control_base(bundle.name)
    bases = {base, project.control_base(), *project.control_of_bundles.values()}
    measured = {*coded(bundle.observations.points).occurring(), *coded(bundle.observations.photos).occurring()}
    for path, words in control_texts_of_folder(project.folder).items():
        own = f"{base}{path.suffix.upper()}"
        if path.stem in bases or (project.folder / own).exists() or len(words & measured) < _FEWEST:
            continue
        text = (
            f"this file is not read, but names points or photos of this project, whose control is in files called "
            f'{base}; rename it to {own}, or write control_files = "{path.stem}" in [project], for all control files'
        )
        yield ProjectWarning(UNREAD_FILE, project.shown(path), text)


def _of_another_name(names: Sequence[str], stem: str, base: str) -> str:
    return (
        f"this file is not read, but has coordinates of {first_names(names, _NAMED)}: the project's control is in "
        f'files called {base}; rename it to {base}.PNT, or write control_files = "{stem}" in [project]'
    )


def _text(names: Sequence[str], what: str, where: str) -> str:
    return (
        f"this file is not read, but has coordinates of {first_names(names, _NAMED)}, which have no {what} in this "
        f"project; {what} belong{'s' if what == 'control' else ''} into {where}"
    )


def block_input(bundle: BundleState) -> BlockInput:
    """Return what the block of a bundle is gathered from.

    Parameters
    ----------
    bundle : BundleState
        With definitions, marks and observations.

    Raises
    ------
    InputError
        With everything that is wrong in the control texts; else if the project is not initialised, or nothing of the
        bundle is measured.
    """
    found = block_input_so_far(bundle)
    bundle.require_measured()
    return found


def block_input_so_far(bundle: BundleState) -> BlockInput:
    """Return what the block of a bundle is gathered from, of which nothing may be measured yet; see `block_input`."""
    state, definition = bundle.state, bundle.project.definition
    given = state.texts.control_input(bundle.name)
    raise_complaints(given.complaints)
    state.require_initialised()
    return BlockInput(
        bundle.definition,
        bundle.records,
        state.measured,
        state.interior,
        given.value.control,
        given.value.preliminary,
        definition.ground_unit,
        definition.crs,
        (*unread_files(bundle, given.value.control), *control_of_another_name(bundle), *given.warnings),
        definition.antennas,
        definition.rigs,
        tuple(_terrain_models(bundle.project)),
    )


def _terrain_models(project: ProjectFolder) -> Iterator[TerrainModel]:
    """Yield the terrain models of a project.

    Raises
    ------
    InputError
        If one cannot be read, or is in another system than the project.
    """
    for terrain in project.definition.terrains:
        from orip.files.height_raster import read_height_raster
        from orip.geometry.height_grid import other_system

        path = project.folder / terrain.file
        grid = read_height_raster(path, project.shown(path))
        if (difference := other_system(grid, project.definition.crs)) is not None:
            message = f"{difference}; convert the raster into the project's system (gdalwarp), and give that"
            raise InputError.single(message, project.shown(path))
        yield TerrainModel(terrain, grid)
