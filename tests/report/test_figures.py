"""Every figure on the page is that of result.json, to the digits that are shown."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

import pytest
from report.sample_pages import SAMPLES, Page, PageTable, sample
from workflow.small_projects import REPOSITORY

LISTS = ("iterations", "check_points", "blunders", "singular")


def agrees(shown: str, figure: Any) -> bool:
    """Tell whether a cell shows a figure: a word, or a number rounded to its last digit."""
    if figure is None:
        return shown in {"constant", "–"}
    if figure == "singular":
        return shown == "not determined"
    if isinstance(figure, str):
        return shown == figure
    if shown in {"constant", "–", "not determined"}:
        return False
    number = Decimal(shown)
    # half a unit of the last digit; what is exactly between two numbers may go either way in binary
    allowed = Decimal(10) ** number.as_tuple().exponent * Decimal("0.500001")
    return abs(number - Decimal(figure)) <= allowed


def figures_of(record: Any, key: str) -> Any:
    for part in key.split("."):
        record = record[part]
    return record


def compared(table: PageTable, records: Any) -> Iterator[tuple[str, str, str, Any]]:
    """Yield row, column, what is shown and what it should be, for each cell with a figure."""
    for place, cells in enumerate(table.rows):
        record = records[place] if isinstance(records, list) else records[cells[0]]
        for key, shown in zip(table.keys, cells, strict=True):
            if key and not (key == "name" and isinstance(records, dict)):
                yield cells[0], key, shown, figures_of(record, key)


def assert_agreement(table: PageTable, records: Any) -> int:
    cells = list(compared(table, records))
    wrong = [cell for cell in cells if not agrees(cell[2], cell[3])]
    assert wrong == []
    return len(cells)


@pytest.mark.parametrize("name", SAMPLES)
class TestSample:
    def test_key_figures(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        assert set(page.figures) == {
            "status", "sigma0", "sigma0_all", "observations", "unknowns", "redundancy", "redundancy_used", "enp", "run",
        }  # fmt: skip
        for key, shown in page.figures.items():
            assert shown == str(found.result[key])

    def test_points_and_photos(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        for what, figures in (("points", 8), ("photos", 12)):
            table = page.table(what)
            assert {row[0] for row in table.rows} == set(found.result[what])
            assert assert_agreement(table, found.result[what]) == figures * len(table.rows)

    def test_cameras(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        for camera, parameters in found.result["cameras"].items():
            table = page.table(f"cameras.{camera}")
            shown = {row[0] for row in table.rows}
            assert assert_agreement(table, parameters) == 2 * len(shown)
            left_out = [parameters[parameter] for parameter in set(parameters) - shown]
            assert all(parameter == {"value": 0.0, "sd": None} for parameter in left_out)

    def test_lists(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        for what in LISTS:
            if found.result[what]:
                table = page.table(what)
                assert len(table.rows) == len(found.result[what])
                assert assert_agreement(table, found.result[what]) > 0
            else:
                assert what not in {table.records for table in page.tables}

    def test_correlations(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        expected = {
            (correlation["a"], correlation["b"]): correlation["r"] for correlation in found.result["correlations"]
        }
        shown = 0
        for camera, rows in page.matrices.items():
            names = [f"{camera}.{row[0]}" for row in rows]
            for a, row in zip(names, rows, strict=True):
                for b, cell in zip(names, row[1:], strict=True):
                    shown += a != b
                    assert a == b or agrees(cell, expected.get((a, b), expected.get((b, a))))
        assert shown == 2 * len(expected)

    def test_diagnosis_and_inputs(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        words = "".join(page.words)
        for finding in (*found.result["diagnosis"], *found.result["warnings"]):
            assert all(text in words for text in finding.values())
        inputs = next(table for table in page.tables if not table.records and "SHA-256" not in table.keys and table.rows
                      and len(table.rows[0]) == 2)  # fmt: skip
        shown = dict(inputs.rows)
        measured = {file: shown.pop(file) for file in list(shown) if file.endswith(".MEA")}
        assert shown == found.result["inputs"]
        folder = REPOSITORY / "sample_projects" / name
        assert measured == {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("*.MEA")}

    def test_what_is_drawn_in_three_dimensions(self, name: str) -> None:
        found, page = sample(name), Page(sample(name).page)
        block = json.loads(page.data)
        # the view has six digits of the block's extent, up to 250 m here
        for what, coordinates in (("points", "XYZ"), ("photos", ("X0", "Y0", "Z0"))):
            assert block[what]["names"] == list(found.result[what])
            for record, place in zip(block[what]["names"], block[what]["xyz"], strict=True):
                for axis, coordinate in enumerate(coordinates):
                    figure = found.result[what][record][coordinate]["value"]
                    assert place[axis] + block["origin"][axis] == pytest.approx(figure, abs=1e-3)
        assert block["points"]["kinds"] == [point["kind"] for point in found.result["points"].values()]


def test_a_cell_that_is_off_by_one_digit_is_found() -> None:
    assert agrees("0.12", 0.1249)
    assert not agrees("0.12", 0.1251)
    assert agrees("-3.10e-05", -3.101098748351471e-05)
    assert not agrees("-3.11e-05", -3.101098748351471e-05)
    assert not agrees("constant", 0.0)
