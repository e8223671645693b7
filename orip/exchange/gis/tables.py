"""Points and photos as CSV, numbers with all digits; empty where nothing is known."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path

from orip.exchange.gis.layers import Layer, photo_layer, point_layer
from orip.records.exchanged import ExchangedProject


def write_tables(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return points.csv and photos.csv."""
    return {f"{layer.name}.csv": _table(layer) for layer in (point_layer(project), photo_layer(project))}


def _table(layer: Layer) -> bytes:
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    rows.writerow(["name", *layer.columns])
    for name, values in zip(layer.names, layer.values.tolist(), strict=True):
        rows.writerow([name, *("" if math.isnan(value) else repr(value) for value in values)])
    return stream.getvalue().encode("utf-8")
