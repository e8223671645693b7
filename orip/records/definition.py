"""A project as its owner defines it: cameras, photos, templates, antennas, bundle adjustments, stages of photos."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Final, Literal

from msgspec import Struct, field

from orip.records.camera import Camera
from orip.records.fields import GROUND_UNIT, Field
from orip.records.figures import Terrain
from orip.records.names import record_key
from orip.records.photo import Photo, Stage, Template, Temtick
from orip.records.plan import PlanSettings
from orip.records.receivers import GnssSettings, ImuSettings, NetworkSettings
from orip.records.rig import Rigs

LEVER_ARM: Final = ("LX", "LY", "LZ")
BORESIGHT: Final = ("BX", "BY", "BZ")
TIME_OFFSET: Final = "DT"
ANTENNA_PARAMETERS: Final = (*LEVER_ARM, *BORESIGHT, TIME_OFFSET)
"""Parameters of an antenna in the order of every array that holds them."""

BORESIGHT_PLACES: Final = slice(3, 6)
"""Places of the boresight among them."""

ANTENNA_KEYS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"lever_arm": LEVER_ARM, "boresight": BORESIGHT, "time_offset": (TIME_OFFSET,)}
)
"""Keys of orip.toml that hold them."""

SHIFT: Final = ("SX", "SY", "SZ")
DRIFT: Final = ("VX", "VY", "VZ")
"""Parameters of a strip or session."""

RATES: Final = ("WX", "WY", "WZ")
"""Angular rates of photos about the ground axes, degrees a second."""

MOTION_PARAMETERS: Final = (*DRIFT, *RATES)
"""Motion of a photo of a rolling shutter: velocity (ground unit a second) and angular rate."""

ANTENNA_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys((*LEVER_ARM, *SHIFT), "{ground}")
    | dict.fromkeys(BORESIGHT, "degrees")
    | dict.fromkeys(DRIFT, "{ground}/s")
    | {TIME_OFFSET: "s"}
)
"""Unit of each parameter, with the ground unit still to be filled in."""

Extent = Literal["none", "session", "strip"]

_LENGTHS: Final = (GROUND_UNIT,)


class Antenna(Struct, frozen=True):
    """An antenna, and an inertial system if there is one, with the corrections that its stations need.

    With X0 the projection centre and R the rotation of a photo (photo to ground), t its time and m the mean time of its
    strip or session, position and attitude of its station are::

        X0 + R (LX, LY, LZ) + (SX, SY, SZ) + (t - m) (VX, VY, VZ) + DT (velocity)
        R B^T,   B = Rx(BX) Ry(BY) Rz(BZ)

    Parameters
    ----------
    name : str
        Record name; case does not count.
    cameras : tuple of str
        Cameras whose photos have their stations from it; empty: all.
    lever_arm : tuple of 3 float
        From the projection centre to the antenna, along the photo's x, y and z axes, ground unit.
    lever_arm_error : tuple of 3 float or None
        A-priori errors of the unknown ones; None: nothing is known of them.
    boresight : tuple of 3 float
        Rotation of the camera against the inertial system, degrees.
    time_offset : float
        Time by which the stations are late, seconds: they are where the antenna was so much later.
    unknown : tuple of str
        Names of `ANTENNA_PARAMETERS` that the adjustment estimates; the others are constant.
    shift : {"none", "session", "strip"}
        Whether all stations together, or those of each strip, have an unknown common error.
    shift_error : tuple of 3 float or None
        A-priori errors of zero shifts, ground unit; None: nothing is known of them.
    strips : tuple of str
        Those whose shifts and drifts are unknown; empty: all.
    drift : {"none", "session", "strip"}
        Whether the common error changes with time.
    drift_error : tuple of 3 float or None
        A-priori errors of zero drifts, ground unit a second.
    """

    name: Annotated[str, Field(example='"GNSS"')]
    cameras: Annotated[tuple[str, ...], Field(names_record=True, heading="Cameras", example='["P4RTK"]')] = ()
    lever_arm: Annotated[
        tuple[float, float, float],
        Field(units=_LENGTHS, heading="Lever arm", example="[0.02, -0.01, 0.18]", elements=LEVER_ARM),
    ] = (0.0, 0.0, 0.0)
    lever_arm_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=_LENGTHS, example="[0.01, 0.01, 0.02]", elements=LEVER_ARM),
    ] = None
    boresight: Annotated[
        tuple[float, float, float],
        Field(units=("degrees",), heading="Boresight", example="[0.2, -0.1, 0.0]", elements=BORESIGHT),
    ] = (0.0, 0.0, 0.0)
    boresight_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=("degrees",), example="[0.5, 0.5, 1.0]", elements=BORESIGHT),
    ] = None
    time_offset: Annotated[float, Field(units=("s",), example="0.0")] = 0.0
    time_offset_error: Annotated[float | None, Field(above=0, units=("s",), example="0.01")] = None
    unknown: Annotated[tuple[str, ...], Field(heading="Unknown", example='["LX", "LY", "LZ"]')] = ()
    shift: Annotated[Extent, Field(heading="Shift", example='"strip"')] = "none"
    shift_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=_LENGTHS, example="[1.0, 1.0, 1.0]", elements=SHIFT),
    ] = None
    strips: Annotated[tuple[str, ...], Field(example='["2"]')] = ()
    drift: Annotated[Extent, Field(heading="Drift", example='"none"')] = "none"
    drift_error: Annotated[
        tuple[float, float, float] | None,
        Field(above=0, units=("ground unit/s",), example="[0.001, 0.001, 0.001]", elements=DRIFT),
    ] = None

    @property
    def values(self) -> tuple[float, ...]:
        """Return the values of `ANTENNA_PARAMETERS`, boresight in degrees."""
        return (*self.lever_arm, *self.boresight, self.time_offset)

    @property
    def errors(self) -> tuple[float | None, ...]:
        """Return the a-priori errors of `ANTENNA_PARAMETERS`; None where nothing is known of them."""
        none = (None, None, None)
        return (*(self.lever_arm_error or none), *(self.boresight_error or none), self.time_offset_error)


class ReportDetails(Struct, frozen=True):
    """The table `[report]` of orip.toml; texts that are not given are empty.

    Parameters
    ----------
    title : str
        Heading of the report; empty: the project's name.
    client, contractor, author : str
        For whom, by which company and by whom the work was done.
    order : str
        Number or name of the order.
    flown : str
        When the photos were taken.
    date : str
        Of the report; it is not taken from the clock, so that equal inputs give equal pages.
    equipment : str
        Camera, aircraft, receiver.
    remarks : tuple of str
        Paragraphs.
    """

    title: Annotated[str, Field(text="line", example='"Quarry Hohenfels, flight 3"')] = ""
    client: Annotated[str, Field(text="line", example='"Kalkwerk Hohenfels GmbH"')] = ""
    contractor: Annotated[str, Field(text="line", example='"Vermessung Huber"')] = ""
    author: Annotated[str, Field(text="line", example='"K. Huber"')] = ""
    order: Annotated[str, Field(text="line", example='"2026-117"')] = ""
    location: Annotated[str, Field(text="line", example='"Hohenfels"')] = ""
    flown: Annotated[str, Field(text="date", example="2026-04-28")] = ""
    date: Annotated[str, Field(text="date", example="2026-05-04")] = ""
    equipment: Annotated[str, Field(text="line", example='"DJI M3E, RTK by SAPOS"')] = ""
    remarks: Annotated[
        tuple[str, ...], Field(text="line", example='["Signalled points were set out by the client."]')
    ] = ()


class Precision(Struct, frozen=True):
    """An a-priori error of photo coordinates: millimetres, or pixels of a sensor or scan."""

    value: Annotated[float, Field(above=0)]
    unit: Literal["mm", "px"] = "mm"


class StereoModel(Struct, frozen=True):
    """Two photos seen stereoscopically, and the model's place in the block (1, 1 is upper left)."""

    name: Annotated[str, Field(names_record=True, example='"M1"')]
    left: Annotated[str, Field(names_record=True, heading="Left", example='"P101"')]
    right: Annotated[str, Field(names_record=True, heading="Right", example='"P102"')]
    row: Annotated[int, Field(least=1, heading="Row", example="1")]
    column: Annotated[int, Field(least=1, heading="Column", example="1")]


NO_DOWN_WEIGHTING = 20
"""First iteration with reduced weights from which on there are none at all: 20 was the most iterations by default, and
texts that switch the Danish method off say no more than that."""


class BundleDefinition(Struct, frozen=True):
    """What controls one bundle adjustment.

    Parameters
    ----------
    name : str
        Also the base name of the .EXO, .PRE and .DRV files.
    measurement_precision : Precision
        A-priori error of photo coordinates that carry none of their own.
    enp_stop : float
        Iterations end at this exponent of numerical precision.
    max_iterations, start_down_weight : int
        The Danish method begins at iteration `start_down_weight` at the earliest; equal to `max_iterations`, or 20 and
        more, it is off.
    max_standard_residual : float
        Standard residual above which the Danish method reduces a weight.
    max_lost_digits : float
        Decimal digits that a movement of the unknowns may lose before an unknown is removed for it: 5 to 13. Rounding
        leaves no more than 15, and sound unknowns lose up to 5.
    datum : {"control", "free"}
        What fixes the ground system.
    datum_points : tuple of str
        Points of a free network's inner constraints; empty: all.
    repeated_points : {"replace", "mean", "both"}
        A point measured in a photo again: the later measurement counts, the mean of all, or each as an observation.
    early_weights : {"scaled", "full"}
        Before the Danish method: exceptionally large residuals lose weight, and it waits until the block has settled;
        or all weights are 1, and it begins at iteration `start_down_weight`, as in ORIPROGRAM.
    points_of : str or None
        Bundle whose photo points this one has besides its own.
    control_files : str or None
        Base name of its control files; None: that of the project.
    cameras : tuple of (str, str)
        Cameras, and those that photos have in their place in this bundle.
    velocity_error, rate_error : float or None
        A-priori errors of velocities (ground unit a second) and angular rates (degrees a second) of photos of rolling
        shutters, which are unknowns then; None: they are as their neighbours say.
    stop_angles, stop_coordinates, stop_vtpv : float or None
        Iterations end, besides, only where the average change of a rotation (degrees), that of a coordinate (ground
        units), or the part by which the weighted square sum has changed, is not above these.
    """

    name: Annotated[str, Field(example='"MAIN"')]
    measurement_precision: Annotated[Precision, Field(heading="Precision", units=("mm",), example="0.005")] = Precision(
        0.005
    )
    enp_stop: Annotated[float, Field(above=0, example="4")] = 4.0
    max_iterations: Annotated[int, Field(above=0, example="60")] = 60
    start_down_weight: Annotated[int, Field(above=1, example="2")] = 2
    max_standard_residual: Annotated[float, Field(above=0, example="5")] = 5.0
    max_lost_digits: Annotated[float, Field(least=5, most=13, example="12")] = 12.0
    datum: Annotated[Literal["control", "free"], Field(heading="Datum", example='"control"')] = "control"
    datum_points: Annotated[tuple[str, ...], Field(example='["1001", "1002"]')] = ()
    models: Annotated[tuple[StereoModel, ...], Field(key="model", own_records=True, heading="Models")] = ()
    repeated_points: Annotated[
        Literal["replace", "mean", "both"],
        Field(heading="Repeated points", example='"mean"', key_after="datum_points", column_after="datum_points"),
    ] = "replace"
    early_weights: Annotated[
        Literal["scaled", "full"],
        Field(
            heading="Early weights", example='"full"', key_after="start_down_weight", column_after="start_down_weight"
        ),
    ] = "scaled"
    points_of: Annotated[str | None, Field(names_record=True, heading="Points of", example='"MAIN"')] = None
    control_files: Annotated[str | None, Field(heading="Control", example='"CHECKED"')] = None
    cameras: Annotated[tuple[tuple[str, str], ...], Field(example='[["WIDE", "WIDE_K1"]]')] = ()
    velocity_error: Annotated[float | None, Field(above=0, units=("ground unit/s",), example="0.3")] = None
    rate_error: Annotated[float | None, Field(above=0, units=("degrees/s",), example="2.0")] = None
    stop_angles: Annotated[float | None, Field(above=0, heading="Stop angles", example="0.0001")] = None
    stop_coordinates: Annotated[float | None, Field(above=0, heading="Stop coordinates", example="0.001")] = None
    stop_vtpv: Annotated[float | None, Field(above=0, heading="Stop vTPv", example="1e-6")] = None

    @property
    def reduces_weights(self) -> bool:
        """Return whether the Danish method may begin."""
        return self.start_down_weight < min(self.max_iterations, NO_DOWN_WEIGHTING)


RECORD_TYPES: Mapping[str, type] = {
    "camera": Camera,
    "temtick": Temtick,
    "template": Template,
    "photo": Photo,
    "bundle": BundleDefinition,
    "model": StereoModel,
}
"""The class of each kind of record; the models of a bundle are part of it."""


AngleUnit = Literal["degrees", "gon", "radians"]
"""Of the angles in control files that people write; everything else has degrees."""


class ProjectDefinition(Struct, frozen=True):
    """All that orip.toml says, checked and with the defaults filled in.

    File names are relative to the project folder. `control_files` and `project_files` are base names without extension.
    `test_level` is the error probability of the test of one observation; None: 5 % for all tests of a block together.
    `output_folder` is the name of a folder in it for listings, results, reports and drive tables; None: they have none.
    """

    name: str
    user: str
    camera_file: str
    temtick_file: str
    project_files: str
    control_files: str
    measurement_files: tuple[str, ...]
    ground_unit: str = "m"
    angle_unit: AngleUnit = "degrees"
    crs: str | None = None
    cameras: tuple[Camera, ...] = ()
    temticks: tuple[Temtick, ...] = ()
    templates: tuple[Template, ...] = ()
    photos: tuple[Photo, ...] = ()
    bundles: tuple[BundleDefinition, ...] = ()
    gates: tuple[str, ...] = ()
    report: ReportDetails = field(default_factory=ReportDetails)
    antennas: tuple[Antenna, ...] = ()
    terrains: tuple[Terrain, ...] = ()
    rigs: Rigs = field(default_factory=Rigs)
    output_folder: str | None = None
    test_level: float | None = None
    plan: PlanSettings | None = None
    gnss: GnssSettings | None = None
    gnss_network: NetworkSettings | None = None
    imu: ImuSettings | None = None

    @property
    def has_receivers(self) -> bool:
        """Return whether files of receivers or inertial units are named."""
        return any(part is not None for part in (self.gnss, self.gnss_network, self.imu))


_OTHER: Mapping[Stage, Stage] = {"UPPER": "LOWER", "LOWER": "UPPER"}


class StagePlan(Struct, frozen=True):
    """Stages of the photos that have one or are in a model, by `record_key`, and the models that they do not suit."""

    stages: Mapping[str, Stage]
    unsuited: tuple[StereoModel, ...]


def plan_stages(photos: Sequence[Photo], templates: Sequence[Template], models: Sequence[StereoModel]) -> StagePlan:
    """Find the stages that are not set by two-colouring the models.

    A template's photos share its stage. Stages that are set stay; where nothing is set, the left photo of the first
    model is on the upper stage. A model whose photos end up on one stage is among the unsuited.
    """
    carrier = _carriers(photos)
    stages = _set_stages(photos, templates)
    neighbours: dict[str, list[str]] = defaultdict(list)
    for model in models:
        left, right = _carrier_of(model.left, carrier), _carrier_of(model.right, carrier)
        neighbours[left].append(right)
        neighbours[right].append(left)
    _spread(list(stages), neighbours, stages)
    for model in models:
        left = _carrier_of(model.left, carrier)
        if left not in stages:
            stages[left] = "UPPER"
            _spread([left], neighbours, stages)
    unsuited = tuple(m for m in models if stages[_carrier_of(m.left, carrier)] == stages[_carrier_of(m.right, carrier)])
    return StagePlan({photo: stages[node] for photo, node in carrier.items() if node in stages}, unsuited)


def _carriers(photos: Sequence[Photo]) -> dict[str, str]:
    """Return what is mounted for each photo: its template, or the photo itself."""
    return {
        record_key(photo.name): f"template {record_key(photo.template)}"
        if photo.template is not None
        else f"photo {record_key(photo.name)}"
        for photo in photos
    }


def _carrier_of(photo: str, carrier: Mapping[str, str]) -> str:
    return carrier.get(record_key(photo), f"photo {record_key(photo)}")


def _set_stages(photos: Sequence[Photo], templates: Sequence[Template]) -> dict[str, Stage]:
    stages: dict[str, Stage] = {}
    for template in templates:
        if template.stage is not None:
            stages[f"template {record_key(template.name)}"] = template.stage
    for photo in photos:
        if photo.stage is not None and photo.template is None:
            stages[f"photo {record_key(photo.name)}"] = photo.stage
    return stages


def _spread(start: Sequence[str], neighbours: Mapping[str, Sequence[str]], stages: dict[str, Stage]) -> None:
    """Assign the other stage to all connected photos that have none yet, breadth first."""
    waiting = deque(start)
    while waiting:
        node = waiting.popleft()
        for other in neighbours.get(node, ()):
            if other not in stages:
                stages[other] = _OTHER[stages[node]]
                waiting.append(other)
