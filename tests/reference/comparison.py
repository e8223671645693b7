"""Results held against reports."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest
from reference.olympus_camera import as_reported, distortion_correlations
from reference.published_data import ORIENTATION, Published, Report, half_digit

ITERATED = 2e-6
"""Part of a standard deviation within which the published iterations ended; they stop at a relative change of 1e-6."""


def assert_key_figures(result: Any, report: Report, *, digits: int) -> None:
    """Compare sigma0 to its printed digits, and the counts."""
    assert result["status"] == "converged"
    assert result["down_weighted"] == []
    assert result["singular"] == []
    assert result["sigma0"] == pytest.approx(report.sigma0, abs=half_digit(report.sigma0, digits))
    assert result["redundancy"] == report.redundancy
    assert result["unknowns"] == report.unknowns
    assert result["observations"] == report.observations


def assert_camera(result: Any, report: Report, *, iterated: float = ITERATED) -> None:
    """Compare interior orientation, its deviations and the correlations that were printed."""
    found = as_reported(result)
    published = {name: value for name, value in report.camera.items() if value.deviation == value.deviation}
    assert found.keys() == published.keys()
    for name, value in published.items():
        _assert_printed(name, found[name], value, half_digit(value.value, 6), iterated)
    correlations = distortion_correlations(result)
    assert correlations.keys() == report.correlations.keys()
    for pair, r in report.correlations.items():
        assert correlations[pair] == pytest.approx(r, abs=half_digit(r, 3)), pair


def assert_orientations(
    result: Any, photos: Mapping[str, Mapping[str, Published]], *, iterated: float = ITERATED
) -> None:
    """Compare orientations, which are printed with six decimals, and their deviations."""
    assert result["photos"].keys() == photos.keys()
    for photo, published in photos.items():
        found = orientation(result, photo)
        for kind in ORIENTATION:
            _assert_printed(f"{kind} of photo {photo}", found[kind], published[kind], half_digit(1.0, 7), iterated)


def orientation(result: Any, photo: str) -> dict[str, Published]:
    """Return the orientation of a photo with its deviations."""
    return {kind: Published(element["value"], element["sd"]) for kind, element in result["photos"][photo].items()}


def _assert_printed(name: str, found: Published, published: Published, rounding: float, iterated: float) -> None:
    off = found.value - published.value
    if name.startswith("KAPPA"):  # a turn of 180 degrees is printed with either sign
        off = math.remainder(off, 360.0)
    assert abs(off) < rounding + iterated * found.deviation, (name, found, published)
    # deviations are printed with three digits
    assert found.deviation == pytest.approx(published.deviation, abs=half_digit(published.deviation, 3)), name
