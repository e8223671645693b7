"""The table of lever arm, boresight and shifts: each unknown with its largest correlation."""

from __future__ import annotations

import numpy as np
from bundle.solving import noisy, solved
from bundle.stations_of_block import MADE, stations, with_stations

from orip.bundle.results.solution import solution_of
from orip.records.definition import Antenna
from orip.report.precision import antenna_table


def test_each_unknown_has_its_largest_correlation() -> None:
    antenna = Antenna("GNSS", unknown=("LX", "LZ", "BX"), shift="strip", shift_error=(1.0, 1.0, 1.0))
    found = solved(with_stations(stations(error=0.03), antenna, noisy(MADE, 11)))
    table = antenna_table(solution_of(found))
    assert table is not None
    cells = {column.heading: column.cells for column in table.columns}
    place = {(unknown.name, unknown.kind): row for row, unknown in enumerate(found.problem.unknowns.names.reduced)}
    columns = [row for row, unknown in enumerate(found.problem.unknowns.names.reduced) if unknown.group == "ANTENNA"]
    cofactor = np.array([[found.cofactors.reduced[a, b] for b in columns] for a in columns])
    correlation = cofactor / np.sqrt(np.outer(np.diag(cofactor), np.diag(cofactor))) - np.eye(len(columns))
    names = [found.problem.unknowns.names.reduced[column] for column in columns]
    shown = 0
    for antenna_name, strip, kind, r, other in zip(
        *(cells[heading] for heading in ("Antenna", "Strip", "Parameter", "Largest r", "with")), strict=True
    ):
        column = place.get((f"{antenna_name} strip {strip}" if strip else antenna_name, kind))
        if column is None:
            assert (r, other) == ("", "")
            continue
        row = correlation[columns.index(column)]
        largest = names[int(np.argmax(np.abs(row)))]
        assert r == f"{row[np.argmax(np.abs(row))]:+.3f}"
        assert other == f"antenna {largest.name}.{largest.kind}"
        shown += 1
    assert shown == 3 + 9
    height = list(cells["Parameter"]).index("LZ")
    assert cells["with"][height].endswith(".SZ")
    assert table.emphasised == frozenset(row for row, r in enumerate(cells["Largest r"]) if r and abs(float(r)) >= 0.95)
