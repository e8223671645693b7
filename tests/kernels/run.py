"""The numerical tests and the sample projects under several kernels of OpenBLAS, and with other extensions.

    PYTHONPATH=tests python tests/kernels/run.py                   what `make test-kernels` does
    PYTHONPATH=tests python tests/kernels/run.py SkylakeX Zen      under other values of OPENBLAS_CORETYPE

The extensions are also compiled as Microsoft's compiler would: in ISO C, without vectors of four numbers. A computation
is the same on all processors, by all compilers and in NumPy up to rounding. Tests whose tolerances allow for one kernel
alone fail here, and so do the samples if their results are not the same to a billionth of their standard deviations.
Compiled so that the memory the loops work in begins as NaN, they show in results what is read before it is written.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from kernels.processor import NAMES, Kernel, different, names_to_try, tried
from kernels.sample_results import LARGEST, SAMPLES, disagreement, solve_sample
from support.special_builds import build, compiler
from workflow.small_projects import REPOSITORY

NUMERICAL = ("adjustment", "bundle", "geometry", "prelim")
"""Folders of tests whose figures depend on sums that kernels make in another order."""

COMPILED = ("bundle", "prelim")
"""Those whose code has extensions in C."""

TESTED = 3
"""Kernels under which the tests run; the samples are solved under all of them."""

WITHOUT_LOOP = "no loop over photo points"
ONE_LANE = "one lane"
ROOM_OF_NANS = "room of NaNs"

LEFT_OUT = {**os.environ, "ORIP_WITHOUT": "orip.bundle.compiled._observation_loop orip.files.log._plain_lines"}
"""The environment without those extensions whose work NumPy does where they were not built."""

ISO_C = ("-std=c11", "-Werror=vla", "-Werror=pointer-arith", "-DORIP_ONE_LANE")
"""C without what Microsoft's compiler lacks: vectors, other extensions of gcc, and arrays of variable length."""

NANS_FIRST = ("-DORIP_ROOM_OF_NANS",)

BLOCKS = ("bundle/test_photo_loop.py", "bundle/test_banded_block.py", "bundle/test_threads.py")
"""Tests that reach all loops over photo points."""


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


def specially_built(name: str, flags: Sequence[str], folder: Path) -> Mapping[str, str] | None:
    """Compile the extensions with other flags; return the environment that uses them, None without a compiler.

    Raises
    ------
    RuntimeError
        If the compiler refuses them.
    """
    if shutil.which(compiler()[0]) is None:
        say(f"skipped  {name}: there is no compiler {compiler()[0]!r}")
        return None
    if not build(folder / name, flags):
        message = f"the extensions cannot be compiled with {' '.join(flags)}: see above"
        raise RuntimeError(message)
    return {**os.environ, "ORIP_SPECIAL_BUILD": str(folder / name)}


def samples_agree(kernels: Sequence[Kernel], one_lane: Mapping[str, str] | None, folder: Path) -> bool:
    """Solve the samples in all ways, and compare the results with those of the first.

    one_lane is the environment of extensions without vectors, None where there is no compiler.
    """
    programs = REPOSITORY / "tests" / "kernels"
    plain = [sys.executable, "-m", "orip"]
    ways = [(kernel.name, plain, kernel.environment()) for kernel in kernels]
    ways.append((WITHOUT_LOOP, [sys.executable, str(programs / "without_extensions.py")], LEFT_OUT))
    if one_lane is not None:
        ways.append((ONE_LANE, [sys.executable, str(programs / "special_build.py")], one_lane))
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
    passed.append(tests_pass(WITHOUT_LOOP, LEFT_OUT, COMPILED[:1], "-p", "kernels.without_extensions"))
    with tempfile.TemporaryDirectory() as folder:
        one_lane = specially_built(ONE_LANE, ISO_C, Path(folder))
        nans_first = specially_built(ROOM_OF_NANS, NANS_FIRST, Path(folder))
        for name, environment, tests in ((ONE_LANE, one_lane, COMPILED), (ROOM_OF_NANS, nans_first, BLOCKS)):
            if environment is not None:
                passed.append(tests_pass(name, environment, tests, "-p", "kernels.special_build"))
        passed.append(samples_agree(kernels, one_lane, Path(folder)))
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
