"""The C extensions built with gcc's address and undefined-behaviour sanitizers, and the tests that use them.

    PYTHONPATH=tests python -m hostile.sanitize [FOLDER OR FILE OF TESTS ...]       what `make sanitize` does

A read or write outside of an array, an index that overflows, a shift or conversion that C does not define: each ends
the tests with the line of C where it happened. Leaks are not looked for, as Python keeps much until it ends.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from support.special_builds import REPOSITORY, build, compiler

BUILT = REPOSITORY / "build" / "sanitized"
FLAGS = (
    "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g",
    # what is inlined many times takes minutes to compile otherwise
    "-O1", "--param", "asan-instrumentation-with-call-threshold=0", "-fno-sanitize-address-use-after-scope",
    "-fno-sanitize=null,object-size,alignment", "-DORIP_ROOM_OF_NANS",
)  # fmt: skip
TESTED = ("bundle", "files/test_measurement_text.py", "prelim", "samples")
"""Tests that reach the extensions in C: each by itself, wrong calls included, and all in whole projects."""


def runtime(words: Sequence[str]) -> Path | None:
    """Return the library of the address sanitizer that a compiler uses; None where it has none."""
    asked = subprocess.run([*words, "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    path = Path(asked.stdout.strip() or "libasan.so")
    return path.resolve() if path.is_absolute() and path.exists() else None


def missing(words: Sequence[str]) -> str | None:
    """Return what this machine lacks, in words; None where nothing is missing."""
    if sys.platform != "linux":
        return f"the sanitizers are preloaded as Linux does it, and this is {sys.platform}"
    if shutil.which(words[0]) is None:
        return f"there is no compiler {words[0]!r}; install gcc (Debian, Ubuntu: apt install gcc libc6-dev)"
    if runtime(words) is None:
        return (
            f"{words[0]} has no libasan.so; install gcc with its sanitizers (Debian, Ubuntu: apt install gcc, which "
            "brings libgcc-N-dev; Fedora: dnf install libasan libubsan), or name another compiler: make CC=gcc sanitize"
        )
    return None


def environment(words: Sequence[str]) -> dict[str, str]:
    """Return the environment of a process that the sanitizers watch."""
    library = runtime(words)
    assert library is not None
    return {
        **os.environ,
        "ORIP_SANITIZED": str(BUILT),
        "LD_PRELOAD": str(library),
        # a size that is refused with MemoryError is no fault
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONPATH": str(REPOSITORY / "tests"),
        "OPENBLAS_NUM_THREADS": "1",
    }


def main(tests: Sequence[str]) -> int:
    """Build, run the tests, and return the exit code."""
    words = compiler()
    lacking = missing(words)
    if lacking:
        print(f"cannot be run here: {lacking}", file=sys.stderr)  # noqa: T201  # this is a program
        return 1
    if not build(BUILT, FLAGS, replaced=["-O3"]):
        print(f"not all extensions could be built with {words[0]}: see above", file=sys.stderr)  # noqa: T201
        return 1
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider"]
    command += ["-p", "hostile.sanitized_extensions", "-m", "not long and not slow", "-o", "timeout=1200"]
    paths = tests or [str(REPOSITORY / "tests" / folder) for folder in TESTED]
    return subprocess.run([*command, *paths], env=environment(words), cwd=REPOSITORY, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
