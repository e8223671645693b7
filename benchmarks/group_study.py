"""What the first sentence of a result names where an error common to one group is planted, and of clean blocks.

    PYTHONPATH=tests python benchmarks/group_study.py 420 2000

Adjusts so many blocks with a planted error and so many clean ones, of four kinds in turn, and prints one line of JSON
for each kind of error: how many were named first and alone, named beside others, were silent though a group is doubted,
silent, or accused another group; then how many clean blocks were doubted.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter

from monte_carlo.planted_groups import Outcome, cases, outcome
from threadpoolctl import threadpool_limits


def answer(found: Outcome) -> str:
    """Return how a block was judged."""
    if found.planted is None:
        return "doubted" if found.doubted else "quiet" if found.is_silent else "misfits"
    if found.named:
        return "named alone" if found.alone else "named beside others"
    if found.is_silent:
        return "silent though doubted" if found.doubted else "silent"
    return "another group accused"


def main() -> None:
    """Run the blocks and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("planted", type=int, help="blocks with a planted error")
    parser.add_argument("clean", type=int, help="clean blocks")
    given = parser.parse_args()
    answers: dict[str, Counter[str]] = {}
    with threadpool_limits(1):
        for case in cases(given.planted, given.clean):
            found = outcome(case)
            what = "clean" if found.planted is None else " ".join((found.kind, *found.planted)).strip()
            answers.setdefault(what, Counter())[answer(found)] += 1
    for what, counted in answers.items():
        print(json.dumps({"planted": what, **counted}))


if __name__ == "__main__":
    main()
