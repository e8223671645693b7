"""Cameras with the same lens: one principal distance and distortion, principal points of their own."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.same_lens import SHIFT, with_two_frames
from bundle.solving import solution
from support.synthetic_block import DISTORTED, synthetic_block

from orip.bundle import problem
from orip.bundle.unknowns import CONSTANT, number_unknowns
from orip.records.camera import CAMERA_PARAMETERS, LENS_PLACES, with_lens_of, with_shared_lenses
from orip.structs import replace

UNKNOWN = ("C", "DX", "DY", "A3", "P1")
PLACES = [CAMERA_PARAMETERS.index(name) for name in UNKNOWN]
LENS, OWN = list(LENS_PLACES), [1, 2]


def made(argument="ideal", *, seed="same lens", start_error=0.001):
    return synthetic_block(
        "convergent", seed, noise_mm=0.003, precision_mm=0.003, distortion=DISTORTED, distortion_at=argument,
        unknown=UNKNOWN, start_error=start_error, start_down_weight=20,
    )  # fmt: skip


def test_columns_are_shared_but_for_principal_points():
    columns = number_unknowns(with_two_frames(made().block), ()).cameras
    assert (columns[0, LENS] == columns[1, LENS]).all()
    assert len({*columns[:, OWN].ravel().tolist()} - {CONSTANT}) == 4


@pytest.mark.parametrize("argument", ["ideal", "measured"])
@pytest.mark.parametrize("loop", ["compiled", "numpy"])
def test_a_common_lens_is_recovered(argument, loop, monkeypatch):
    if loop == "numpy":
        monkeypatch.setattr(problem, "is_compiled", lambda: False)
    truth = made(argument)
    block = with_two_frames(truth.block)
    wrong = np.array(block.cameras[0].parameters) + np.where(np.isin(np.arange(13), [0, 1, 2]), 0.05, 0.0)
    lens = replace(block.cameras[0], parameters=tuple(wrong.tolist()))
    start = replace(block, cameras=(lens, with_lens_of(block.cameras[1], lens)))
    found = solution(start)
    assert found.status == "converged"
    values, deviations = found.cameras.values, found.cameras.sd
    assert (values[0, LENS] == values[1, LENS]).all()
    assert np.array_equal(deviations[0, LENS], deviations[1, LENS], equal_nan=True)
    expected = np.repeat(truth.cameras, 2, axis=0)
    expected[1, OWN] += SHIFT
    # 4 standard deviations of ten values: exceeded by chance once in 1600 blocks, and the seed is fixed
    assert (np.abs(values - expected)[:, PLACES] < 4.0 * deviations[:, PLACES]).all()


def test_the_compiled_loop_gives_what_numpy_gives(monkeypatch):
    block = with_two_frames(made().block)
    compiled = solution(block)
    monkeypatch.setattr(problem, "is_compiled", lambda: False)
    plain = solution(block)
    # the iterations end with corrections of 1e-4 standard deviations, and so may the results differ
    difference = np.abs(compiled.cameras.values - plain.cameras.values)[:, PLACES]
    assert (difference < 1e-3 * plain.cameras.sd[:, PLACES]).all()
    assert compiled.cameras.sd[:, PLACES] == pytest.approx(plain.cameras.sd[:, PLACES], rel=1e-4)


def test_one_lens_is_determined_better_than_two():
    block = made().block
    one, two = solution(with_two_frames(block)), solution(with_two_frames(block, same_lens=False))
    assert two.unknowns - one.unknowns == len(UNKNOWN) - len(OWN)
    assert one.redundancy - two.redundancy == len(UNKNOWN) - len(OWN)
    ratio = two.cameras.sd[:, PLACES] / one.cameras.sd[:, PLACES]
    # C follows from the control in the photos of either camera alone; the distortion from all image points
    assert ratio.min() > 1.0
    assert ratio[:, [3, 4]].min() > 1.1


def test_records_take_the_lens_of_another():
    lens = replace(made().block.cameras[0], distortion_at="measured")
    other = replace(lens, name="OTHER", parameters=(99.0, 0.5, 0.6, *[0.0] * 10), unknown=("DY",), same_lens_as="cam")
    first, second = with_shared_lenses((lens, other))
    assert first == lens
    assert second.parameters == (lens.parameters[0], 0.5, 0.6, *lens.parameters[3:])
    assert second.unknown == ("C", "DY", "A3", "P1")
    assert second.distortion_at == "measured"
