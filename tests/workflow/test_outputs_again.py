"""Listings that are written again from the stores: the same to the byte, as long as the measurements are the same."""

from __future__ import annotations

from pathlib import Path

from workflow.commands import initialise, measure
from workflow.quiet import run_quietly
from workflow.small_projects import film_project, replace_in


def test_a_lost_listing_is_the_same_again(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    run_quietly(folder)
    listing = folder / "BUNDLE_RESULT.OUT"
    before = listing.read_text(encoding="utf-8")
    assert "  115.6462    90.1918 " in before  # point 2 on the plate, 100 mm away from the photo coordinates
    listing.unlink()
    initialise(folder)
    assert listing.read_text(encoding="utf-8") == before


def test_after_another_measurement_a_lost_listing_has_no_measured_coordinates(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    run_quietly(folder)
    (folder / "BUNDLE_RESULT.OUT").unlink()
    lines = (folder / "FIRST.MEA").read_text(encoding="utf-8").splitlines()
    last = lines[-1]
    name, x, y = last.split()
    replace_in(folder / "FIRST.MEA", last, f"{name} {float(x) + 0.001:.4f} {y}")
    measure(folder)
    table = (folder / "BUNDLE_RESULT.OUT").read_text(encoding="utf-8").partition("PHOTO RESIDUALS")[2]
    (row,) = {line.split()[1] for line in table.splitlines() if line.startswith(f"  {name} ")}
    assert row == "-"
