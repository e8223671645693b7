"""What is said first of a blunder that is planted in a published block, one at a time, and of the blocks as they are.

    PYTHONPATH=tests python benchmarks/planted_blunders.py --places 2 [--block NAME] [--kind NAME] [--misses]

Prints one line of JSON for each kind of blunder: how many show, and of these how many were named first, named later,
placed (some of the names), taken for something else, or not mentioned; then the same for each block. A blunder shows
where it adds more than `NON_CENTRALITY` squared to the sum of squares of all observations with their full weights: a
smaller one is below the smallest that a test detects. One of a control point does not count either where the block
fits about as well without another control point instead.
"""

from __future__ import annotations

import argparse
import copy
import json
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np
from mistakes.planted.blocks import Planted
from mistakes.planted.blunders import ANY_PHOTO, KINDS, judged, planted_in, said_of, sound_block, squares
from mistakes.planted.mistakes import Truth, name
from mistakes.planted.published import PUBLISHED
from msgspec import Struct
from threadpoolctl import threadpool_limits

from orip.bundle.results.reliability import NON_CENTRALITY

_AS_LIKELY = 2.0 * np.log(100.0)


def is_shown(block: Planted, truth: Truth, kind: str, before: float, sigma0: float) -> bool:
    """Tell whether the observations show a blunder; one of a whole photo or camera always does."""
    if truth.is_shown or KINDS[kind].subjects == ANY_PHOTO:
        return True
    return squares(block) - before > (NON_CENTRALITY * max(sigma0, 1.0)) ** 2


def has_rival(block: Planted, truth: Truth, kind: str, said: Sequence[str], sigma0: float) -> bool:
    """Tell whether a block fits about as well without a control point that is accused as without the wrong one."""
    if not kind.startswith("control: ") or not said:
        return False
    if _is_mirror_image(block, truth):
        return True
    if len(truth.where) > 1 or len(block.control_names) <= 3:
        return False
    fit: dict[str, float] = {}
    for point in block.control_names:
        if re.search(name(point), said[0]) or name(point) == truth.where[0]:
            less = copy.copy(block)
            less.control = {other: given for other, given in block.control.items() if other != point}
            fit[name(point)] = squares(less)
    own = fit.pop(truth.where[0])
    return min(fit.values(), default=np.inf) < own + _AS_LIKELY * max(sigma0, 1.0) ** 2


def _is_mirror_image(block: Planted, truth: Truth) -> bool:
    """Tell whether control in a plane is as true from its other side, with all points or without a right one."""
    names = block.control_names
    given, true = (np.array([xyz[point] for point in names]) for xyz in (_coordinates(block), block.truth))
    if (
        np.linalg.svd(true - true.mean(axis=0))[1][2] > 0.01 * np.ptp(true)
        or np.isfinite(list(block.orientation.values())).all()
    ):
        return False
    right = [k for k, point in enumerate(names) if name(point) not in truth.where]
    others: list[list[int]] = (
        [[], *([k] for k in right)] if len(truth.where) == 1 else [[], *map(list, combinations(right, 2))]
    )
    for other in others:
        rest = [k for k in range(len(names)) if k not in other or len(other) == 2]
        read = given.copy()
        read[other] = given[other[::-1]]
        apart = [np.linalg.norm(xyz[rest, None] - xyz[None, rest], axis=2) for xyz in (read, true)]
        if np.allclose(*(sizes / sizes.max() for sizes in apart), atol=1e-2):
            return True
    return False


def _coordinates(block: Planted) -> dict[str, np.ndarray]:
    return {point: xyz for point, (xyz, _) in block.control.items()}


ANSWERS = ("named", "placed", "later", "wrong", "silent")


class Case(Struct, frozen=True):
    """A blunder of a kind at one place of a block."""

    block: str
    kind: str
    place: int


def outcomes(blocks: Sequence[str], kinds: Sequence[str], places: int) -> Iterator[tuple[Case, str, list[str], Truth]]:
    """Yield each blunder that shows, how it was answered, and what was said."""
    for block_name in blocks:
        sound, sigma0 = sound_block(block_name)
        known = set(said_of(sound))
        yield Case(block_name, "clean", 0), "silent" if not _accusing(known) else "wrong", sorted(known), Truth((), "")
        before = squares(sound)
        for kind in kinds:
            for place in range(places):
                block, truth = planted_in(sound, block_name, kind, place)
                if truth is None or not is_shown(block, truth, kind, before, sigma0):
                    continue
                said = [line for line in said_of(block) if line not in known]
                answer = judged(said, truth, KINDS[kind].subjects)
                if answer == "named" or not has_rival(block, truth, kind, said, sigma0):
                    yield Case(block_name, kind, place), answer, said, truth


def _accusing(said: set[str]) -> list[str]:
    return [line for line in said if "misfits" not in line]


def table(found: Sequence[tuple[Case, str]], of: Callable[[Case], str]) -> Iterator[str]:
    """Yield a line of JSON for each group of cases, and their sum."""
    groups: dict[str, Counter[str]] = {}
    for case, answer in found:
        groups.setdefault(of(case), Counter())[answer] += 1
        groups.setdefault("all", Counter())[answer] += 1
    for group, counted in sorted(groups.items(), key=lambda item: item[0] == "all"):
        shown = sum(counted.values())
        yield json.dumps(
            {"of": group, "show": shown, **{answer: counted[answer] for answer in ANSWERS if counted[answer]}}
        )


def main() -> None:
    """Plant, adjust and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", type=int, default=2, help="blunders of each kind in each block")
    parser.add_argument("--block", action="append", choices=PUBLISHED)
    parser.add_argument("--kind", action="append", choices=KINDS)
    parser.add_argument("--misses", action="store_true", help="print what was said where it was not right")
    given = parser.parse_args()
    found: list[tuple[Case, str]] = []
    began = time.process_time()
    with threadpool_limits(1):
        for case, answer, said, truth in outcomes(
            given.block or list(PUBLISHED), given.kind or list(KINDS), given.places
        ):
            if case.kind == "clean":
                print(json.dumps({"block": case.block, "clean": answer, "seconds": round(time.process_time() - began)}))
                continue
            found.append((case, answer))
            if given.misses and answer != "named":
                sys.stdout.write(
                    f"{answer}: {case.block} / {case.kind} {case.place}: {' '.join(truth.where)} {truth.what}\n"
                )
                sys.stdout.writelines(f"    {line[:240]}\n" for line in said[:3])
            sys.stdout.flush()
    for of in (lambda case: case.kind), (lambda case: case.block):
        print("\n".join(table(found, of)))


if __name__ == "__main__":
    main()
