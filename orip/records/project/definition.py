"""A project as its owner defines it: cameras, photos, templates, bundle adjustments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Struct, field

from orip.records.project.antenna import Antenna
from orip.records.project.camera import Camera
from orip.records.project.fields import Field
from orip.records.project.photo import Photo, Template, Temtick
from orip.records.project.report_details import ReportDetails


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
        The Danish method begins at iteration `start_down_weight` at the earliest; equal to `max_iterations` it is off.
    max_standard_residual : float
        Standard residual above which the Danish method reduces a weight.
    max_lost_digits : float
        Decimal digits that a movement of the unknowns may lose before an unknown is removed for it: 5 to 13. Rounding
        leaves no more than 15, and sound unknowns lose up to 5.
    datum : {"control", "free"}
        What fixes the ground system.
    datum_points : tuple of str
        Points of a free network's inner constraints; empty: all.
    models : tuple of StereoModel
    repeated_points : {"replace", "mean", "both"}
        A point measured in a photo again: the later measurement counts, the mean of all, or each as an observation.
    early_weights : {"scaled", "full"}
        Before the Danish method: exceptionally large residuals lose weight, and it waits until the block has settled;
        or all weights are 1, and it begins at iteration `start_down_weight`, as in ORIPROGRAM.
    """

    name: Annotated[str, Field(example='"MAIN"')]
    measurement_precision: Annotated[Precision, Field(heading="Precision", units=("mm",), example="0.005")] = Precision(
        0.005
    )
    enp_stop: Annotated[float, Field(above=0, example="4")] = 4.0
    max_iterations: Annotated[int, Field(above=0, example="20")] = 20
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


RECORD_TYPES: Mapping[str, type] = {
    "camera": Camera,
    "temtick": Temtick,
    "template": Template,
    "photo": Photo,
    "bundle": BundleDefinition,
    "model": StereoModel,
}
"""The class of each kind of record; the models of a bundle are part of it."""


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
    crs: str | None = None
    cameras: tuple[Camera, ...] = ()
    temticks: tuple[Temtick, ...] = ()
    templates: tuple[Template, ...] = ()
    photos: tuple[Photo, ...] = ()
    bundles: tuple[BundleDefinition, ...] = ()
    gates: tuple[str, ...] = ()
    report: ReportDetails = field(default_factory=ReportDetails)
    antennas: tuple[Antenna, ...] = ()
    output_folder: str | None = None
    test_level: float | None = None
