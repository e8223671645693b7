"""Whole projects: what is driven to is what was measured, plus the residuals that the adjustment has listed."""

from __future__ import annotations

import numpy as np
import pytest
from support.aerial_block_in_crs import CRS, aerial_block
from support.drive_tables import loaded
from support.driven_projects import ZURICH_MODELS, add_models, expected_positions, measured, residuals_of
from support.sample_projects import SAMPLES, sample
from workflow.commands import write_drive_table
from workflow.quiet import run_quietly
from workflow.small_projects import film_project

from orip.multimodel.movement import automatic, change_model, drive_object
from orip.multimodel.readout import drive_objects, object_position
from orip.multimodel.stereo_project import open_stereo, stereo_pairs
from orip.multimodel.table import object_ground
from orip.multimodel.table_step import DriveTableOutcome, load_drive_table
from orip.records.results.solution import Solution


def driven_table(folder) -> tuple[Solution, DriveTableOutcome]:
    (solved,) = run_quietly(folder)
    return solved.solution, write_drive_table(folder, None)


@pytest.fixture(scope="module")
def zurich(tmp_path_factory):
    return driven_table(add_models(sample(tmp_path_factory.mktemp("zurich"), "zurich_city_hall"), ZURICH_MODELS))


@pytest.fixture(scope="module")
def cliff(tmp_path_factory):
    folder = sample(tmp_path_factory.mktemp("cliff"), "small_frame_block")
    return folder, *driven_table(folder)


def check_photos(solution, table, expected, tolerance, xyz_of=lambda xyz: xyz):
    block, _ = loaded(table)
    rows = {name: row for row, name in enumerate(solution.points.names)}
    for photo in block.photos:
        mine = [(point, xy) for (name, point), xy in expected.items() if name.upper() == photo.name]
        assert len(mine) > 3
        found = photo.plate_places(xyz_of(solution.points.values[[rows[point] for point, _ in mine]]))
        assert np.abs(found.plate - [xy for _, xy in mine]).max() < tolerance


def test_zurich_in_pixels(zurich):
    solution, outcome = zurich
    log = measured(SAMPLES / "zurich_city_hall" / "ZURICH.MEA")
    expected = expected_positions(solution, outcome.table, log)
    assert outcome.table.plate_unit == "px"
    assert len(expected) > 100
    # 227 points are measured with six decimals; the residuals come from another function than the positions
    check_photos(solution, outcome.table, expected, 1e-8)
    # row axis down: the affine transformation turns the plate over
    for photo in outcome.table.photos:
        assert photo.affine == pytest.approx((640.0, 1280.0 / 8.245, 0.0, 512.0, 0.0, -1024.0 / 6.6), abs=1e-9)
    limits = outcome.table.upper
    assert (limits.x_min, limits.x_max, limits.y_min, limits.y_max) == (0.0, 1280.0, 0.0, 1024.0)


def test_zurich_from_model_to_model(zurich):
    """In every model every point that both photos show is driven to, and read back."""
    solution, outcome = zurich
    block, state = loaded(outcome.table)
    log = measured(SAMPLES / "zurich_city_hall" / "ZURICH.MEA")
    expected = expected_positions(solution, outcome.table, log)
    rows = {name: row for row, name in enumerate(solution.points.names)}
    state, _ = automatic(block, state, False)
    driven = 0
    for name, left, right, _, _ in ZURICH_MODELS:
        state, _ = change_model(block, state, name)
        model = block.models[state.model]
        for point in (point for photo, point in expected if photo == left and (right, point) in expected):
            xyz = tuple(solution.points.values[rows[point]].tolist())
            left_xy, right_xy = expected[left, point], expected[right, point]
            on_sensor = all((xy >= 0.0).all() and (xy <= (1280.0, 1024.0)).all() for xy in (left_xy, right_xy))
            state, reply = drive_object(block, state, xyz)
            assert (reply.__class__.__name__ == "Driven") == on_sensor
            if on_sensor:
                upper, lower = (right_xy, left_xy) if model.swapped else (left_xy, right_xy)
                assert state.plates == (pytest.approx(upper, abs=1e-8), pytest.approx(lower, abs=1e-8))
                # the photos of model A were taken 4 m from each other, 50 m from the wall
                assert object_position(block, state).xyz == pytest.approx(xyz, abs=1e-9)
                driven += 1
    assert driven > 20


def test_cliff_on_templates(cliff):
    """The photos of templates whose last mounting the log has: RIGHT of the first day, LEFT of the second."""
    folder, solution, outcome = cliff
    on = {photo.name: photo.template for photo in outcome.table.photos}
    logs = {"LEFT": measured(folder / "DAY2.MEA")}
    logs["RIGHT"] = measured(folder / "DAY1.MEA") | logs["LEFT"]
    expected = {}
    for template, log in logs.items():
        mine = {key: xy for key, xy in log.items() if on[key[0]] == template}
        expected |= expected_positions(solution, outcome.table, mine)
    used = tuple(photo for photo in outcome.table.photos if any(name == photo.name for name, _ in expected))
    assert len(used) >= 9
    block, _ = loaded(outcome.table)
    rows = {name: row for row, name in enumerate(solution.points.names)}
    for (name, point), xy in expected.items():
        found = block.photo(name).plate_place(*solution.points.values[rows[point]].tolist())
        assert found.plate == pytest.approx(xy, abs=1e-9)


def test_cliff_along_the_strips(cliff):
    """Over the mean surface of each strip every model is visited once, in its order, and the mark jumps nowhere."""
    _, solution, outcome = cliff
    block, state = loaded(outcome.table)
    for row in (1, 2):
        models = [model for model in block.models if model.row == row]
        mine = _seen_in(solution, models)
        middle = solution.points.values[mine].mean(axis=0)
        x = np.linspace(*(model.photos[side].centre[0] for model, side in ((models[0], 0), (models[-1], 1))), 2000)
        # without the first and last metres, which the outer photos show at their frame lines
        points = np.column_stack([x[50:-50], np.full(1900, middle[1]), np.full(1900, middle[2])])
        state, driven = drive_objects(block, change_model(block, state, models[0].name)[0], points)
        inside = driven.inside
        assert inside.mean() > 0.95
        names = [block.models[model].name for model in driven.model[inside]]
        assert list(dict.fromkeys(names)) == [model.name for model in models]
        assert np.count_nonzero(np.diff(driven.model)) == len(models) - 1
        for change in np.flatnonzero(np.diff(driven.model)):
            left = block.models[driven.model[change]]
            assert not all(photo.plate_place(*points[change + 1].tolist()).inside for photo in left.photos)
        for model in np.unique(driven.model):
            rows = (driven.model == model) & (driven.code == 0)
            back = block.models[model].object_places(driven.upper[rows], driven.lower[rows])
            # metres; 1e-12 mm on the plate is 3e-12 m on the cliff, 100 m away
            assert np.abs(back.xyz - points[rows]).max() < 1e-9


def _seen_in(solution, models):
    names = {photo.name for model in models for photo in model.photos}
    rows = solution.residuals
    seen = {point for photo, point in zip(rows.photo, rows.point, strict=True) if photo.upper() in names}
    return [row for row, name in enumerate(solution.points.names) if name in seen]


def test_reading_back_is_the_table(cliff):
    _, _, outcome = cliff
    assert load_drive_table(outcome.path.read_bytes()).block.table == outcome.table
    assert load_drive_table(outcome.path.read_bytes()[:-5])[0].code == 121


def test_start_is_the_mean_of_what_the_first_model_shows(cliff):
    _, solution, outcome = cliff
    residuals = residuals_of(solution)
    first = outcome.table.models[0]
    both = [point for photo, point in residuals if photo == first.left and (first.right, point) in residuals]
    rows = [solution.points.names.index(point) for point in both]
    assert outcome.table.start == pytest.approx(solution.points.values[rows].mean(axis=0), abs=1e-9)


def test_film_off_a_template(tmp_path):
    """Two photos 100 mm off the middle of the stage; their models are on the stages by turns."""
    folder = add_models(film_project(tmp_path / "film"), [("M", "left", "right", 1, 1)])
    solution, outcome = driven_table(folder)
    assert [photo.stage for photo in outcome.table.photos] == ["UPPER", "LOWER"]
    check_photos(
        solution, outcome.table, expected_positions(solution, outcome.table, measured(folder / "FIRST.MEA")), 1e-9
    )
    limits = outcome.table.upper
    assert (limits.x_max - limits.x_min, limits.y_max - limits.y_min) == pytest.approx((240.0, 240.0), abs=1.0)
    assert limits.x_min < 82.0 < 118.0 < limits.x_max
    assert [warning.code for warning in outcome.warnings if warning.code == "no-frame"] == ["no-frame"]


def test_a_block_on_the_curved_earth(tmp_path):
    """With a crs the table's object system is a local frame; images that PROJ alone predicts are found through it."""
    aerial = aerial_block()
    # corners of the raster and of its middle
    control = aerial.control(dict.fromkeys(range(len(aerial.points)), (0.01, 0.01, 0.01)))
    folder = aerial.write(tmp_path / "aerial", CRS, control)
    pair = aerial.photo_names[:2]
    solution, outcome = driven_table(add_models(folder, [("M", *pair, 1, 1)]))
    assert "local-object-frame" in [warning.code for warning in outcome.warnings]
    ground = object_ground(CRS, "m", solution)
    expected = {
        (aerial.photo_names[photo], aerial.point_names[point]): xy
        for photo, point, xy in zip(aerial.photo, aerial.point, aerial.xy, strict=True)
        if aerial.photo_names[photo] in pair
    }
    # the log has six decimals, points are rounded to 0.1 mm: 5 nm in the photo
    check_photos(solution, outcome.table, expected, 2e-5, ground.to_local)
    # in stereo: places of the project, and pairs of neighbours where the bundle has no models
    stereo = open_stereo(folder, None, dict.fromkeys(aerial.photo_names, (-115.0, -115.0, 115.0, 115.0)))
    both = [point for photo, point in expected if photo == pair[0] and (pair[1], point) in expected]
    rows = {name: row for row, name in enumerate(solution.points.names)}
    for point in both:
        stereo.drive(tuple(solution.points.values[rows[point]].tolist()))
        read = stereo.read()
        assert np.abs(read.xyz - solution.points.values[rows[point]]).max() < 1e-6
        assert np.abs(np.subtract(read.photos, [expected[photo, point] for photo in pair])).max() < 2e-5
        assert abs(read.y_parallax) < 1e-9
    models = stereo_pairs(solution, ground)
    assert len(both) > 3
    assert {name for model in models for name in (model.left, model.right)} == set(aerial.photo_names)
    assert len(models) == len(aerial.photo_names) - 1
