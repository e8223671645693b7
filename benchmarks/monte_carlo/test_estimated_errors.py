"""Variance components of three designs: unbiased, with the standard deviations and the false alarms that they claim."""

from __future__ import annotations

import numpy as np
import pytest
from bundle.aerial_block import aerial_block
from bundle.solving import directions_from, noisy, solved
from monte_carlo.grouped_blocks import grouped_block
from monte_carlo.stations_study import block_with_stations

from orip.bundle.solve import iteration_settings
from orip.bundle.variance.components import estimate_errors
from orip.bundle.variance.groups import VarianceGroup, with_errors_times
from orip.records.block import Block
from orip.records.definition import BORESIGHT, Antenna
from orip.structs import replace

PHOTO = VarianceGroup("photo", "CAM", "xy")
LEVEL, HEIGHT = VarianceGroup("control", "", "XY"), VarianceGroup("control", "", "Z")
STATIONS, BARS = VarianceGroup("element", "PHOTO", "X0 Y0 Z0"), VarianceGroup("distance")
POSITIONS, ATTITUDES = VarianceGroup("station"), VarianceGroup("attitude")
DIRECTIONS, ZENITHS = VarianceGroup("direction", "", "direction"), VarianceGroup("direction", "", "zenith")


def with_stations_and_bars(run: int) -> tuple[Block, dict[VarianceGroup, float]]:
    return grouped_block("none", run).block, {PHOTO: 2.0, LEVEL: 0.5, STATIONS: 1.5, BARS: 3.0}


def with_control_alone(run: int) -> tuple[Block, dict[VarianceGroup, float]]:
    made = aerial_block("variance components")
    made = replace(made, block=with_errors_times(made.block, {LEVEL: 4.0, HEIGHT: 6.0}))
    return noisy(made, run), {PHOTO: 2.0, LEVEL: 0.5, HEIGHT: 3.0}


def with_directions(run: int) -> tuple[Block, dict[VarianceGroup, float]]:
    made = aerial_block("variance components")
    names = made.block.point_names
    error = 0.01
    block = directions_from(made, noisy(made, run), names[0], names[1::2], error=error, zenith_error=error)
    random = np.random.default_rng([run, 7])
    directions = tuple(
        replace(
            line,
            direction=line.direction + error * random.normal(),
            zenith=line.zenith + error * random.normal(),
        )
        for line in block.directions
        if line.zenith is not None
    )
    return replace(block, directions=directions), {PHOTO: 1.0, DIRECTIONS: 2.0, ZENITHS: 0.5}


def with_exposure_stations(run: int) -> tuple[Block, dict[VarianceGroup, float]]:
    """Return a block whose antenna has an unknown boresight, and an unknown shift of each strip."""
    antenna = Antenna("GNSS", unknown=BORESIGHT, shift="strip")
    return block_with_stations("variance components", run, antenna), {PHOTO: 1.0, POSITIONS: 2.0, ATTITUDES: 0.5}


DESIGNS = {with_stations_and_bars: 5, with_control_alone: 5, with_directions: 5, with_exposure_stations: 8}
"""Designs with their numbers of quick runs."""


@pytest.mark.parametrize(
    ("design", "runs"),
    [*DESIGNS.items(), *(pytest.param(design, 200, marks=pytest.mark.long) for design in DESIGNS)],
)
def test_estimates_are_unbiased_with_the_deviations_that_they_claim(design, runs: int) -> None:
    found: dict[VarianceGroup, list[tuple[float, float]]] = {}
    for run in range(runs):
        block, factors = design(run)
        given = with_errors_times(block, {group: 1.0 / factor for group, factor in factors.items()})
        settings = iteration_settings(given.definition)
        for row in estimate_errors(solved(given), settings, lambda _: None, lambda: False).components:
            group = VarianceGroup(row.kind, row.of, row.component)
            true = factors.get(group, 1.0)
            # errors whose estimate falls to zero are not estimated: without them the mean would be too large
            found.setdefault(group, []).append((np.nan_to_num(row.factor) / true, row.sd / true))
    assert set(found) >= set(factors)
    for group, pairs in found.items():
        estimates, deviations = np.array(pairs).T
        # the variances are unbiased, not their roots; those of the design are better known than those of few runs
        variance = estimates**2
        claimed = float(np.sqrt(np.nanmean((2.0 * estimates * deviations) ** 2)))
        # that of a variance is sqrt(2 / redundancy), and far more where estimates run away, which would pass any mean
        assert claimed < 2.0, (group, claimed)
        expected = max(claimed, float(np.std(variance))) / np.sqrt(len(pairs))
        assert abs(variance.mean() - 1.0) < 4.5 * expected, (group, variance.mean(), expected)
        if len(pairs) >= 100:
            assert np.std(estimates) == pytest.approx(np.nanmean(deviations), rel=0.25), group
