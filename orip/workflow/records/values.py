"""The values of a record one by one, under the keys with which they are edited, with their units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from orip.files.project.assignments import TABLE_OF_KIND
from orip.files.project.tables import keys_of
from orip.files.project.toml_text import toml_value
from orip.records.photo import PHOTO_PARAMETERS
from orip.workflow.records.references import RecordKind

NOT_GIVEN = "-"

_UNITS = {
    "c": "mm",
    "principal_point": "mm",
    "distortion.A3": "1/mm^2",
    "distortion.A5": "1/mm^4",
    "distortion.A7": "1/mm^6",
    "distortion.P1": "1/mm",
    "distortion.P2": "1/mm",
    "distortion_isp.R0": "mm",
    "distortion_isp.A1": "1/mm^2",
    "distortion_isp.A2": "1/mm^4",
    "distortion_isp.A3": "1/mm^6",
    "distortion_curve": "mm",
    "frame": "mm",
    "sensor.columns": "pixels",
    "sensor.rows": "pixels",
    "sensor.width": "mm",
    "sensor.height": "mm",
    "scan.pixel": "mm",
    **dict.fromkeys(PHOTO_PARAMETERS[3:], "degrees"),
}


class RecordValue(NamedTuple):
    """A value of a record: its key, its value as TOML has it (None: not given), and its unit."""

    key: str
    value: Any
    unit: str

    @property
    def text(self) -> str:
        """Return the value as it is shown."""
        return shown_value(self.value)


def shown_value(value: Any) -> str:
    """Return a value as orip.toml has it, a text without quotation marks."""
    if value is None:
        return NOT_GIVEN
    return value if isinstance(value, str) else toml_value(value)


def values_of(kind: RecordKind, table: Mapping[str, Any], ground_unit: str) -> list[RecordValue]:
    """Return all values of a record but its name; tables in it are taken apart, and what is not given is None."""
    form = TABLE_OF_KIND[kind]
    values = []
    for key in keys_of(form):
        if key != "name":
            flat = dict(_flat(key, table.get(key)))
            values += [RecordValue(path, value, _unit(path, value, ground_unit)) for path, value in flat.items()]
    return values


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{path}.{key}", inner)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for item in value:
            yield from _flat(f"{path}.{item['name']}", {key: item[key] for key in item if key != "name"})
    else:
        yield path, None if value == [] else value


def _unit(path: str, value: Any, ground_unit: str) -> str:
    if path in PHOTO_PARAMETERS[:3]:
        return ground_unit
    if path == "measurement_precision":
        return "" if isinstance(value, str) else "mm"
    return "mm" if path.startswith(("fiducials.", "ticks.")) else _UNITS.get(path, "")
