"""What the chain from nothing takes, as a ratio to the adjustment that starts from it, in the groups of its studies.

    PYTHONPATH=tests python benchmarks/chain_study.py 400

Runs that many blocks of the study of preliminary values, grouped by their size, and for every fourth of them one of
each of the others: weakly joined blocks, gross outliers, outliers near the epipolar line. Prints one line of JSON: for
every group the number of blocks, how many ended at the true minimum, the median CPU seconds of the chain and of the
adjustment (iterations, precision and reliability) on one thread, and the median of their ratios.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence

import numpy as np
from monte_carlo.outlier_blocks import FAMILIES, outlier_records
from monte_carlo.preliminary_study import SIZES, SUCCESS, Outcome, outcome, outcome_of
from monte_carlo.weakly_joined_blocks import weakly_joined_records
from threadpoolctl import threadpool_limits

_OTHERS = 4
"""Blocks of the study of all kinds for one of each other study."""


def outcomes(runs: int) -> Iterator[tuple[str, Outcome]]:
    """Yield group and outcome of every block."""
    for run in range(runs):
        found = outcome(run)
        low, high = next((low, high) for low, high in SIZES if low <= found.photos <= high)
        yield f"{low} to {high} photos", found
    for run in range(runs // _OTHERS):
        yield "weakly joined", outcome_of(weakly_joined_records(run))
    for run in range(len(FAMILIES) * (runs // _OTHERS)):
        found = outcome_of(outlier_records(run))
        yield found.family, found


def figures(found: Sequence[Outcome]) -> dict[str, float]:
    """Return the figures of a group; a block that was refused has no adjustment to compare with."""
    adjusted = [one for one in found if one.bundle_seconds]
    chain = np.array([one.chain_seconds for one in adjusted])
    adjustment = np.array([one.bundle_seconds for one in adjusted])
    return {
        "blocks": len(found),
        "right": sum(one.end in SUCCESS for one in found),
        "chain": float(np.median(chain)),
        "adjustment": float(np.median(adjustment)),
        "ratio": float(np.median(chain / adjustment)),
    }


def main() -> None:
    """Run the blocks and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=int, help="blocks of the study of all kinds")
    given = parser.parse_args()
    groups: dict[str, list[Outcome]] = {}
    with threadpool_limits(1):
        for group, found in outcomes(given.runs):
            groups.setdefault(group, []).append(found)
    print(json.dumps({group: figures(found) for group, found in sorted(groups.items())}))


if __name__ == "__main__":
    main()
