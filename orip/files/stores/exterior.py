"""The store of exterior orientation (.EXT): definitions of bundle adjustments with their stereo models."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, get_args

from orip.files.stores.definitions import Definitions, Parts, StoredRecord, definition_table
from orip.files.stores.store import Store
from orip.files.stores.table import integer, list_table, real, record_name, text
from orip.records.project import BundleDefinition, Precision, StereoModel

BUNDLE = definition_table(
    "bundle",
    (
        real("measurement_precision", check="measurement_precision > 0"),
        text("measurement_precision_unit", get_args(Literal["mm", "px"])),
        real("enp_stop"),
        integer("max_iterations"),
        integer("start_down_weight"),
        real("max_standard_residual"),
        real("max_lost_digits"),
        text("datum", get_args(Literal["control", "free"])),
    ),
)
DATUM_POINT = list_table("datum_point", "bundle", (text("point"),))
MODEL = list_table(
    "model",
    "bundle",
    (record_name("name"), record_name("left"), record_name("right"), integer("row"), integer("column")),
    "name",
)
TABLES = (BUNDLE, DATUM_POINT, MODEL)


def read(store: Store) -> tuple[StoredRecord[BundleDefinition], ...]:
    """Return all definitions of bundle adjustments in their order."""
    return _BUNDLES.read(store)


def write(store: Store, stored: Iterable[StoredRecord[BundleDefinition]]) -> None:
    """Replace all definitions; solutions stay, also those of bundles that are no longer defined."""
    _BUNDLES.write(store, stored)


def _apart(bundle: BundleDefinition) -> Parts:
    values = (
        bundle.measurement_precision.value,
        bundle.measurement_precision.unit,
        bundle.enp_stop,
        bundle.max_iterations,
        bundle.start_down_weight,
        bundle.max_standard_residual,
        bundle.max_lost_digits,
        bundle.datum,
    )
    models = [(model.name, model.left, model.right, model.row, model.column) for model in bundle.models]
    return Parts(values, ([(point,) for point in bundle.datum_points], models))


def _together(name: str, parts: Parts) -> BundleDefinition:
    value, unit, enp_stop, max_iterations, start, max_residual, max_lost_digits, datum = parts.values
    datum_points, models = parts.lists
    return BundleDefinition(
        name=name,
        measurement_precision=Precision(value, unit),
        enp_stop=enp_stop,
        max_iterations=max_iterations,
        start_down_weight=start,
        max_standard_residual=max_residual,
        max_lost_digits=max_lost_digits,
        datum=datum,
        datum_points=tuple(row[0] for row in datum_points),
        models=tuple(StereoModel(*row) for row in models),
    )


_BUNDLES = Definitions(BUNDLE, (DATUM_POINT, MODEL), _apart, _together)
