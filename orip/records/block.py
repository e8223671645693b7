"""The assembled block: everything that one bundle adjustment starts from, in arrays, angles in radians."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.records.camera import Camera
from orip.records.control import (
    ControlDirection,
    ControlDistance,
    ControlElement,
    ControlPoint,
    FigurePoint,
    GivenDirection,
    PointCorrelation,
    PreliminaryPoint,
    Station,
    StationDifference,
)
from orip.records.definition import Antenna, BundleDefinition
from orip.records.ground import PLAIN, GroundSystem, TerrainHeight, TerrainModel
from orip.records.names import places_of_names
from orip.records.photo import Photo
from orip.records.rig import RigPlaces, Rigs, places_on_rigs


class IndexedPhotoPoints(Struct, frozen=True):
    """n measured photo points.

    Parameters
    ----------
    photo, point : arrays (n,) of int
        Indices into the block's photos and points.
    xy : array (n, 2)
        Photo coordinates in the fiducial system, mm.
    error : array (n, 2)
        A-priori errors, mm, greater than zero.
    used : array (n, 2) of bool
        False: disregarded component.
    """

    photo: IntArray
    point: IntArray
    xy: FloatArray
    error: FloatArray
    used: BoolArray

    @property
    def in_use(self) -> BoolArray:
        """Return which photo points (n,) have no disregarded component."""
        return self.used[:, 0] & self.used[:, 1]

    @property
    def partly_in_use(self) -> BoolArray:
        """Return which photo points (n,) have a component that is not disregarded."""
        return self.used[:, 0] | self.used[:, 1]

    def of(self, rows: IntArray | slice) -> IndexedPhotoPoints:
        """Return some of the photo points; photos and points keep their indices."""
        return IndexedPhotoPoints(self.photo[rows], self.point[rows], self.xy[rows], self.error[rows], self.used[rows])


class TheodoliteSet(Struct, frozen=True):
    """A set of theodolite directions: its zero direction (radians), and whether that is held."""

    name: str
    zero_direction: float
    constant: bool = False


class Block(Struct, frozen=True):
    """What is adjusted.

    Photos and points start at local coordinates of `ground`. All that is observed or given (control, distances, the
    photos' records) is in the project's.

    Parameters
    ----------
    photos : tuple of Photo
        Their `constant` elements are no unknowns.
    photo_camera : array (number of photos,) of int
    photo_orientation : array (number of photos, 6)
        Starting values in the order of `PHOTO_PARAMETERS`, ground unit and radians, local.
    point_start : array (number of points, 3)
        Starting coordinates, ground unit, local.
    control_points : tuple of ControlPoint
        Those of measured points alone, rejected ones included.
    constant_points : array (number of points, 3) of bool
        Local coordinates that are no unknowns, since control with a-priori error 0 holds them.
    elements, distances, directions : tuples
        Those whose names are in the block.
    figure_points : tuple of FigurePoint
        Of the figures that the points of the block determine.
    terrain_heights : tuple of TerrainHeight
        Of the points that started inside these.
    stations : tuple of Station
        Those of the block's photos, in the project's coordinates.
    differences : tuple of StationDifference
        Those between the block's photos.
    antennas : tuple of Antenna
        That of a camera is the first one for all cameras or for it.
    rigs : Rigs
        All of the project; exposures may have photos that are not in the block.
    held_additional : set of (camera, parameter)
        Additional parameters that are held at zero.
    ground : GroundSystem
        From local coordinates to the project's.
    constant_elements : tuple of ControlElement
        Elements of photos and points that are constant in the project, but depend on unknowns in the local frame.
    preliminary : tuple of PreliminaryPoint
        Given preliminary coordinates of points, in the project's system.
    ground_unit : str
        The project's.
    defined_cameras : tuple of Camera
        All that a photo may have been taken with, also those of no photo.
    control_correlations : tuple of PointCorrelation
        Of pairs of control points in the block; each has those of its own coordinates itself.
    warnings : tuple of ProjectWarning
        What is doubtful in what was measured and given.
    """

    definition: BundleDefinition
    cameras: tuple[Camera, ...]
    photos: tuple[Photo, ...]
    photo_camera: IntArray
    photo_orientation: FloatArray
    point_names: tuple[str, ...]
    point_start: FloatArray
    photo_points: IndexedPhotoPoints
    constant_points: BoolArray
    control_points: tuple[ControlPoint, ...] = ()
    elements: tuple[ControlElement, ...] = ()
    distances: tuple[ControlDistance, ...] = ()
    directions: tuple[ControlDirection, ...] = ()
    figure_points: tuple[FigurePoint, ...] = ()
    given_directions: tuple[GivenDirection, ...] = ()
    terrains: tuple[TerrainModel, ...] = ()
    terrain_heights: tuple[TerrainHeight, ...] = ()
    stations: tuple[Station, ...] = ()
    differences: tuple[StationDifference, ...] = ()
    theodolites: tuple[TheodoliteSet, ...] = ()
    antennas: tuple[Antenna, ...] = ()
    rigs: Rigs = Rigs()
    held_additional: frozenset[tuple[str, str]] = frozenset()
    ground: GroundSystem = PLAIN
    constant_elements: tuple[ControlElement, ...] = ()
    preliminary: tuple[PreliminaryPoint, ...] = ()
    ground_unit: str = "m"
    defined_cameras: tuple[Camera, ...] = ()
    control_correlations: tuple[PointCorrelation, ...] = ()
    warnings: tuple[ProjectWarning, ...] = ()

    @property
    def is_free_network(self) -> bool:
        """Return whether inner constraints fix the ground system, and not control."""
        return self.definition.datum == "free"

    def places_on_rigs(self) -> RigPlaces:
        """Return where the photos of the block are on rigs."""
        photos = [(photo.name, photo.camera) for photo in self.photos]
        return places_on_rigs(self.rigs, photos, self.definition.cameras)

    def point_index(self) -> Mapping[str, int]:
        """Return the place of each point by its name."""
        return places_of_names(self.point_names)
