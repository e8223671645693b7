"""Adjusted values and standard deviations of the sample projects, as several kernels compute them."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

SAMPLES = ("zurich_city_hall", "dcs260_calibration", "small_frame_block")

LARGEST = 1e-9
"""Standard deviations. The last corrections before the iterations end are far larger, but are made by all alike; what
kernels differ in is rounding times the condition of the block: 1e-11 in the samples, whose condition is up to 1e7."""


class Adjusted(NamedTuple):
    """A value with its standard deviation; None for a constant."""

    value: float
    sd: float | None


class Disagreement(NamedTuple):
    """How far two results are apart, in standard deviations of each value, and where they are most."""

    size: float
    name: str


def solve_sample(program: Sequence[str], sample: str, folder: Path, environment: Mapping[str, str]) -> dict[str, Any]:
    """Run a sample project in a new folder and return its result.json."""
    for arguments in (["init", "--sample", sample, str(folder)], ["-q", "-C", str(folder), "run", "--no-report"]):
        subprocess.run([*program, *arguments], env=environment, check=True, stderr=subprocess.DEVNULL)
    result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return result


def disagreement(one: Mapping[str, Any], other: Mapping[str, Any]) -> Disagreement:
    """Return the largest difference of adjusted values, or of their standard deviations.

    It is infinite where values or constants stand in one result alone, or constants are not the same.
    """
    mine, theirs = adjusted_values(one), adjusted_values(other)
    alone = mine.keys() ^ theirs.keys()
    found = [Disagreement(float("inf"), name) for name in alone]
    found += [Disagreement(_apart(mine[name], theirs[name]), name) for name in mine.keys() & theirs.keys()]
    return max(found)


def adjusted_values(result: Mapping[str, Any]) -> dict[str, Adjusted]:
    """Return the values of a result.json by their names."""
    return {
        ".".join((group, *path)): value
        for group in ("cameras", "photos", "points")
        for path, value in _values(result[group])
    }


def _values(part: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Adjusted]]:
    for name, content in part.items():
        if isinstance(content, dict) and "value" in content:
            yield (name,), Adjusted(content["value"], content["sd"])
        elif isinstance(content, dict):
            yield from (((name, *path), value) for path, value in _values(content))


def _apart(one: Adjusted, other: Adjusted) -> float:
    if not one.sd or not other.sd:
        return 0.0 if one == other else float("inf")
    return max(abs(one.value - other.value), abs(one.sd - other.sd)) / one.sd
