"""Every place that prints an observation gives it the unit of its kind."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from files.hand_built_solutions import awkward, residuals

from orip.files.listings.bundle_residuals import component_columns
from orip.files.listings.errors import error_listing_lines
from orip.records.definition import BundleDefinition
from orip.records.observation_kinds import OBSERVATION_KINDS
from orip.records.results.solution import Blunder, Solution
from orip.report.report_input import ReportInput
from orip.report.table import PageTable
from orip.report.trouble import blunder_table, suspect_table, suspects
from orip.structs import replace

OBSERVATIONS = {
    ("photo", "x"): "mm",
    ("control", "Z"): "foot",
    ("additional", "EBNER.1"): "",
    ("element", "Z0"): "foot",
    ("element", "KAPPA"): "degrees",
    ("element", "C"): "mm",
    ("element", "A3"): "mm^-2",
    ("constant element", "R"): "degrees",
    ("distance", "XYZ"): "foot",
    ("constant distance", "XY"): "foot",
    ("direction", "zenith"): "degrees",
    ("station", "Z"): "foot",
    ("attitude", "PHI"): "degrees",
    ("constant station", "X"): "foot",
    ("constant attitude", "KAPPA"): "degrees",
    ("difference", "X"): "foot",
    ("difference", "OMEGA"): "degrees",
    ("antenna", "VX"): "foot/s",
    ("mounting", "OX"): "foot",
    ("line", "side"): "foot",
    ("plane", "distance"): "foot",
    ("cylinder", "distance"): "foot",
    ("height", "Z"): "foot",
    ("terrain", "Z"): "foot",
    ("given direction", "across"): "degrees",
    ("motion", "WX"): "degrees/s",
}
"""Unit by kind and component, in a project in feet."""


def misfitting() -> Solution:
    """Return a solution whose observations of all kinds are down-weighted blunders."""
    rows = [
        (kind, "P1" if kind == "photo" else "", f"N{k}", component, 100.0, 40.0, 1.0, 40.0, 0.1, 0.5, 40.0)
        for k, (kind, component) in enumerate(OBSERVATIONS)
    ]
    blunders = tuple(
        Blunder(k, kind, "", f"N{k}", component, 80.0, 1.0, 40.0, 3.5)
        for k, (kind, component) in enumerate(OBSERVATIONS)
    )
    return replace(awkward(), ground_unit="foot", residuals=residuals(tuple(rows)), blunders=blunders)


def test_all_kinds_are_looked_at() -> None:
    assert {kind for kind, _ in OBSERVATIONS} == set(OBSERVATION_KINDS)


def test_tables_of_residuals_have_the_unit_of_the_kind() -> None:
    solution = misfitting()
    columns = component_columns(solution.residuals, range(len(OBSERVATIONS)), solution.ground_unit)
    (units,) = (column.cells for column in columns if column.heading == "Unit")
    assert list(units) == list(OBSERVATIONS.values())


def test_blunders_have_the_unit_of_the_kind() -> None:
    lines = "\n".join(error_listing_lines(misfitting(), ()))
    blunders = lines.partition("BLUNDERS")[2].partition("DOWN-WEIGHTED")[0]
    for k, ((_, component), unit) in enumerate(OBSERVATIONS.items()):
        assert re.search(rf"N{k} +{re.escape(component)} +80\.\d+ +1\.\d+ +{re.escape(unit)} +40\.00", blunders)


@pytest.mark.parametrize("table", [suspect_table, blunder_table])
def test_tables_of_the_report_have_the_unit_of_the_kind(table: Callable[[ReportInput], PageTable | None]) -> None:
    found = table(ReportInput(misfitting(), (), BundleDefinition("MAIN"), {}, {}))
    assert found is not None
    (names, units) = (column.cells for column in found.columns if column.heading in {"Observation", "Unit"})
    by_name = {name.rpartition(" ")[2]: unit for name, unit in zip(names, units, strict=True)}
    assert by_name == {f"N{k}": unit for k, unit in enumerate(OBSERVATIONS.values())}


@pytest.mark.parametrize(("place", "unit"), list(enumerate(OBSERVATIONS.values())))
def test_sizes_of_errors_have_the_unit_of_the_kind(place: int, unit: str) -> None:
    found = {name.rpartition(" ")[2]: sizes for name, sizes in suspects(misfitting()).items()}
    kind, component = list(OBSERVATIONS)[place]
    # the component of an element is in its name
    begins = [] if kind.endswith("element") else [component]
    assert [row.split() for row in found[f"N{place}"]] == [[*begins, "-80.0", *unit.split()]]
