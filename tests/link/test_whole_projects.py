"""From the measurements of a project over the adjustment and the line to the plates: back where it was measured."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from cli.command_line import orip
from link.served import served
from support.driven_projects import ZURICH_MODELS, add_models, expected_positions, measured
from support.sample_projects import sample
from workflow.commands import write_drive_table
from workflow.quiet import run_quietly

from orip.multimodel.link.client import ProcessorFault, open_link
from orip.multimodel.link.station import bare_stages
from orip.multimodel.movement import automatic, change_model, drive_object
from orip.multimodel.readout import object_position
from orip.multimodel.table_step import load_drive_table

LINE = 5.1e-4
"""Plate units: what is on the line is rounded to the least count of 0.001."""

ROUNDED = 5.1e-5
"""Metres: object coordinates have four decimals on the line."""


@pytest.fixture(scope="module")
def cliff(tmp_path_factory):
    folder = sample(tmp_path_factory.mktemp("cliff"), "small_frame_block")
    (solved,) = run_quietly(folder)
    return folder, solved.solution, write_drive_table(folder, None)


@pytest.fixture(scope="module")
def zurich(tmp_path_factory):
    folder = add_models(sample(tmp_path_factory.mktemp("zurich"), "zurich_city_hall"), ZURICH_MODELS)
    (solved,) = run_quietly(folder)
    return folder, solved.solution, write_drive_table(folder, None)


def seen_in_models(solution, block):
    """Yield every model with every adjusted point that both its photos show."""
    rows = {name: row for row, name in enumerate(solution.points.names)}
    seen: dict[str, set[str]] = {}
    for kind, photo, point in zip(
        solution.residuals.kind, solution.residuals.photo, solution.residuals.point, strict=True
    ):
        if kind == "photo":
            seen.setdefault(photo.upper(), set()).add(point)
    for model in block.models:
        left, right = model.photos
        for point in sorted(seen[left.name] & seen[right.name]):
            yield model, point, tuple(solution.points.values[rows[point]].tolist())


def last_mounting(folder, table):
    """Return what was measured of the photos of templates since these were mounted for the last time."""
    on = {photo.name: photo.template for photo in table.photos}
    day1, day2 = measured(folder / "DAY1.MEA"), measured(folder / "DAY2.MEA")
    day1 = {key: xy for key, xy in day1.items() if on.get(key[0]) == "RIGHT"}
    return day1 | {key: xy for key, xy in day2.items() if key[0] in on}


def drive_to_all(solution, outcome, expected):
    """Drive over the line to every point in every model; return how far plates are off, and the codes of refusals."""
    block, _ = load_drive_table(outcome.path.read_bytes())
    expected = {(photo.upper(), point): xy for (photo, point), xy in expected.items()}
    differences, refused = [], []
    with served(bare_stages()) as port, open_link(f"tcp://127.0.0.1:{port}") as link:
        link.download(outcome.path.read_bytes())
        link.automatic(False)
        for model, point, xyz in seen_in_models(solution, block):
            link.change_model(model.name)
            try:
                driven = link.drive_object(*xyz)
            except ProcessorFault as fault:
                refused.append(fault.code)
                continue
            assert driven.model == model.name
            assert link.position("PLATE") == (driven.upper, driven.lower)
            for photo in model.photos:
                if (photo.name, point) in expected:
                    found = driven.upper if photo.stage == "UPPER" else driven.lower
                    differences.append(np.abs(np.subtract(found, expected[photo.name, point])).max())
            shown, back = link.position("PHOTO"), link.position("OBJECT")
            assert np.abs(np.subtract(back.xyz, xyz)).max() < ROUNDED
            link.drive_object(*back.xyz)
            for before, after in zip(shown, link.position("PHOTO"), strict=True):
                # 0.05 mm on the ground, from 50 m or more, is less than the last decimal in the photo
                assert np.abs(np.subtract(after.xy, before.xy)).max() < 1.01e-4
    return differences, refused


def test_cliff_every_point_in_every_model(cliff):
    """Measured coordinate plus residual, taken to the plate: known for photos on the last mountings alone."""
    folder, solution, outcome = cliff
    expected = expected_positions(solution, outcome.table, last_mounting(folder, outcome.table))
    differences, refused = drive_to_all(solution, outcome, expected)
    assert refused == []
    assert len(differences) > 250
    assert max(differences) < LINE


def test_cliff_within_the_residuals_that_are_printed(cliff):
    """Against what was measured itself, the plates are off by what residuals.csv has, and by no more than rounding."""
    folder, solution, outcome = cliff
    printed: dict[tuple[str, str], dict[str, float]] = {}
    with (folder / "residuals.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["kind"] == "photo":
                printed.setdefault((row["photo"], row["point"]), {})[row["component"]] = float(row["residual"])
    log = last_mounting(folder, outcome.table)
    block, state = load_drive_table(outcome.path.read_bytes())
    state, _ = automatic(block, state, False)
    compared = 0
    for model, point, xyz in seen_in_models(solution, block):
        state, _ = drive_object(block, change_model(block, state, model.name)[0], xyz)
        for photo in model.photos:
            if (photo.name, point) in log:
                plate = state.plate(photo.stage)
                off = np.hypot(*np.subtract(plate, log[photo.name, point]))
                residual = np.hypot(*printed[photo.name, point].values())
                # film shrinks by 0.06 % at the most; residuals are printed with 1e-6 mm or better
                assert off == pytest.approx(residual, rel=1e-3, abs=2e-6)
                compared += 1
    assert compared > 250


def test_cliff_plate_to_object_to_plate(cliff):
    _, solution, outcome = cliff
    block, state = load_drive_table(outcome.path.read_bytes())
    state, _ = automatic(block, state, False)
    for model, _point, xyz in seen_in_models(solution, block):
        state, _ = drive_object(block, change_model(block, state, model.name)[0], xyz)
        back, _ = drive_object(block, state, object_position(block, state).xyz)
        assert np.abs(np.subtract(back.plates, state.plates)).max() < 1e-6


def test_zurich_every_point_in_pixels(zurich):
    folder, solution, outcome = zurich
    log = measured(folder / "ZURICH.MEA")
    expected = expected_positions(solution, outcome.table, log)
    differences, refused = drive_to_all(solution, outcome, expected)
    assert len(differences) > 50
    assert refused == [311] * len(refused)  # what fits best is beyond the border of the frame
    assert len(refused) < 5
    assert max(differences) < LINE


def test_cliff_by_the_commands(cliff):
    folder, _, outcome = cliff
    with served(bare_stages()) as port:
        link = ("--link", f"tcp://127.0.0.1:{port}")
        loaded = orip(folder, "drive", "download", *link, "--json").document
        assert (loaded["file"], loaded["changed"], loaded["models"]) == ("MAIN.DRV", False, 10)
        x, y, z = outcome.table.start
        # negative numbers are coordinates
        for xyz in ((x, y, z), (x, -y, z)):
            said = orip(folder, "drive", "goto", *(f"{value:.4f}" for value in xyz), *link, "--json")
            assert said.code == 0, said.err
            found = orip(folder, "drive", "where", *link, "--json").document
            assert found["ground"] == pytest.approx(xyz, abs=1.01e-4)
            assert found["upper"] == said.document["upper"]
