"""The numerical tests and the sample projects under several kernels of OpenBLAS, and without the extensions.

    PYTHONPATH=tests python tests/kernels/run.py                   what `make test-kernels` does
    PYTHONPATH=tests python tests/kernels/run.py SkylakeX Zen      under other values of OPENBLAS_CORETYPE

A computation is the same on all processors up to rounding. Tests whose tolerances allow for one kernel alone fail
here, and so do the samples if their results are not the same to a billionth of their standard deviations.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from kernels.processor import NAMES, Kernel, different, names_to_try, tried
from kernels.sample_results import LARGEST, SAMPLES, disagreement, solve_sample
from workflow.small_projects import REPOSITORY

NUMERICAL = ("adjustment", "bundle", "geometry", "prelim")
"""Folders of tests whose figures depend on sums that kernels make in another order."""

COMPILED = ("bundle", "prelim")
"""Those whose code has extensions in C."""

TESTED = 3
"""Kernels under which the tests run; the samples are solved under all of them."""

WITHOUT_EXTENSIONS = "no extensions"


def say(text: str) -> None:
    """Print a line at once, so that it stands before what programs print."""
    print(text, flush=True)  # noqa: T201  # this is a program


def chosen_kernels(names: Sequence[str]) -> list[Kernel]:
    """Return the kernels that can be run, and say what becomes of each name."""
    kernels = tried(names)
    found = different(kernels)
    for kernel in kernels:
        if not kernel.architecture:
            say(f"skipped  {kernel.name}: this processor cannot run it")
        elif kernel not in found:
            say(f"skipped  {kernel.name}: the kernels are those of {kernel.architecture}, which run already")
    return found


def tests_pass(name: str, environment: Mapping[str, str], folders: Sequence[str], *options: str) -> bool:
    """Run the tests of some folders, without those that take long."""
    say(f"tests    {name}")
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider", "-m", "not long and not slow"]
    paths = [str(REPOSITORY / "tests" / folder) for folder in folders]
    return subprocess.run([*command, *options, *paths], env=environment, cwd=REPOSITORY, check=False).returncode == 0


def samples_agree(kernels: Sequence[Kernel], folder: Path) -> bool:
    """Solve the samples under all kernels and without extensions, and compare the results with those of the first."""
    plain = [sys.executable, "-m", "orip"]
    without = [sys.executable, str(REPOSITORY / "tests" / "kernels" / "without_extensions.py")]
    ways = [(kernel.name, plain, kernel.environment()) for kernel in kernels]
    ways.append((WITHOUT_EXTENSIONS, without, dict(os.environ)))
    agree = True
    for sample in SAMPLES:
        with ThreadPoolExecutor(2) as pool:
            solving = {name: pool.submit(solve_sample, program, sample, folder / name / sample, environment)
                       for name, program, environment in ways}  # fmt: skip
        results = {name: solved.result() for name, solved in solving.items()}
        first, *others = results
        for name in others:
            found = disagreement(results[first], results[name])
            agree &= found.size <= LARGEST
            verdict = "" if found.size <= LARGEST else f"; at most {LARGEST:g} is allowed"
            say(f"sample   {sample}: {name} and {first} differ by {found.size:.1e} sd in {found.name}{verdict}")
    return agree


def main(names: Sequence[str]) -> int:
    """Run everything and return the exit code."""
    kernels = chosen_kernels(names or names_to_try())
    # any processor of x86-64 has several; elsewhere there may be one alone, or another library than OpenBLAS
    needed = TESTED if not names and names_to_try() == NAMES["x86_64"] else min(1, len(names))
    if len(kernels) < needed:
        say(f"failed   {len(kernels)} different kernels could be run, {needed} are needed; does numpy use OpenBLAS?")
        return 1
    passed = [tests_pass(kernel.name, kernel.environment(), NUMERICAL) for kernel in kernels[: max(TESTED, len(names))]]
    passed.append(tests_pass(WITHOUT_EXTENSIONS, os.environ, COMPILED, "-p", "kernels.without_extensions"))
    with tempfile.TemporaryDirectory() as folder:
        passed.append(samples_agree(kernels, Path(folder)))
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
