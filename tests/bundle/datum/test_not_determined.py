"""Blocks that their observations do not determine: never "converged", whatever the iterations end with."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from bundle.fifty_digits import deviations_of_photos_and_points
from bundle.solving import OFF, redefined, solution, solved
from cli.command_line import Said, orip
from support.long_cases import every
from support.synthetic_block import synthetic_block

from orip.bundle.datum.free_datum import information_on_movements
from orip.bundle.datum.movements import movements_of_block
from orip.bundle.ground_system import not_determined
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.structs import replace

BLOCKS = Path(__file__).parents[1] / "undetermined_blocks"
ABOUT_LINE = "the ground system is not fixed ({} control points); free: 1 rotation about the line of the control points"


def run(folder: Path, name: str) -> tuple[Said, dict[str, object]]:
    """Run a project in a copy, and return what was said and its result."""
    shutil.copytree(BLOCKS / name, folder / name)
    said = orip(folder / name, "run")
    return said, json.loads((folder / name / "result.json").read_text(encoding="utf-8"))


def test_control_on_a_line_is_not_converged_with_a_rotation_of_86_degrees(tmp_path: Path) -> None:
    said, result = run(tmp_path, "collinear_control")
    assert said.code == 4
    assert f"not determined: {ABOUT_LINE.format(5)}" in said.told
    assert "converged" not in said.told
    assert result["status"] == "not_determined"
    assert "NOT DETERMINED" in (tmp_path / "collinear_control" / "BUNDLE_RESULT.OUT").read_text(encoding="utf-8")
    shown = orip(tmp_path / "collinear_control", "status", "--json")
    (step,) = [row for row in shown.document["steps"] if "solve" in row["command"] or "report" in row["command"]]
    assert step["state"] == "failed"
    assert "not determined" in step["text"]
    assert orip(tmp_path / "collinear_control", "update", "photos").code == 4


@pytest.mark.parametrize(
    ("name", "free"),
    [
        ("no_control_affinity", "(no control points); free: 3 shifts, 3 rotations and scale"),
        ("control_within_a_millimetre", "(4 control points); free: 1 rotation about the line of the control points"),
    ],
)
def test_iterations_whose_first_step_lost_all_photo_points_do_not_converge(
    name: str, free: str, tmp_path: Path
) -> None:
    said, result = run(tmp_path, name)
    assert said.code == 4
    assert result["status"] not in ("converged", "doubtful")
    assert f"the ground system is not fixed {free}" in said.told
    unknowns, removed = result["unknowns"], result["singular"]
    assert isinstance(unknowns, int)
    assert isinstance(removed, list)
    assert len(removed) < unknowns / 2


def beside_a_line(off: float, error: float) -> Block:
    """Return a block with four control points `off` a line, this way and that, without noise."""
    made = synthetic_block("convergent", "control beside a line")
    points = made.points.copy()
    points[:4] = [[-0.5, off, 0.0], [-0.2, -off, 0.0], [0.2, off, 0.0], [0.5, -off, 0.0]]
    names = made.block.point_names
    seen = made.block.photo_points
    c = made.cameras[0, 0]
    xy = seen.xy.copy()
    for row in np.flatnonzero(seen.point < 4):
        given = made.orientations[seen.photo[row]]
        u = rotation(given[3:]).T @ (points[seen.point[row]] - given[:3])
        xy[row] = -c * u[:2] / u[2]
    control = tuple(ControlPoint(names[row], tuple(points[row].tolist()), (error,) * 3) for row in range(4))
    block = replace(made.block, photo_points=replace(seen, xy=xy), control_points=control, point_start=points)
    return redefined(block, **OFF)


def rotation(angles: np.ndarray) -> np.ndarray:
    """Return R by omega, phi, kappa, as docs/conventions.md writes it."""
    (so, sp, sk), (co, cp, ck) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [cp * ck, -cp * sk, sp],
            [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
            [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
        ]
    )


@pytest.mark.parametrize(("off", "determined"), [(0.05, True), (0.01, True), (0.001, False), (0.0, False)])
def test_the_rotation_about_a_line_is_free_above_eleven_degrees(off: float, *, determined: bool) -> None:
    error = 0.002
    found = solved(beside_a_line(off, error))
    told = not_determined(found)
    assert found.converged
    # closed form: the rotation about the line has the deviation error / sqrt(4 off^2), 23 degrees with an off of 0.0025
    assert (error < 0.2 * 2.0 * off) == determined
    assert (not told) == determined
    assert determined or told[0].text == ABOUT_LINE.format(4)


def test_information_on_rotations_and_scale_is_that_of_the_closed_form() -> None:
    found = solved(beside_a_line(0.05, 0.002))
    state, unknowns = found.state, found.problem.unknowns
    start = len(found.problem.observations[0].rows.used)
    design = found.equations.design[start:]
    information = information_on_movements(state, unknowns, design, np.ones(design.shape[0]))
    about = state.points[:4] - state.points.mean(axis=0)
    # rotations about the centre of all points: the inertia of the control over the square of its error
    inertia = np.sum(about**2) * np.eye(3) - about.T @ about
    np.testing.assert_allclose(information[3:6, 3:6], inertia / 0.002**2, rtol=1e-9)
    np.testing.assert_allclose(information[6, 6], np.sum(about**2) / 0.002**2, rtol=1e-9)
    size = movements_of_block(state, unknowns).size
    np.testing.assert_allclose(information[:3, :3], 4 * size**2 / 0.002**2 * np.eye(3), atol=1e-6)


@pytest.mark.parametrize("scene", ["strip", "convergent", "terrestrial"])
def test_blocks_that_are_well_fixed_are_determined(scene: str) -> None:
    made = synthetic_block(scene, "determined", noise_mm=0.005)  # type: ignore[arg-type]
    assert not_determined(solved(redefined(made.block, **OFF))) == ()


def test_a_strip_with_control_at_one_end_is_weak_but_determined() -> None:
    made = synthetic_block("strip", "control at one end", noise_mm=0.005)
    block = made.block
    place = block.point_index()
    west = sorted(block.control_points, key=lambda point: made.points[place[point.name], 0])[:4]
    assert not_determined(solved(redefined(replace(block, control_points=tuple(west)), **OFF))) == ()


def frontal_board(unknown: tuple[str, ...]) -> Block:
    """Return four vertical photos of a flat board, all its points control; the photos are exactly frontal."""
    made = synthetic_block("convergent", "frontal board", unknown=unknown)
    block, random = made.block, np.random.default_rng(7)
    points = np.zeros_like(made.points)
    points[:, :2] = random.uniform((-0.4, -0.25), (0.4, 0.25), size=(len(points), 2))
    orientations = np.zeros_like(made.orientations)
    orientations[:, :2] = random.uniform(-0.1, 0.1, size=(len(orientations), 2))
    orientations[:, 2] = 1.5
    seen, c = block.photo_points, made.cameras[0, 0]
    u = points[seen.point] - orientations[seen.photo, :3]
    xy = -c * u[:, :2] / u[:, 2:] + 0.001 * random.normal(size=seen.xy.shape)
    control = tuple(
        ControlPoint(name, tuple(points[row].tolist()), (1e-4,) * 3) for row, name in enumerate(block.point_names)
    )
    # a start that is exact: what is not determined must not depend on it
    return redefined(
        replace(
            block,
            photo_points=replace(seen, xy=xy, error=np.full_like(seen.error, 0.001)),
            control_points=control,
            point_start=points,
            photo_orientation=orientations,
        ),
        **OFF,
    )


@pytest.mark.parametrize("unknown", [("C",), ("C", "DX", "DY")])
def test_a_flat_board_seen_from_the_front_leaves_the_camera_free_and_not_its_photos(unknown: tuple[str, ...]) -> None:
    found = solution(frontal_board(unknown))
    held = solution(frontal_board(()))
    assert {name.group for name in found.singular} == {"CAMERA"}
    assert {name.kind for name in found.singular} <= set(unknown)
    assert found.status == "converged"
    assert "C" in {name.kind for name in found.singular}
    assert np.isfinite(found.photos.sd).all()
    if unknown == ("C",):
        # with C held the photos are what they are with a known camera
        np.testing.assert_allclose(found.photos.sd, held.photos.sd, rtol=0.02)
        np.testing.assert_allclose(found.photos.values, held.photos.values, atol=1e-6)
    assert any("C" in told.text and "cannot be determined" in told.text for told in found.diagnosis)


@pytest.mark.parametrize(("size", "error"), every(3, [(1e6, 1e6), (1.0, 1e-7), (1e3, 1e-7)]))
def test_standard_deviations_are_those_of_50_digits(size: float, error: float) -> None:
    made = synthetic_block("convergent", "fifty")
    block = redefined(made.block, **OFF)
    orientation = block.photo_orientation * np.repeat([size, 1.0], 3)
    control = tuple(
        replace(point, coordinates=tuple(size * value for value in point.coordinates), errors=(error,) * 3)
        for point in block.control_points[:4]
    )
    start = size * block.point_start
    found = solved(replace(block, control_points=control, photo_orientation=orientation, point_start=start))
    photos, points = deviations_of_photos_and_points(found)
    unknowns, reduced = found.problem.unknowns, found.problem.layout.reduced
    assert not found.normals.removed.any()
    blocks = found.cofactors.blocks[(unknowns.points[:, 0] - reduced) // 3]
    # rounding of the 16 digits of numbers, times the digits lost: ten with control as good as the block is large
    allowed = 1e-15 * 10.0 ** (float(found.normals.lost_digits.max()) + 2.0)
    np.testing.assert_allclose(np.sqrt(np.diag(found.cofactors.reduced))[unknowns.photos], photos, rtol=allowed)
    np.testing.assert_allclose(np.sqrt(np.einsum("nii->ni", blocks)), points, rtol=allowed)
