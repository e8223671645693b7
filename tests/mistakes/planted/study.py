"""What orip says first of planted mistakes, judged, and the table of the documentation.

``PYTHONPATH=tests python -m mistakes.planted.study [--table] [--every=N] [mistake ...]`` runs all cases, or those of
some mistakes, or every Nth of them.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Literal

import numpy as np
from mistakes.planted.blocks import NOISE_PARTS, SCENES, Planted, planted_block
from mistakes.planted.mistakes import PLANTED, Truth, planted
from msgspec import Struct
from scipy.stats import chi2

import orip

DOCUMENT = Path(__file__).parents[3] / "docs" / "mistakes.md"
BEGIN, END = "<!-- planted: begin -->\n", "<!-- planted: end -->\n"
NUMBERS = (0,)
"""Blocks of each scene."""

Verdict = Literal["named", "place", "missed", "wrong"]
VERDICTS: tuple[Verdict, ...] = ("named", "place", "missed", "wrong")

_GENERAL = re.compile(
    r"could not be oriented|does not fit the block|fits no better|could not be found|no preliminary|"
    r"control fits within .* at .* only|preliminary values|were found from|starts at|is not used|"
    r"nothing is to be seen|differ only in case|did not converge|no single mistake|probably wrong: none"
)
"""Findings that accuse nothing: a block, photo or point that could not be computed."""


class Case(Struct, frozen=True):
    """A mistake in a block."""

    scene: str
    number: int
    mistake: str

    def __str__(self) -> str:
        return f"{self.mistake} in {self.scene} {self.number}"


class Outcome(Struct, frozen=True):
    """What was said of a case, the verdict on its first line, whether something shows the mistake, and seconds."""

    case: Case
    said: tuple[str, ...]
    verdict: Verdict
    shows: bool
    seconds: float


def cases(mistakes: Sequence[str] = (), numbers: Sequence[int] = NUMBERS) -> Iterator[Case]:
    """Yield all cases that can be made."""
    for mistake in mistakes or PLANTED:
        for scene in SCENES:
            for number in numbers:
                if planted(planted_block(scene, number), mistake, number) is not None:
                    yield Case(scene, number, mistake)


def outcome(case: Case) -> Outcome:
    """Plant the mistake of a case, adjust the block, and judge what is said."""
    made = planted(planted_block(case.scene, case.number), case.mistake, case.number)
    assert made is not None
    block, truth = made
    began = time.perf_counter()
    said, shows = said_of(block)
    return Outcome(case, said, verdict(said, truth), shows or truth.is_shown, time.perf_counter() - began)


def said_of(block: Planted) -> tuple[tuple[str, ...], bool]:
    """Return the lines that are printed of a block, warnings and errors, and whether the adjustment shows something."""
    before: tuple[str, ...] = ()
    try:
        made = block.block()
        before = tuple(map(str, made.warnings))
        solution = made.adjust()
    except orip.OripError as error:
        return (*before, *str(error).splitlines()), True
    is_left_out = len(solution.photos.names) < len(block.photos)
    return tuple(dict.fromkeys((*before, *map(str, solution.warnings)))), is_left_out or _shows(solution)


def _shows(solution: orip.Solution) -> bool:
    """Tell whether an adjustment shows that something is wrong, by the tests that are in every textbook."""
    squares = solution.sigma0_all**2 * solution.redundancy
    # the sound blocks have somewhat smaller residuals than their a-priori errors promise
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], solution.redundancy) * [NOISE_PARTS**2, 1.0]
    standard = solution.residuals.standard_residual
    return bool(solution.status != "converged" or not low < squares < high or np.nanmax(standard) > 5.0)


def verdict(said: Sequence[str], truth: Truth) -> Verdict:
    """Judge the first line: the mistake and its place, the place alone, nothing, or something that is not so."""
    first = said[0] if said else ""
    is_place = bool(truth.where) and all(re.search(where, first) for where in truth.where)
    if (is_place or not truth.where) and re.search(truth.what, first):
        return "named"
    if is_place or any(re.search(where, first) for where in truth.where):
        return "place"
    return "missed" if not first or _GENERAL.search(first) else "wrong"


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the table: a line for each group of mistakes, and their sum."""
    groups = dict.fromkeys(group for group, _ in PLANTED.values())
    lines = ["| mistake | cases | of these show | named at once | place only | missed | wrong accusation first |\n"]
    lines.append("|---|---|---|---|---|---|---|\n")
    lines += [
        _line(group, [found for found in outcomes if PLANTED[found.case.mistake][0] == group]) for group in groups
    ]
    return [*lines, _line("all", outcomes)]


def _line(title: str, outcomes: Sequence[Outcome]) -> str:
    shown = [found for found in outcomes if found.shows]
    counts = [sum(found.verdict == kind for found in shown) for kind in VERDICTS]
    # an accusation is wrong also where nothing shows
    counts[-1] += sum(found.verdict == "wrong" for found in outcomes if not found.shows)
    return f"| {title} | {len(outcomes)} | {len(shown)} | {' | '.join(map(str, counts))} |\n"


def main(arguments: Sequence[str]) -> None:
    mistakes = [word for word in arguments if not word.startswith("-")]
    every = next((int(word.removeprefix("--every=")) for word in arguments if word.startswith("--every=")), 1)
    found = []
    for case in islice(cases(mistakes), None, None, every):
        found.append(outcome(case))
        last = found[-1]
        if last.verdict != "named":
            shown = last.verdict if last.shows else f"{last.verdict}, nothing shows"
            sys.stdout.write(f"{case} ({shown}; {last.seconds:.1f} s)\n")
            sys.stdout.writelines(f"    {line[:230]}\n" for line in last.said[:2])
    sys.stdout.write("".join(table(found)))
    if "--table" in arguments:
        text = DOCUMENT.read_text(encoding="utf-8")
        before, rest = text.split(BEGIN)
        _, after = rest.split(END)
        DOCUMENT.write_text(f"{before}{BEGIN}{''.join(table(found))}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
