"""A project folder: its definition, and where its stores and outputs are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct, field

from orip.errors import InputError, NoFolderError, NoProjectError, ProjectWarning, UsageError
from orip.files.project.reader import read_project
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.stores import read_bundles
from orip.files.stores.digest import record_digest
from orip.files.stores.identity import refuse_older_stores
from orip.files.stores.transaction import reading
from orip.files.text.regular_file import file_digest
from orip.records.definition import BundleDefinition, ProjectDefinition
from orip.records.names import record_key
from orip.structs import replace
from orip.wording import agreeing, first_names

if TYPE_CHECKING:
    from orip.records.results.solution import Solution

PROJECT_FILE = "orip.toml"


class OutputFiles(Struct, frozen=True):
    """Paths of what a bundle adjustment writes."""

    result: Path
    residuals: Path
    residual_arrays: Path
    listing: Path
    errors: Path

    @property
    def all(self) -> tuple[Path, ...]:
        """Return all that may be there; of `residuals` and `residual_arrays` one is written."""
        return self.listing, self.errors, self.result, self.residuals, self.residual_arrays

    def residuals_of(self, solution: Solution) -> Path:
        """Return the file of the residuals of a solution: a table of a small block, arrays of a large one."""
        return self.residual_arrays if solution.is_large else self.residuals

    def written(self, solution: Solution) -> tuple[Path, ...]:
        """Return what is written of a solution, in the order in which the files are named."""
        return self.listing, self.errors, self.result, self.residuals_of(solution)


class ProjectFolder(Struct, frozen=True):
    """A project folder with a sound orip.toml.

    Parameters
    ----------
    definition : ProjectDefinition
        As the text says; distortions not yet taken to the polynomial.
    lines : mapping (kind, record_key) to int
        The line of each record in orip.toml.
    bundles_of_commands : tuple of str
        Bundles of the store that orip.toml does not define: they were added, copied or renamed by commands.
    control_of_bundles : mapping of record_key to str
        Base names of the control files of bundles that have their own.
    """

    folder: Path
    definition: ProjectDefinition
    lines: Mapping[tuple[str, str], int]
    warnings: tuple[ProjectWarning, ...]
    bundles_of_commands: tuple[str, ...] = ()
    control_of_bundles: Mapping[str, str] = field(default_factory=dict)

    @property
    def text(self) -> Path:
        """Return the path of orip.toml."""
        return self.folder / PROJECT_FILE

    @property
    def title(self) -> str:
        """Return the names of project and user on one line, as texts without a title block have them."""
        user = f", {self.definition.user}" if self.definition.user else ""
        return f"Project {self.definition.name}{user}"

    @property
    def bundle_names(self) -> tuple[str, ...]:
        """Return the names of the bundles: of orip.toml, then those that commands have made."""
        return (*(bundle.name for bundle in self.definition.bundles), *self.bundles_of_commands)

    @property
    def owner(self) -> str:
        """Return project and user, as they stand at the head of texts that are measured or computed."""
        user = f", user {self.definition.user}" if self.definition.user else ""
        return f"project {self.definition.name}{user}"

    @property
    def has_one_bundle(self) -> bool:
        """Tell whether no name is needed to say which bundle is meant."""
        return len(self.bundle_names) == 1

    @property
    def heading_digest(self) -> tuple[str, str]:
        """Return the name, in messages, and the digest of what is printed on every output."""
        definition = self.definition
        heading = (definition.name, definition.user, definition.ground_unit)
        return f"[project] of {PROJECT_FILE}", record_digest(heading)

    @property
    def crs_digest(self) -> tuple[tuple[str, str], ...]:
        """Return the name, in messages, and the digest of the coordinate reference system; none without one."""
        crs = self.definition.crs
        return () if crs is None else ((f"crs of {PROJECT_FILE}", record_digest((crs,))),)

    @property
    def angle_digest(self) -> tuple[tuple[str, str], ...]:
        """Return the name, in messages, and the digest of the unit of angles; none of degrees."""
        unit = self.definition.angle_unit
        return () if unit == "degrees" else ((f"angle_unit of {PROJECT_FILE}", record_digest((unit,))),)

    @property
    def antenna_digest(self) -> tuple[tuple[str, str], ...]:
        """Return the name, in messages, and the digest of each antenna."""
        antennas = self.definition.antennas
        return tuple((f"antenna {antenna.name} of {PROJECT_FILE}", record_digest(antenna)) for antenna in antennas)

    @property
    def terrain_digest(self) -> tuple[tuple[str, str], ...]:
        """Return the name, in messages, and the digest of each terrain model and of its file."""
        found = []
        for terrain in self.definition.terrains:
            file = self.folder / terrain.file
            found.append((f"terrain {terrain.name} of {PROJECT_FILE}", record_digest(terrain)))
            with suppress(OSError):  # what is wrong with it is said when it is read
                found.append((self.shown(file), file_digest(file)))
        return tuple(found)

    @property
    def rig_digest(self) -> tuple[tuple[str, str], ...]:
        """Return the name, in messages, and the digest of each rig, and of all exposures."""
        rigs, exposures = self.definition.rigs.rigs, self.definition.rigs.exposures
        found = tuple((f"rig {rig.name} of {PROJECT_FILE}", record_digest(rig)) for rig in rigs)
        return (*found, (f"exposures of {PROJECT_FILE}", record_digest(exposures))) if exposures else found

    @property
    def cameras(self) -> Path:
        """Return the store of cameras."""
        return self.folder / self.definition.camera_file

    @property
    def temticks(self) -> Path:
        """Return the store of temticks."""
        return self.folder / self.definition.temtick_file

    @property
    def photos(self) -> Path:
        """Return the store of photos."""
        return self.folder / f"{self.definition.project_files}.PHO"

    @property
    def templates(self) -> Path:
        """Return the store of templates."""
        return self.folder / f"{self.definition.project_files}.TEM"

    @property
    def exterior(self) -> Path:
        """Return the store of exterior orientation."""
        return self.folder / f"{self.definition.project_files}.EXT"

    @property
    def record_stores(self) -> tuple[Path, ...]:
        """Return the stores of all definitions."""
        return self.cameras, self.temticks, self.photos, self.templates, self.exterior

    def control_base(self, bundle: str | None = None) -> str:
        """Return the base name of the control files of a bundle; None: of the project."""
        return self.control_of_bundles.get(record_key(bundle or ""), self.definition.control_files)

    @property
    def before_update(self) -> Path:
        """Return the path of before_update.json."""
        return self.folder / "before_update.json"

    @property
    def results(self) -> Path:
        """Return the folder of listings, results and reports."""
        return self.folder / (self.definition.output_folder or "")

    @property
    def interior_listing(self) -> Path:
        """Return the path of INTERIOR_RESULT.OUT."""
        return self.results / "INTERIOR_RESULT.OUT"

    def observations(self, bundle: str) -> Path:
        """Return the store of a bundle's photo observations."""
        return self.beside_photos(bundle, "EXO")

    def preliminary(self, bundle: str) -> Path:
        """Return the path of a bundle's preliminary coordinates."""
        return self.beside_photos(bundle, "PRE")

    def preliminary_listing(self, bundle: str) -> Path:
        """Return the path of PRELIM_RESULT.OUT: a plain name where the bundle is the project's only one."""
        prefix = "" if self.has_one_bundle else f"{bundle}_"
        return self.results / f"{prefix}PRELIM_RESULT.OUT"

    def drive_table(self, bundle: str) -> Path:
        """Return the path of a bundle's drive table: among the other outputs if they have a folder of their own."""
        return self.beside_photos(bundle, "DRV") if self.results == self.folder else self.results / f"{bundle}.DRV"

    def beside_photos(self, bundle: str, extension: str) -> Path:
        """Return a bundle's file in the folder of the project files."""
        return self.photos.with_name(f"{bundle}.{extension}")

    def report(self, bundle: str, kind: str = "full") -> Path:
        """Return the path of a bundle's report of a kind: a plain name where it is the project's only bundle."""
        name = {"full": "report", "client": "client_report", "certificate": "calibration_certificate"}[kind]
        return self.results / f"{'' if self.has_one_bundle else f'{bundle}_'}{name}.html"

    def outputs(self, bundle: str) -> OutputFiles:
        """Return where a bundle's results go: plain names where it is the project's only bundle."""
        return self._outputs(bundle, only=self.has_one_bundle)

    def outputs_of_other_name(self, bundle: str) -> OutputFiles:
        """Return where a bundle's results would go with several bundles where the project has one, or the reverse."""
        return self._outputs(bundle, only=not self.has_one_bundle)

    def _outputs(self, bundle: str, *, only: bool) -> OutputFiles:
        start, prefix = ("", "BUNDLE") if only else (f"{bundle}_", bundle)
        return OutputFiles(
            self.results / f"{start}result.json",
            self.results / f"{start}residuals.csv",
            self.results / f"{start}residuals.npz",
            self.results / f"{prefix}_RESULT.OUT",
            self.results / f"{prefix}_ERROR.OUT",
        )

    def shown(self, path: Path) -> str:
        """Return a path as the user would name it: relative to the project folder."""
        return str(path.relative_to(self.folder)) if path.is_relative_to(self.folder) else str(path)

    def bundle_name(self, wanted: str | None) -> str:
        """Return the name of the bundle that a command is about.

        Raises
        ------
        UsageError
            If there is no such bundle, or several and none was named.
        """
        names = self.bundle_names
        if wanted is None and len(names) == 1:
            return names[0]
        for name in names:
            if wanted is not None and record_key(name) == record_key(wanted):
                return name
        listed = ", ".join(names) or "none"
        if not names:
            message = "the project has no bundle yet; 'orip bundle add NAME' makes one"
        elif wanted is None:
            message = f"the project has {len(names)} bundles; name one of them: {listed}"
        else:
            message = f"there is no bundle '{wanted}'; the project's bundles are: {listed}"
        raise UsageError(message)


def open_project(folder: Path) -> ProjectFolder:
    """Read orip.toml of a folder.

    Raises
    ------
    InputError
        With everything that is wrong in it, or all stores that an older orip wrote.
    UsageError
        If there is no such folder.
    """
    path = folder / PROJECT_FILE
    if not folder.is_dir():
        found = "is a file, not a folder" if folder.exists() else "does not exist"
        message = f"the folder '{folder}' {found}"
        raise NoFolderError(message)
    if not path.exists():
        raise _no_project(folder)
    parsed = read_project(path, PROJECT_FILE)
    if parsed.complaints or parsed.value is None:
        raise InputError(parsed.complaints)
    project = ProjectFolder(folder, parsed.value.definition, parsed.value.lines, parsed.warnings)
    of_bundles = [project.observations(bundle.name) for bundle in project.definition.bundles]
    refuse_older_stores([*project.record_stores, *of_bundles])
    with reading([project.exterior]) as stores:
        stored = read_bundles(stores[project.exterior])
    names, control = _bundles_of_commands(project, stored), _control_of_bundles(project, stored)
    return replace(project, bundles_of_commands=names, control_of_bundles=control)


_MISSPELT = (PROJECT_FILE, f"{PROJECT_FILE}.txt", f"{PROJECT_FILE}.toml")


def _no_project(folder: Path) -> InputError:
    """Return the error about a folder without orip.toml: the file under another name, or projects in it or around."""
    for path in sorted(folder.iterdir()):
        if path.name.lower() in _MISSPELT and path.is_file():
            message = f"this file is not read: the project's file is called {PROJECT_FILE}; rename it"
            return InputError.single(message, path.name)
    message = f"there is no {PROJECT_FILE} in {folder.resolve()}: this is not an orip project"
    if inside := sorted(found.parent.name for found in folder.glob(f"*/{PROJECT_FILE}")):
        message += f", but {first_names(inside, 3)} in it {agreeing(len(inside), 'is', 'are')}"
    elif around := next((one for one in folder.resolve().parents if (one / PROJECT_FILE).is_file()), None):
        message += f", but {around} is, around it"
    return NoProjectError.single(message)


def _control_of_bundles(project: ProjectFolder, stored: Sequence[StoredRecord[BundleDefinition]]) -> dict[str, str]:
    """Return the control files of bundles as the next command has them: a text that has changed will be applied."""
    known = {record_key(bundle.record.name): bundle for bundle in stored}
    changed = [
        bundle
        for bundle in project.definition.bundles
        if (there := known.get(record_key(bundle.name))) is None or there.text_digest != record_digest(bundle)
    ]
    bundles = [*(bundle.record for bundle in stored), *changed]
    found = {record_key(bundle.name): bundle.control_files for bundle in bundles}
    return {key: base for key, base in found.items() if base is not None}


def _bundles_of_commands(project: ProjectFolder, stored: Sequence[StoredRecord[BundleDefinition]]) -> tuple[str, ...]:
    in_text = {record_key(bundle.name) for bundle in project.definition.bundles}
    # one that came from this text and is no longer in it is removed by the next 'orip init'
    return tuple(
        bundle.record.name
        for bundle in stored
        if record_key(bundle.record.name) not in in_text
        and (bundle.text_digest is None or bundle.origin != project.definition.name)
    )
