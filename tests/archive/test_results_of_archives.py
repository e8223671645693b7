"""Tables and overview of an archive's results, as others read them, and the comparison of two runs."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

import pytest
from cli.command_line import orip
from documentation.pages import DOCS
from files.hand_built_solutions import awkward
from support.json_schemas import schema_faults

from orip.archive.diff import Changed, Moved, changed_outcomes, changed_words, moved_values
from orip.archive.results import read_shard
from orip.archive.run_files import ArchivePlan, ResultsFolder, name_digest, read_head, write_finished, write_plan
from orip.archive.tables import SCHEMA, TABLES, AdjustedBundle, ProjectOutcome, Row, rows_of_bundles, rows_of_error
from orip.errors import InputError
from orip.records.results.solution import Solution
from orip.records.results.tests import Gate, GateResult
from orip.structs import replace

pd = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")


def written(folder: Path, solution: Solution, *, passed: bool = True) -> Path:
    """Write the results of two projects, one of which is wrong; another one has left the archive."""
    results = ResultsFolder(folder)
    names = ("a/good", "b/<bad> & ugly")
    write_plan(results, ArchivePlan(str(folder), names, "s", "reduced weights", "0.1", "", 0.0))
    gate = GateResult(Gate("sigma0", "<=", 1.5), 1.0, passed)
    bundle = AdjustedBundle(solution, (gate,), "report.html", "EPSG:25832")
    write_finished(results, ProjectOutcome(names[0], "adjusted", tables=rows_of_bundles(names[0], [bundle])), "s", 1.0)
    for name in (names[1], "gone"):
        tables = rows_of_error(name, "wrong", "A.PNT:3: <b>three</b> is no number")
        write_finished(results, ProjectOutcome(name, "wrong", tables=tables), "s", 1.0)
    assert orip(folder, "archive", "report", ".").code == 0
    return folder


def test_other_programs_read_the_tables(tmp_path: Path) -> None:
    solution = awkward()
    folder = written(tmp_path, solution)
    projects = pd.read_parquet(folder / "tables" / "projects").set_index("project")
    assert sorted(projects.index) == ["a/good", "b/<bad> & ugly"]
    assert projects.loc["a/good", "sigma0"] == solution.sigma0
    points = pd.read_parquet(folder / "tables" / "points")
    assert list(points["point"]) == list(solution.points.names)
    assert points["X"].tolist() == solution.points.values[:, 0].tolist()
    for table, columns in TABLES.items():
        assert [*columns, "shard"] == list(pd.read_parquet(folder / "tables" / table).columns)


def test_polars_and_duckdb_read_them_too(tmp_path: Path) -> None:
    polars, duckdb = pytest.importorskip("polars"), pytest.importorskip("duckdb")
    folder = written(tmp_path, awkward())
    files = str(folder / "tables" / "points" / "*" / "*.parquet")
    assert polars.read_parquet(files, hive_partitioning=True).height == len(awkward().points.names)
    query = f"select count(*) from read_parquet('{files}', hive_partitioning=true)"
    assert duckdb.sql(query).fetchall() == [(len(awkward().points.names),)]


def test_equal_results_are_equal_files(tmp_path: Path) -> None:
    one, other = (written(tmp_path / name, awkward()) / "tables" for name in ("one", "other"))
    files = sorted(path.relative_to(one) for path in one.rglob("*.parquet"))
    assert len(files) == 16 * len(TABLES)
    assert all((one / file).read_bytes() == (other / file).read_bytes() for file in files)


def test_the_overview_shows_names_as_they_are(tmp_path: Path) -> None:
    page = (written(tmp_path, awkward(), passed=False) / "index.html").read_text()
    assert "<bad>" not in page
    assert "<b>three" not in page
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])  # type: ignore[index]
    good, bad = data["rows"]
    assert (good["link"], good["failed"]) == ("a/good/report.html", ["sigma0 <= 1.5"])
    assert bad["text"] == "A.PNT:3: <b>three</b> is no number"
    assert data["gates"] == [["sigma0 <= 1.5", 1]]


def test_the_reference_names_all_columns() -> None:
    text = (DOCS / "reference" / "archive.md").read_text(encoding="utf-8")
    assert f"`{SCHEMA}`" in text
    for table, columns in TABLES.items():
        section = text.partition(f"## `{table}`\n")[2].partition("\n## ")[0]
        named = re.findall(r"`([^`]+)`", " ".join(re.findall(r"^\| ([^|]*) \|", section, re.MULTILINE)))
        assert set(columns) == {name for cell in named for name in cell.split()}, table


# what differs between two runs


def photo(x: float, sd: float | None, kappa: float = 0.0) -> Sequence[Row]:
    columns = dict.fromkeys(TABLES["photos"])
    return [
        {**columns, "project": "p", "bundle": "M", "photo": "1", "X0": x, "sd_X0": sd, "kappa": kappa, "sd_kappa": 0.1}
    ]


def test_values_that_moved_by_more_than_their_deviation() -> None:
    assert list(moved_values("photos", photo(10.0, 0.2), photo(10.15, 0.1), 1.0)) == []
    (moved,) = moved_values("photos", photo(10.0, 0.2), photo(10.3, 0.1), 1.0)
    assert (moved.name, moved.before, moved.after) == ("photo 1 X0", 10.0, 10.3)
    assert moved.times == pytest.approx(1.5)
    # constants have no deviation: any change counts
    assert list(moved_values("photos", photo(10.0, None), photo(10.1, None), 1.0)) == [
        Moved("p", "M", "photo 1 X0", 10.0, 10.1, math.inf)
    ]


def test_angles_are_compared_on_the_circle() -> None:
    assert list(moved_values("photos", photo(0.0, 1.0, -179.99), photo(0.0, 1.0, 180.0), 1.0)) == []


def test_gates_that_changed_or_are_in_one_run_alone() -> None:
    def gate(name: str, *, passed: bool) -> Row:
        return {"project": "p", "bundle": "M", "gate": name, "value": 1.0, "passed": passed}

    before = [gate("a", passed=True), gate("b", passed=True)]
    after = [gate("a", passed=False), gate("c", passed=True)]
    assert list(changed_words(before, after, "gate", ("passed",))) == [
        Changed("p", "M", "a", "pass", "FAIL"),
        Changed("p", "M", "b", "pass", ""),
        Changed("p", "M", "c", "", "pass"),
    ]


def test_a_project_that_ended_otherwise_is_told_in_one_line() -> None:
    def project(name: str, bundle: str, state: str, status: str, message: str = "") -> Row:
        return {"project": name, "bundle": bundle, "state": state, "status": status, "message": message}

    before = [project("a", "M", "adjusted", "converged"), project("b", "M", "adjusted", "converged")]
    before += [project("c", "", "wrong", "", "x.MEA:1: why"), project("d", "", "wrong", "", "as it was")]
    after = [project("a", "", "wrong", "", "orip.toml:1: why"), project("b", "M", "adjusted", "doubtful"), before[-1]]
    assert list(changed_outcomes(before, after)) == [
        Changed("a", "", "outcome", "adjusted", "wrong: orip.toml:1: why"),
        Changed("c", "", "outcome", "wrong: x.MEA:1: why", ""),
        Changed("b", "M", "status", "converged", "doubtful"),
    ]


def test_two_runs_are_compared_by_a_command(tmp_path: Path) -> None:
    solution = awkward()
    one = written(tmp_path / "one", solution)
    assert orip(tmp_path, "archive", "diff", "one", "one").code == 0
    values = solution.points.values.copy()
    values[0, 0] += 1000.0
    moved = replace(solution, points=replace(solution.points, values=values), status="not_converged")
    written(tmp_path / "other", moved, passed=False)
    said = orip(tmp_path, "archive", "diff", "one", "other")
    assert said.code == 5
    assert "a/good" in said.out
    assert "sigma0 <= 1.5: pass -> FAIL" in said.out
    assert f"status: {solution.status} -> not_converged" in said.out
    assert f"point {solution.points.names[0]} X" in said.out
    document = orip(tmp_path, "--json", "archive", "diff", "one", "other").document
    assert len(document["changed"]) == 2
    assert schema_faults(document) == []
    assert one.is_dir()


def test_rows_that_are_not_what_was_written_are_not_taken(tmp_path: Path) -> None:
    """A figure changed in what is kept of a project, or in the tables, is no figure of the archive."""
    folder = written(tmp_path, awkward())
    results = ResultsFolder(folder)
    path = results.project("a/good")
    head, rows, _ = path.read_text().split("\n")
    path.write_text(f"{head}\n{rows.replace('EPSG:25832', 'EPSG:25833')}\n")
    said = orip(folder, "archive", "report", ".")
    assert said.code == 3
    assert f"{path.name}: is damaged; remove it, and 'orip archive run' adjusts its project again" in said.err
    path.write_text(f"{head.replace('adjusted', 'sadjuted')}\n{rows}\n")
    assert read_head(results, "a/good") is None, "it is adjusted again"
    table = results.table("projects", name_digest("a/good")[0])
    content = bytearray(table.read_bytes())
    content[20] ^= 1
    table.write_bytes(content)
    with pytest.raises(InputError, match="cannot be read"):
        read_shard(results, "projects", name_digest("a/good")[0])
