"""Blocks that no control point holds: by exposure stations, by a few observed elements, or by nothing at all."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.blocks_without_control import MADE, first_model, from_nothing, off_truth
from bundle.solving import redefined, with_photo_points, with_rays
from support.synthetic_block import SyntheticBlock

from orip.bundle.antennas import with_orientations_of_stations
from orip.records.control import ControlDistance, ControlElement, Station
from orip.records.photo import PHOTO_PARAMETERS
from orip.solving.solve import solve
from orip.structs import replace


def positions(made: SyntheticBlock, rows, error: float = 0.05) -> tuple[Station, ...]:
    random = np.random.default_rng(2)
    return tuple(
        Station(
            f"P{row + 1}", tuple((made.orientations[row, :3] + error * random.normal(size=3)).tolist()), (error,) * 3
        )
        for row in rows
    )


def test_three_stations_off_one_line_and_tie_points_orient_a_block() -> None:
    found, _ = solve(replace(from_nothing(MADE), stations=positions(MADE, (0, 4, 12))))
    assert found.status == "converged"
    assert not [each for each in found.diagnosis if each.code == "datum"]
    # three times 36 coordinates: five standard deviations are exceeded by chance once in 20 000 blocks
    assert off_truth(MADE, found) < 5.0


def test_stations_on_one_line_hold_no_block_without_attitudes() -> None:
    strip = with_rays(replace(MADE, block=with_photo_points(MADE.block, MADE.block.photo_points.photo < 5)), 2)
    block = from_nothing(strip)
    block = replace(
        block,
        photos=block.photos[:5],
        photo_camera=block.photo_camera[:5],
        photo_orientation=block.photo_orientation[:5],
    )
    observed = positions(MADE, range(5))
    with_attitudes = tuple(
        replace(station, angles=tuple(angles), angle_error=(1e-4,) * 3)
        for station, angles in zip(observed, MADE.orientations[:5, 3:].tolist(), strict=True)
    )
    oriented = with_orientations_of_stations(replace(block, stations=with_attitudes))
    assert np.isfinite(oriented.photo_orientation).all()
    found, _ = solve(oriented)
    assert found.status == "converged"
    assert off_truth(strip, found) < 5.0


def test_a_first_model_from_seven_observed_elements_and_twelve_photo_points() -> None:
    """24 + 7 observations, 12 + 18 unknowns, one redundant observation: OLTRIS (Gruen 1991), section 5."""
    made, block = first_model()
    angles = np.degrees(made.orientations[0, 3:])
    values = [*made.orientations[0, :3], *angles]
    elements = [
        ControlElement("P1", "PHOTO", kind, float(value), 0.05 if kind.endswith("0") else 0.005)
        for kind, value in zip(PHOTO_PARAMETERS, values, strict=True)
    ]
    elements.append(ControlElement("P2", "PHOTO", "X0", float(made.orientations[1, 0]), 0.05))
    orientation = block.photo_orientation.copy()
    orientation[0], orientation[1, 0] = made.orientations[0], made.orientations[1, 0]
    found, _ = solve(replace(block, elements=tuple(elements), photo_orientation=orientation))
    assert (found.observations, found.unknowns, found.redundancy) == (31, 30, 1)
    assert found.status == "converged"
    assert not found.singular
    assert off_truth(made, found) < 5.0


def test_a_free_network_with_two_oriented_photos_is_in_their_system() -> None:
    block = redefined(from_nothing(MADE), datum="free")
    orientation = block.photo_orientation.copy()
    orientation[:2] = MADE.orientations[:2]
    found, _ = solve(replace(block, photo_orientation=orientation))
    assert found.status == "converged"
    expected = "origin and axes are given by the orientation of photo P1, the scale by other projection centres"
    assert any(expected in text for *_, text in found.warnings)
    # two photos of 80 % overlap with errors of 5 micrometres give the block of 1200 m its place to a few metres
    assert np.abs(found.points.values - MADE.points).max() < 5.0


def test_a_free_network_from_nothing_says_what_its_scale_is() -> None:
    block = redefined(from_nothing(MADE), datum="free")
    found, _ = solve(block)
    assert found.status == "converged"
    said = "those of photo P1, its scale is arbitrary: the base from photo P1 to photo P2 is 1"
    assert any(text.endswith(said) for *_, text in found.warnings)
    one, two = found.photos.values[:2, :3]
    # the free network keeps the scale of its approximate coordinates on the whole; the first base is one of many
    assert np.linalg.norm(two - one) == pytest.approx(1.0, abs=0.01)
    a, b = block.point_names[0], block.point_names[-1]
    length = float(np.linalg.norm(MADE.points[-1] - MADE.points[0]))
    found, _ = solve(replace(block, distances=(ControlDistance("D", a, b, "XYZ", length, 0.01),)))
    assert any("its scale comes from 1 distance" in text for *_, text in found.warnings)
    assert np.linalg.norm(found.points.values[-1] - found.points.values[0]) == pytest.approx(length, abs=0.05)


def similarity(source: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return scale, rotation and shift by the closed form of Umeyama (1991)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, singular, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    scale = float(np.trace(np.diag(singular) @ sign) / (a**2).sum())
    return scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)


def test_a_free_network_has_the_shape_of_the_block_that_stations_hold() -> None:
    """Free and held by the fewest stations the blocks differ by a similarity, which has a closed form."""
    block = from_nothing(MADE)
    # one station in three coordinates, one in three, one in one would do; constant ones hold without a residual
    a, b, c = positions(MADE, (0, 4, 12), error=1e-6)
    c = replace(c, position_error=(-1.0, -1.0, 1e-6))
    b = replace(b, position_error=(1e-6, 1e-6, 1e-6))
    held, _ = solve(replace(block, stations=(a, b, c), photo_orientation=MADE.orientations.copy()))
    free, _ = solve(redefined(block, datum="free"))
    scale, rotation, shift = similarity(free.points.values, held.points.values)
    moved = scale * free.points.values @ rotation.T + shift
    # seven coordinates and the datum defect of seven: only where the iterations stopped differs
    assert held.redundancy == free.redundancy
    assert moved == pytest.approx(held.points.values, abs=1e-3)
