"""A plan in a project: its settings, texts and terrain read, its exposures, design and forecast."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import InputError, UsageError
from orip.files.control.stations_text import read_stations, stations_text
from orip.files.height_raster import read_height_raster
from orip.files.text.regular_file import is_there
from orip.geometry.ground_crs import known_crs
from orip.geometry.height_grid import surface_at
from orip.planning.areas import checked_outline, read_outline, refuse_other_system
from orip.planning.forecast import (
    Design,
    Forecast,
    design_block,
    forecast,
    height_for,
    tie_points,
)
from orip.planning.geometry import Terrain
from orip.planning.plan import PlannedFlight, frame_of, plan_flight
from orip.planning.rings import Object, object_of, plan_rings
from orip.records.camera import Camera
from orip.records.control import Control, ControlPoint, Station
from orip.records.definition import BundleDefinition
from orip.records.names import record_key
from orip.records.plan import PlanSettings
from orip.structs import replace
from orip.workflow.project.state import ProjectState, read_project
from orip.workflow.project.texts import raise_complaints


def level(height: float) -> Terrain:
    """Return terrain of one height."""
    return lambda places: np.full(len(places), height)


def terrain_of_points(points: Sequence[ControlPoint], shown: str) -> Terrain:
    """Return terrain through the points of a .PNT file: linear in their triangles, the nearest one outside.

    Raises
    ------
    InputError
        If fewer than three have all coordinates.
    """
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

    known = np.array([p.coordinates for p in points if None not in p.coordinates and not p.rejected], dtype=np.float64)
    if len(known) < 3 or np.linalg.matrix_rank(known[:, :2] - known[:1, :2]) < 2:
        message = 'terrain = "control" needs three points at least with X, Y and Z, not on one line; or give ground'
        raise InputError.single(message, shown)
    inside, outside = LinearNDInterpolator(known[:, :2], known[:, 2]), NearestNDInterpolator(known[:, :2], known[:, 2])

    def heights(places: FloatArray) -> FloatArray:
        found: FloatArray = inside(places)
        return np.where(np.isnan(found), outside(places), found)

    return heights


def terrain_of_raster(path: Path, shown: str, crs: str | None) -> Terrain:
    """Return terrain of the first band of a GeoTIFF; its heights are those of the project.

    Places are taken to the raster's system where it has one, and the project has another.

    Raises
    ------
    InputError
        If it cannot be read; and when heights are asked for where it has none.
    UsageError
        Without rasterio.
    """
    grid = read_height_raster(path, shown)
    to_raster = _to_raster(crs, grid.crs)

    def heights(places: FloatArray) -> FloatArray:
        found = surface_at(grid, to_raster(places))
        if not found.known.all():
            x, y = places[~found.known][0].tolist()
            message = (
                f"the terrain has no height at {x:.1f}, {y:.1f}, and at {int((~found.known).sum())} of {len(places)} "
                "places asked for; fill its holes, or give a raster that reaches beyond the border by a photo"
            )
            raise InputError.single(message, shown)
        return found.height

    return heights


def _to_raster(crs: str | None, own: str | None) -> Callable[[FloatArray], FloatArray]:
    """Return what takes places (n, 2) of the project to the system of a raster."""
    if crs is None or own is None:
        return lambda places: places
    from pyproj import Transformer

    raster = known_crs(own)
    transformer = Transformer.from_crs(known_crs(crs).to_2d(), raster.to_2d(), always_xy=True)
    return lambda places: np.column_stack(transformer.transform(places[:, 0], places[:, 1]))


PLAN_ENDING = ".PLAN"

_TOML = "orip.toml"

_HEIGHT_OVER_SIZE = 0.7
"""Where the height that gives a standard deviation is sought first: that of a usual overlap."""


class Given(Struct, frozen=True):
    """What a plan is made from.

    Parameters
    ----------
    bundle : BundleDefinition
        Whose precision and settings are those of the forecast.
    """

    settings: PlanSettings
    camera: Camera
    bundle: BundleDefinition
    terrain: Terrain
    control: Control
    state: ProjectState

    @property
    def object(self) -> Object:
        """Return what rings are round."""
        return object_of(self.settings, self.control.points)

    @property
    def path(self) -> Path:
        """Return the text of the planned exposures."""
        definition = self.state.project.definition
        return self.state.project.folder / f"{definition.control_files}{PLAN_ENDING}"


def given_plan(state: ProjectState, bundle: str | None) -> Given:
    """Read what a plan is made from.

    Raises
    ------
    InputError
        With what is missing or wrong.
    """
    project = state.project
    definition = project.definition
    settings = definition.plan
    if settings is None:
        message = "there is no [plan] in it; write one with pixel or height, and area or corners"
        raise InputError.single(message, _TOML)
    control = state.texts.control
    raise_complaints(control.complaints)
    camera = camera_of(definition.cameras, settings.camera)
    frame_of(camera, settings.across)
    name = project.bundle_name(bundle)
    chosen = next((one for one in definition.bundles if record_key(one.name) == record_key(name)), None)
    if chosen is None:
        message = f"bundle {name} is not in it; write its [[bundle]] with measurement_precision"
        raise InputError.single(message, _TOML)
    terrain = _terrain(settings, control.value.points, state)
    return Given(settings, camera, chosen, terrain, control.value, state)


def read_plan(folder: Path, bundle: str | None) -> Given:
    """Read what the plan of a project folder is made from; see `given_plan`."""
    return given_plan(read_project(folder), bundle)


def camera_of(cameras: Sequence[Camera], name: str) -> Camera:
    """Return the camera of a name, or the only one."""
    found = [camera for camera in cameras if not name or record_key(camera.name) == record_key(name)]
    if len(found) != 1:
        known = ", ".join(camera.name for camera in cameras) or "none"
        message = f"[plan] has camera = {name!r}, cameras are: {known}; name one of them"
        raise InputError.single(message, _TOML)
    return found[0]


def made_plan(given: Given) -> PlannedFlight:
    """Return the plan that the settings ask for."""
    if given.settings.sd is None:
        return _made(given)
    return _made(with_height(given))


def with_height(given: Given) -> Given:
    """Return what a plan is made from with the height at which points get the standard deviation that is wanted.

    Raises
    ------
    InputError
        If `pixel` or `height` is given too, no height gives it, nothing determines the camera, or it is no flight.
    """
    settings = given.settings
    assert settings.sd is not None, "it is asked for where it is given"
    if settings.kind == "rings" or settings.pixel is not None or settings.height is not None:
        message = '[plan] has sd beside kind = "rings", pixel or height; sd is for flights, and gives the height itself'
        raise InputError.single(message, _TOML)
    frame, precision = frame_of(given.camera, settings.across), given.bundle.measurement_precision
    size = precision.value if precision.unit == "mm" else precision.value * frame.pixel
    bare = replace(given, settings=replace(settings, sd=None))

    def at(height: float) -> Given:
        return replace(bare, settings=replace(bare.settings, height=height))

    def sd_at(height: float) -> float:
        plan = _made(at(height))
        found = forecast_of(at(height), plan.stations)
        if found.held:
            message = (
                f"sd cannot be forecast: nothing determines {', '.join(found.held)} of the camera, and heights hang on "
                "it; give cross_strips with cross_tilt in [plan], control in the .PNT file, or take it out of unknown"
            )
            raise InputError.single(message, _TOML)
        heights = found.point_sd[:, 2]
        known = heights[np.isfinite(heights)]
        return float(np.median(known)) if 2 * len(known) > len(heights) else float("inf")

    unit = given.state.project.definition.ground_unit
    return at(height_for(settings.sd, _HEIGHT_OVER_SIZE * settings.sd * frame.c / size, sd_at, unit))


def _made(given: Given) -> PlannedFlight:
    settings, camera = given.settings, given.camera
    if settings.kind == "rings":
        return plan_rings(settings, camera, given.object)
    return plan_flight(settings, camera, outline_of(given), given.terrain)


def outline_of(given: Given) -> FloatArray:
    """Return the corners (n, 2) of the area, or the points of the line, that a flight is over.

    Raises
    ------
    InputError
        If there is none, or it has faults.
    """
    settings, project = given.settings, given.state.project
    if bool(settings.area) == (settings.corners is not None):
        message = "give one of area (a file) and corners in [plan]"
        raise InputError.single(message, _TOML)
    is_line = settings.corridor > 0.0
    if settings.corners is not None:
        outline, shown = np.array(settings.corners, dtype=np.float64), f"{_TOML}: corners of [plan]"
    else:
        path = project.folder / settings.area
        shown = project.shown(path)
        outline = read_outline(path, shown, project.definition.crs, is_line=is_line)
    outline = checked_outline(outline, shown, is_line=is_line)
    if settings.corners is not None:
        refuse_other_system(outline, project.definition.crs, shown)
    return outline


def plan_text(plan: PlannedFlight) -> str:
    """Return the text of the planned exposures: a .STA file with comments."""
    head = (
        "! planned by 'orip plan'; edit it as you like: 'orip plan forecast' and 'export' read it again\n"
        "! photo X Y Z and their a-priori errors, OMEGA PHI KAPPA and theirs, time (s), strip\n"
        "! a negative error: planned, but not observed\n"
    )
    return head + stations_text(plan.stations)


def require_other_file(given: Given, path: Path) -> None:
    """Refuse to write an output over the plan, whatever the case of its letters."""
    if path.name.casefold() == given.path.name.casefold():
        message = f"{given.path.name} is the plan itself, which no output replaces; name another file"
        raise UsageError(message)


def planned_stations(given: Given) -> tuple[Station, ...]:
    """Return the planned exposures of the text.

    Raises
    ------
    InputError
        If there is none, or it has faults.
    """
    project = given.state.project
    shown = project.shown(given.path)
    if not is_there(given.path):
        message = "there is no plan yet; run 'orip plan make' first"
        raise InputError.single(message, shown)
    parsed = read_stations(given.path, shown)
    raise_complaints(parsed.complaints)
    lacking = [station for station in parsed.value if not (station.has_position and station.has_angles)]
    if lacking or not parsed.value:
        message = f"photo '{lacking[0].photo}' needs a position and angles" if lacking else "it has no exposures"
        msg = f"{message}; run 'orip plan make'"
        raise InputError.single(msg, shown, lacking[0].line if lacking else None)
    return parsed.value


def logged_stations(given: Given) -> tuple[Station, ...]:
    """Return the stations of the .STA file: what was flown.

    Raises
    ------
    InputError
        If there are none.
    """
    if not given.control.stations:
        message = "the project has no .STA file of what was flown; run 'orip stations import' first"
        raise InputError.single(message)
    return given.control.stations


def design_of(given: Given, stations: Sequence[Station]) -> Design:
    """Return the design of planned exposures, with tie points on the ground or in the object."""
    settings, definition = given.settings, given.state.project.definition
    frame = frame_of(given.camera, "height")  # along and across are x and y
    points = (
        (np.zeros((0, 3)) if settings.object else given.object.points)
        if settings.kind == "rings"
        else tie_points(np.array([frame.along, frame.across]), frame.c, stations, given.terrain, settings.tie_points)
    )
    return Design(
        given.bundle, given.camera, tuple(stations), points, given.control, definition.antennas,
        definition.ground_unit, definition.crs,
    )  # fmt: skip


def forecast_of(given: Given, stations: Sequence[Station]) -> Forecast:
    """Return the forecast of planned exposures."""
    return forecast(design_block(design_of(given, stations)))


def _terrain(settings: PlanSettings, points: Sequence[ControlPoint], state: ProjectState) -> Terrain:
    if not settings.terrain:
        return level(settings.ground)
    if settings.terrain == "control":
        return terrain_of_points(points, "the .PNT file")
    project = state.project
    path = project.folder / settings.terrain
    return terrain_of_raster(path, project.shown(path), project.definition.crs)
