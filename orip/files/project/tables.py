"""The tables and keys of orip.toml as the text has them: types, limits and defaults.

Each key carries an example; messages about a wrong value show it. What concerns several records together is looked at
in `project_checks`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, PlainValidator

from orip.files.text.decimal_numbers import parse_photo_error
from orip.records.project import Precision

Pair: TypeAlias = Annotated[list[float], Field(min_length=2, max_length=2)]
PositivePair: TypeAlias = Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=2, max_length=2)]
ShortText: TypeAlias = Annotated[str, Field(max_length=20)]
FilledText: TypeAlias = Annotated[str, Field(min_length=1)]
StageName: TypeAlias = Literal["UPPER", "LOWER"]


SECTIONS = ("project", "check", "camera", "temtick", "template", "photo", "bundle")
"""Tables of orip.toml; all but the first two may come several times."""


def example_of(table: type[BaseModel], key: str) -> str | None:
    """Return how the value of a key may be written."""
    for name, info in table.model_fields.items():
        if key == (info.alias or name):
            return str(info.examples[0]) if info.examples else None
    return None


def keys_of(table: type[BaseModel]) -> list[str]:
    """Return the keys that a table may have, in their order."""
    return [info.alias or name for name, info in table.model_fields.items()]


def _as_number(value: object) -> float | None:
    """Return a TOML number as a float; None for anything else, and for what is too large for one."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if abs(number) < float("inf") else None


def _precision(value: object) -> Precision:
    number, unit = _as_number(value), "mm"
    if isinstance(value, str):
        number, in_pixels = parse_photo_error(value)
        unit = "px" if in_pixels else "text"
    if number is None or unit == "text":
        message = "only a number (mm) or a text such as '0.5px' is allowed"
        raise ValueError(message)
    if number <= 0:
        message = "a precision is above 0"
        raise ValueError(message)
    return Precision(number, "px" if unit == "px" else "mm")


def _pixel(value: object) -> tuple[float, float]:
    sizes = value if isinstance(value, list) else [value, value]
    numbers = [number for number in map(_as_number, sizes) if number is not None and number > 0]
    if len(sizes) != 2 or len(numbers) != 2:
        message = "only a number above 0 (mm) or two of them, [px, py], are allowed"
        raise ValueError(message)
    return numbers[0], numbers[1]


class Table(BaseModel):
    """A TOML table: no unknown keys, no conversion of types, no NaN."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class ProjectTable(Table):
    """``[project]``."""

    name: Annotated[str, Field(min_length=1, max_length=20, examples=['"ZURICH"'])]
    user: Annotated[ShortText, Field(examples=['"K. Dueholm"'])] = ""
    camera_file: Annotated[FilledText, Field(examples=['"CAMERAS.CAM"'])] = "CAMERAS.CAM"
    temtick_file: Annotated[FilledText, Field(examples=['"TEMTICKS.TIK"'])] = "TEMTICKS.TIK"
    project_files: Annotated[str | None, Field(examples=['"ZURICH"'])] = None
    control_files: Annotated[str | None, Field(examples=['"ZURICH"'])] = None
    measurement_files: Annotated[list[FilledText], Field(examples=['["*.MEA"]'])] = ["*.MEA"]
    ground_unit: Annotated[FilledText, Field(examples=['"m"'])] = "m"
    crs: Annotated[str | None, Field(min_length=1, examples=['"EPSG:2056"'])] = None


class CheckTable(Table):
    """``[check]``."""

    gates: Annotated[list[FilledText], Field(examples=['["sigma0<=1.5"]'])] = []


class MarkTable(Table):
    """A fiducial or tick mark, mm."""

    name: Annotated[str, Field(examples=['"1"'])]
    x: Annotated[float, Field(examples=["-12.0"])]
    y: Annotated[float, Field(examples=["18.0"])]


class DistortionTable(Table):
    """Distortion as a polynomial; powers of 1/mm."""

    A1: float = 0.0
    A3: float = 0.0
    A5: float = 0.0
    A7: float = 0.0
    P1: float = 0.0
    P2: float = 0.0
    B1: float = 0.0
    B2: float = 0.0


class IspTable(Table):
    """Distortion in the form of the ISP regulations."""

    R0: float = 0.0
    A1: float = 0.0
    A2: float = 0.0
    A3: float = 0.0


class SensorTable(Table):
    """A digital frame: pixels and millimetres."""

    columns: Annotated[int, Field(gt=0, examples=["1280"])]
    rows: Annotated[int, Field(gt=0, examples=["1024"])]
    width: Annotated[float, Field(gt=0, examples=["8.245"])]
    height: Annotated[float, Field(gt=0, examples=["6.6"])]


class CameraTable(Table):
    """``[[camera]]``."""

    name: Annotated[str, Field(examples=['"OLYMPUS"'])]
    c: Annotated[float, Field(gt=0, examples=["8.595"])]
    principal_point: Annotated[Pair, Field(examples=["[-0.1905, 0.9305]"])] = [0.0, 0.0]
    distortion: Annotated[DistortionTable | None, Field(examples=["{ A1 = 0.0, A3 = 1.0e-4 }"])] = None
    distortion_isp: Annotated[IspTable | None, Field(examples=["{ R0 = 10.0, A1 = 1.0e-4 }"])] = None
    distortion_curve: Annotated[list[Pair] | None, Field(examples=["[[0.0, 0.0], [5.0, 0.002]]"])] = None
    distortion_at: Annotated[Literal["ideal", "measured"], Field(examples=['"ideal"'])] = "ideal"
    frame: Annotated[PositivePair | None, Field(examples=["[24.0, 36.0]"])] = None
    fiducials: Annotated[list[MarkTable], Field(examples=['[{ name = "1", x = -12.0, y = 18.0 }]'])] = []
    sensor: Annotated[
        SensorTable | None, Field(examples=["{ columns = 1280, rows = 1024, width = 8.245, height = 6.6 }"])
    ] = None
    unknown: Annotated[list[str], Field(examples=['["C", "DX", "DY"]'])] = []
    additional_set: Annotated[Literal["EBNER", "GRUEN"] | None, Field(alias="set", examples=['"EBNER"'])] = None


class ScanTable(Table):
    """Scanned film; pixel size in mm."""

    pixel: Annotated[Any, PlainValidator(_pixel), Field(examples=["0.0127"])]
    origin: Annotated[Literal["corner", "centre"], Field(examples=['"corner"'])] = "corner"


class TemtickTable(Table):
    """``[[temtick]]``."""

    name: Annotated[str, Field(examples=['"GRID"'])]
    ticks: Annotated[list[MarkTable], Field(examples=['[{ name = "1", x = 10.0, y = 220.0 }]'])] = []


class TemplateTable(Table):
    """``[[template]]``."""

    name: Annotated[str, Field(examples=['"T1"'])]
    temtick: Annotated[str, Field(examples=['"GRID"'])]
    stage: Annotated[StageName | None, Field(examples=['"UPPER"'])] = None
    photos: Annotated[list[str], Field(examples=['["P101", "P102"]'])] = []
    scan: Annotated[ScanTable | None, Field(examples=["{ pixel = 0.0127 }"])] = None


class PhotoTable(Table):
    """``[[photo]]``; ground units and degrees."""

    name: Annotated[str, Field(examples=['"P101"'])]
    camera: Annotated[str, Field(examples=['"OLYMPUS"'])]
    template: Annotated[str | None, Field(examples=['"T1"'])] = None
    stage: Annotated[StageName | None, Field(examples=['"UPPER"'])] = None
    X0: Annotated[float | None, Field(examples=["1250.0"])] = None
    Y0: Annotated[float | None, Field(examples=["830.0"])] = None
    Z0: Annotated[float | None, Field(examples=["410.0"])] = None
    OMEGA: Annotated[float | None, Field(examples=["0.5"])] = None
    PHI: Annotated[float | None, Field(examples=["-1.5"])] = None
    KAPPA: Annotated[float | None, Field(examples=["90.0"])] = None
    constant: Annotated[list[str], Field(examples=['["X0", "Y0"]'])] = []
    scan: Annotated[ScanTable | None, Field(examples=["{ pixel = 0.0127 }"])] = None


class BundleTable(Table):
    """``[[bundle]]`` without its models, which are read one by one."""

    name: Annotated[str, Field(examples=['"MAIN"'])]
    measurement_precision: Annotated[Any, PlainValidator(_precision), Field(examples=["0.005"])] = Precision(0.005)
    enp_stop: Annotated[float, Field(gt=0, examples=["4"])] = 4.0
    max_iterations: Annotated[int, Field(gt=0, examples=["20"])] = 20
    start_down_weight: Annotated[int, Field(gt=1, examples=["2"])] = 2
    max_standard_residual: Annotated[float, Field(gt=0, examples=["5"])] = 5.0
    max_lost_digits: Annotated[float, Field(gt=0, examples=["12"])] = 12.0
    datum: Annotated[Literal["control", "free"], Field(examples=['"control"'])] = "control"
    datum_points: Annotated[list[str], Field(examples=['["1001", "1002"]'])] = []


class ModelTable(Table):
    """``[[bundle.model]]``."""

    name: Annotated[str, Field(examples=['"M1"'])]
    left: Annotated[str, Field(examples=['"P101"'])]
    right: Annotated[str, Field(examples=['"P102"'])]
    row: Annotated[int, Field(ge=1, examples=["1"])]
    column: Annotated[int, Field(ge=1, examples=["1"])]
