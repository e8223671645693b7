"""Points on lines, planes, cylinders and at equal heights."""

from __future__ import annotations

import json

import numpy as np
import pytest
from bundle.figure_blocks import EVERY, FIGURE_ERROR, cylinder, figure_block, level, line, plane
from bundle.solving import OFF, redefined, rows, singular, solution, solved

from orip.bundle.kinds import figure as kind_of_figures
from orip.bundle.starting_state import left_out_figures, with_determined_figures
from orip.files.result.json_text import result_text
from orip.records.control import FigurePoint
from orip.report.precision import figure_table
from orip.structs import replace
from orip.workflow.adjust.results import results


def without_figures(block):
    return replace(block, figure_points=())


def figure(found, name):
    return next(one for one in found.figures if one.name == name)


def test_exact_figures_are_found():
    found = solution(figure_block(0, noise=False, **OFF).block)
    edge, roof, tank, lake = found.figures
    assert np.allclose((edge.dX, edge.dY, edge.dZ), np.array([0.8, 0.3, 0.52]) / np.linalg.norm([0.8, 0.3, 0.52]))
    assert np.allclose((edge.X, edge.Y, edge.Z), (-4.0, -3.0, 1.0))
    assert np.allclose((roof.dX, roof.dY, roof.dZ), np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0]))
    assert np.allclose((tank.dX, tank.dY, tank.dZ), (0.6, 0.8, 0.0))
    assert tank.radius == pytest.approx(1.5)
    assert pytest.approx(0.7) == lake.Z
    assert np.isnan([lake.X, lake.dZ, lake.radius, edge.radius, roof.sd_radius, lake.sd_direction]).all()
    assert [one.points for one in found.figures] == [6, 9, 12, 6]
    assert max(one.rms for one in found.figures) < 1e-9


def test_each_point_has_residuals_and_each_figure_unknowns():
    block = figure_block(1, **OFF).block
    found, without = solution(block), solution(without_figures(block))
    count = {kind: len(rows(found, kind)) for kind in ("line", "plane", "cylinder", "height")}
    assert count == {"line": 12, "plane": 9, "cylinder": 12, "height": 6}
    assert found.unknowns == without.unknowns + 4 + 3 + 5 + 1
    assert found.redundancy == without.redundancy + 39 - 13
    numbers = found.residuals.redundancy_number
    assert numbers.sum() == pytest.approx(found.redundancy, abs=1e-6)
    assert numbers[rows(found, "plane")].sum() < 9 - 3
    first = rows(found, "line")[:2]
    assert [found.residuals.component[row] for row in first] == ["side", "up"]
    assert {found.residuals.photo[row] for row in first} == {"EDGE"}


def test_the_height_of_a_level_is_that_of_the_least_squares_mean():
    """One level of points that photos hardly see against it: closed form, the weighted mean of the free heights."""
    made = figure_block(2, (level(),), **OFF)
    free = solved(without_figures(made.block))
    mine = [made.block.point_index()[point.point] for point in made.block.figure_points]
    covariance = _covariance(free, mine) + FIGURE_ERROR**2 * np.eye(len(mine))
    weight = np.linalg.inv(covariance)
    ones = np.ones(len(mine))
    mean = ones @ weight @ free.state.points[mine, 2] / (ones @ weight @ ones)
    found = solution(made.block)
    lake = found.figures[0]
    assert pytest.approx(float(mean), abs=1e-5) == lake.Z
    assert lake.sd_place / found.sigma0 == pytest.approx(float((ones @ weight @ ones) ** -0.5), rel=1e-4)


def _covariance(free, mine):
    """Return the cofactors of the heights of some points, from the whole normal matrix."""
    design = free.equations.design[free.equations.active].toarray()
    used = ~free.problem.layout.fixed
    cofactors = np.zeros((len(used), len(used)))
    cofactors[np.ix_(used, used)] = np.linalg.inv(design[:, used].T @ design[:, used])
    columns = free.problem.unknowns.points[mine, 2]
    return cofactors[np.ix_(columns, columns)]


def test_points_become_as_precise_across_a_figure_as_it_is():
    block = figure_block(3, **OFF, error=0.0005).block
    found, without = solution(block), solution(without_figures(block))
    place = block.point_index()
    heights = [place[f"L{number}"] for number in range(6)]
    ratio = (found.points.sd / found.sigma0)[heights, 2] / (without.points.sd / without.sigma0)[heights, 2]
    assert ratio.max() < 0.8


@pytest.mark.parametrize("most_tied", [0, 500])
def test_the_result_does_not_depend_on_which_points_are_eliminated(monkeypatch, most_tied):
    block = figure_block(4, **OFF).block
    usual = solution(block)
    monkeypatch.setattr(kind_of_figures, "_MOST_TIED", most_tied)
    found = solution(block)
    assert np.allclose(found.points.values, usual.points.values, atol=1e-9)
    assert np.allclose(found.points.sd, usual.points.sd, rtol=1e-6)
    assert found.sigma0 == pytest.approx(usual.sigma0, rel=1e-9)


@pytest.mark.parametrize("made", EVERY, ids=lambda one: one.name)
def test_figures_are_found_from_rough_coordinates_with_a_wrong_point(made):
    truth = figure_block(5, (made,), **OFF)
    random = np.random.default_rng(6)
    rough = truth.block.point_start + 0.05 * random.normal(size=truth.points.shape)
    rough[truth.block.point_index()[f"{made.name[0]}1"]] += [3.0, -2.0, 4.0]
    found = solution(replace(truth.block, point_start=rough))
    assert found.status == "converged"
    assert np.allclose(found.points.values, solution(truth.block).points.values, atol=1e-6)


def test_a_free_network_has_heights_that_level_it_and_figures_that_do_not():
    made = figure_block(6, **OFF)
    free = redefined(made.block, datum="free")
    others = replace(free, figure_points=tuple(one for one in free.figure_points if one.kind != "HEIGHT"))
    levelled, floating = solved(free), solved(others)
    # of seven movements a level determines the two rotations about horizontal axes
    assert (levelled.problem.defect, floating.problem.defect) == (5, 7)
    assert levelled.variance.sigma0 == pytest.approx(1.0, abs=0.1)
    # the form of the block is that of one with control
    freed, held = solution(others), solution(replace(made.block, figure_points=others.figure_points))
    assert _form(freed) == pytest.approx(_form(held), rel=1e-3)


def _form(found):
    """Return the radius of the cylinder over the distance of two points."""
    place = dict(zip(found.points.names, found.points.values, strict=True))
    return figure(found, "TANK").radius / float(np.linalg.norm(place["N5"] - place["N9"]))


def test_points_that_are_off_their_figure_lose_weight():
    block = figure_block(7).block
    spoilt = replace(block, figure_points=(*block.figure_points, FigurePoint("ROOF", "PLANE", "N3", FIGURE_ERROR)))
    found = solution(spoilt)
    weights = {found.residuals.point[row]: found.residuals.weight_factor[row] for row in rows(found, "plane").tolist()}
    assert weights["N3"] < 0.01
    assert min(weight for name, weight in weights.items() if name != "N3") > 0.9


@pytest.mark.parametrize(
    ("made", "kind", "least"),
    [(line(count=2), "line", 3), (plane(count=3), "plane", 4), (cylinder(count=5), "cylinder", 6),
     (level(count=1), "equal height", 2)],
    ids=lambda value: str(getattr(value, "name", value)),
)  # fmt: skip
def test_figures_with_too_few_points_say_nothing(made, kind, least):
    points = figure_block(0, (made,)).block.figure_points
    (warning,) = left_out_figures(points, {point.point for point in points})
    assert warning.code == "figure-left-out"
    assert warning.where == f"{kind} {made.name}"
    assert f"fewer than {least}" in warning.text


def test_figures_that_their_points_do_not_determine_are_left_out():
    edge = line()
    on_a_line = replace(plane(count=6), points=edge.points)
    flat = replace(cylinder(count=9), points=plane().points)
    in_one_place = replace(edge, name="DOT", points=edge.points[:1] + 0.001 * np.arange(6)[:, None])
    for made, text in (
        (on_a_line, "its points lie on one line"), (flat, "its points lie on one plane"),
        (in_one_place, "its points lie all in one place"),
    ):  # fmt: skip
        block = figure_block(0, (made, level()), noise=False).block
        kept, (warning,) = with_determined_figures(block)
        assert text in warning.text
        assert {point.figure for point in kept.figure_points} == {"LAKE"}
    whole = figure_block(0).block
    assert with_determined_figures(whole) == (whole, [])


def test_a_figure_whose_points_are_nearly_on_a_line_is_said_to_be_undetermined():
    block = figure_block(0, (replace(plane(), points=np.linspace([3.0, 3.0, 1.0], [5.0, 4.0, 1.5], 9)),), noise=False)
    found = solution(redefined(block.block, **OFF))
    assert ("ROOF", "TILT1") in singular(found) or ("ROOF", "TILT2") in singular(found)
    assert figure(found, "ROOF").sd_direction == np.inf


def test_points_that_are_too_precise_are_refused():
    block = figure_block(0, error=1e-9).block
    with pytest.raises(Exception, match="less than a ten-thousandth of a photo error"):
        solved(block)


def test_figures_are_listed_everywhere():
    found = solution(figure_block(8, **OFF).block)
    document = json.loads(result_text(found))["figures"]
    assert document["TANK"]["radius"] == pytest.approx(1.5, abs=0.01)
    assert document["LAKE"]["X"] is None
    lines = results(found, "figures", ("TANK",)).text.splitlines()
    assert lines[-1].split()[:3] == ["TANK", "CYLINDER", "12"]
    assert figure_table(found).columns[0].cells == ["EDGE", "ROOF", "TANK", "LAKE"]
