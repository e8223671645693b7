"""What is handed over: the client's report and the calibration certificate, and what of the full report is printed."""

from __future__ import annotations

import re
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from files.hand_built_solutions import awkward, empty
from files.stores.store_samples import rich_solution
from report.sample_pages import Page, sample, sample_project
from report.test_page import given, large_block
from workflow.quiet import run_quietly

from orip.errors import InputError
from orip.records.definition import ReportDetails
from orip.records.results.solution import Diagnosis, Solution
from orip.report.client import MOST_ROWS, certificate_page, client_page, client_verdict
from orip.report.drawings.residual_vectors import FEWEST_PHOTOS, MOST_PHOTOS, outstanding
from orip.report.page import report_page
from orip.report.report_input import PhotoVectors
from orip.report.templates import TERMS, explained
from orip.structs import replace
from orip.workflow.adjust.report import BROWSERS, print_pdf

needs_browser = pytest.mark.skipif(
    not any(map(shutil.which, BROWSERS)), reason="prints pages: needs Chromium, Chrome or Edge"
)


def words(page: str) -> str:
    return " ".join("".join(Page(page).words).split())


def quiet(**changed: object) -> Solution:
    """Return the small block without anything to complain of."""
    solution = sample("small_frame_block").solution
    residuals = solution.residuals
    taking_part = ~np.isnan(residuals.weight_factor)
    sound = replace(
        residuals, weight_factor=np.where(taking_part, 1.0, np.nan), w=np.minimum(np.abs(residuals.w), 1.0),
    )  # fmt: skip
    return replace(
        solution,
        **{"status": "converged", "diagnosis": (), "warnings": (), "residuals": sound, "groups": (), **changed},
    )


def test_a_client_reads_whether_the_result_can_be_used() -> None:
    good = client_verdict(given(quiet()))
    assert good.level == "good"
    assert good.headline.endswith("nothing speaks against using the results.")
    assert "unknowns" not in good.headline  # the words of the summary are for surveyors
    (checks,) = (sentence for sentence in good.sentences if sentence.startswith("3 check points"))
    assert "which had no influence on the results, differ from the given coordinates by 15.8 mm in X and Y" in checks
    assert "21.4 mm in Z" in checks
    weak = client_verdict(given(quiet(diagnosis=(Diagnosis("weak", "", "few rays", "measure more"),))))
    assert weak.headline == good.headline
    assert weak.sentences[-1].endswith("the full report has 1 note on it.")
    stopped = client_verdict(given(quiet(status="not_converged")))
    assert stopped.level == "bad"
    assert stopped.headline.startswith("The results must not be used: ")
    doubtful = client_verdict(given(quiet(status="doubtful")))
    assert doubtful.headline == "The results are to be used with care: observations do not fit."


@pytest.mark.parametrize("make", [awkward, empty, rich_solution])
@pytest.mark.parametrize("write", [client_page, report_page])
def test_pages_stand_whatever_a_solution_holds(make, write) -> None:
    solution = make()
    assert f"run {solution.run}" in words(write(given(solution)))


def test_the_client_page_loads_and_runs_nothing_and_has_a_place_to_sign() -> None:
    details = ReportDetails(title="Quarry <3>", client="Kalk & Co", contractor="Vermessung Huber")
    page = client_page(given(quiet(), details=details))
    assert "<script" not in page
    assert [address for address in Page(page).loaded if not address.startswith("#")] == ["data:,"]
    said = words(page)
    for wanted in ("Quarry <3>", "Place, date", "Kalk & Co", "Vermessung Huber", "Control points", "Check points"):
        assert wanted in said
    assert re.search(r'<div><p class="line"></p><p>Place, date</p><p class="line"></p><p>Kalk &amp; Co</p>', page)


def test_of_many_control_points_the_client_sees_those_that_fit_least() -> None:
    solution = sample("small_frame_block").solution
    many = MOST_ROWS + 15
    names = tuple(f"G{row}" for row in range(many))
    rows = 3 * many
    random = np.random.default_rng(2)
    w = random.uniform(0.0, 3.0, rows)
    w[3 * 7] = 9.0
    residuals = replace(
        solution.residuals, kind=("control",) * rows, photo=("",) * rows,
        point=tuple(name for name in names for _ in "XYZ"), component=("X", "Y", "Z") * many,
        **{name: np.full(rows, 0.01) for name in ("observed", "residual", "standard_residual", "a_priori")},
        weight_factor=np.ones(rows), redundancy_number=np.full(rows, 0.5), w=w,
    )  # fmt: skip
    points = replace(solution.points, names=names, values=np.zeros((many, 3)), sd=np.full((many, 3), 0.01))
    block = replace(
        solution, residuals=residuals, points=points, point_kinds=("control",) * many, point_rays=np.full(many, 4),
        check_points=(), point_correlations=np.zeros((many, 3)),
    )  # fmt: skip
    table = next(table for table in Page(client_page(given(block))).tables if table.rows[0][0].startswith("G"))
    assert len(table.rows) == MOST_ROWS
    assert "G7" in [row[0] for row in table.rows]
    assert f"The {MOST_ROWS} of {many} with the largest w are shown" in words(client_page(given(block)))


def test_the_certificate_has_what_a_camera_was_calibrated_with() -> None:
    with pytest.raises(InputError, match=r'no camera was calibrated by bundle .* unknown = \["C"'):
        certificate_page(given(replace(quiet(), cameras=replace(
            quiet().cameras, sd=np.full_like(quiet().cameras.sd, np.nan)), additional=())))  # fmt: skip


def test_reports_are_written_side_by_side(tmp_path: Path) -> None:
    folder = sample_project("dcs260_calibration", tmp_path / "DCS")
    run_quietly(folder)
    for option, name in (("--client", "client_report.html"), ("--certificate", "calibration_certificate.html")):
        for _ in range(2):  # an earlier one is replaced
            assert orip(folder, "report", option).code == 0
        assert (folder / name).is_file()
    said = words((folder / "calibration_certificate.html").read_text(encoding="utf-8"))
    solution = sample("dcs260_calibration").solution
    for wanted in (
        "Calibration certificate", "Parameters of camera DCS", "Correlation of its unknowns",
        "Largest angle between two",
        "Residuals of all photos together", "of the way to the corners", f"{solution.cameras.values[0, 0]:.3f}",
        "Calibrated by", f"Photos{len(solution.photos.names)}",
    ):  # fmt: skip
        assert wanted in said or wanted in said.replace("Photos ", "Photos")
    refused = orip(folder, "report", "--client", "--certificate")
    assert refused.code == 2
    assert "--client and --certificate are two files" in refused.err


def test_points_come_by_interest() -> None:
    table = Page(sample("small_frame_block").page).table("points")
    kinds = [row[1] for row in table.rows]
    first_ties = kinds.index("tie")
    assert kinds[:first_ties] == sorted(kinds[:first_ties], key=("control", "check").index)
    assert set(kinds[first_ties:]) == {"tie"}
    names = [row[0] for row in table.rows]
    doubted = {"1213", "1307"}
    assert set(names[first_ties : first_ties + len(doubted)]) == doubted
    largest = [max(map(float, row[6:9])) for row in table.rows[first_ties + len(doubted) :]]
    assert all(one >= other - 1e-3 for one, other in pairwise(largest))


def photo(name: str, size: float, lost: int = 0) -> PhotoVectors:
    xy = np.random.default_rng(sum(name.encode())).uniform(-10, 10, (100, 2))
    residual = np.random.default_rng(sum(name.encode()) + 1).normal(0.0, size, (100, 2))
    return PhotoVectors(name, xy, residual, np.arange(100) >= lost)


def test_photos_stand_out_by_larger_residuals_or_points_that_lost_weight() -> None:
    usual = [photo(f"P{number}", 0.003) for number in range(40)]
    assert len(outstanding(usual)) == FEWEST_PHOTOS
    usual[5], usual[20] = photo("P5", 0.006), photo("P20", 0.003, lost=30)
    usual[7], usual[8] = photo("P7", 0.005), photo("P8", 0.005)
    assert [each.photo for each in outstanding(usual)] == ["P5", "P7", "P8", "P20"]
    assert len(outstanding([*usual, *(photo(f"Q{number}", 0.01) for number in range(18))])) == MOST_PHOTOS


def test_names_of_photos_lead_to_their_figures() -> None:
    page = sample("small_frame_block").page
    ids = set(re.findall(r'<div class="one" id="([^"]+)">', page))
    assert ids
    linked = set(re.findall(r'<a href="#(residuals-\d+)">', page))
    assert linked == ids
    name = re.search(r'<div class="one" id="residuals-1">.*?<title>Residual vectors of photo (\w+),', page, re.DOTALL)
    assert name is not None
    assert f'<a href="#residuals-1">{name[1]}</a>' in page


def test_words_of_the_trade_are_explained_where_they_stand_first() -> None:
    said = str(explained("ENP <3> of the Danish method; ENP, Redundancy, several gates"))
    assert said.startswith(f'<abbr title="{TERMS["ENP"]}">ENP</abbr> &lt;3&gt; of the <abbr title=')
    assert said.count("<abbr") == 4
    assert '">gates</abbr>' in said
    assert "bluegates" in str(explained("bluegates"))


def test_degrees_of_freedom_are_whole_where_nothing_lost_weight() -> None:
    assert ">8974</data> degrees" in report_page(given(quiet(redundancy_used=8974.0)))
    assert ">8973.6</data> degrees" in report_page(given(quiet(redundancy_used=8973.61)))


def pages_printed(page: str, folder: Path) -> int:
    (folder / "page.html").write_text(page, encoding="utf-8")
    print_pdf(folder / "page.html", folder / "page.pdf", "page.pdf")
    return len(re.findall(rb"/Type\s*/Page\b(?!s)", (folder / "page.pdf").read_bytes()))


@needs_browser
@pytest.mark.long
def test_a_report_of_500_photos_has_25_pages_at_most(tmp_path: Path) -> None:
    block = large_block(500, 20_000, 6)
    assert 5 < pages_printed(report_page(block), tmp_path) <= 25
    assert 2 <= pages_printed(client_page(block), tmp_path) <= 4


@needs_browser
@pytest.mark.long
def test_a_report_of_60_photos_has_15_pages_at_most(tmp_path: Path) -> None:
    block = large_block(60, 1_500, 5)
    assert 5 < pages_printed(report_page(block), tmp_path) <= 15
    assert 2 <= pages_printed(client_page(block), tmp_path) <= 4


@needs_browser
def test_the_client_page_of_a_sample_has_four_pages_at_most(tmp_path: Path) -> None:
    assert 2 <= pages_printed(client_page(given(quiet())), tmp_path) <= 4
