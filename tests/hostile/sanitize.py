"""The C extensions built with gcc's address and undefined-behaviour sanitizers, and the tests that use them.

    PYTHONPATH=tests python -m hostile.sanitize [FOLDER OR FILE OF TESTS ...]       what `make sanitize` does

A read or write outside of an array, an index that overflows, a shift or conversion that C does not define: each ends
the tests with the line of C where it happened. Leaks are not looked for, as Python keeps much until it ends.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from support.declared_extensions import REPOSITORY, declared_extensions

BUILT = REPOSITORY / "build" / "sanitized"
FLAGS = (
    "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g", "-shared", "-fPIC",
    # what is inlined many times takes minutes to compile otherwise
    "-O1", "--param", "asan-instrumentation-with-call-threshold=0", "-fno-sanitize-address-use-after-scope",
    "-fno-sanitize=null,object-size,alignment",
)  # fmt: skip
TESTED = ("bundle", "prelim", "samples")
"""Folders of tests that reach the extensions in C: each by itself, wrong calls included, and both in whole projects."""


def runtime(compiler: Sequence[str]) -> Path | None:
    """Return the library of the address sanitizer that a compiler uses; None where it has none."""
    asked = subprocess.run([*compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    path = Path(asked.stdout.strip() or "libasan.so")
    return path.resolve() if path.is_absolute() and path.exists() else None


def missing(compiler: Sequence[str]) -> str | None:
    """Return what this machine lacks, in words; None where nothing is missing."""
    if sys.platform != "linux":
        return f"the sanitizers are preloaded as Linux does it, and this is {sys.platform}"
    if shutil.which(compiler[0]) is None:
        return f"there is no compiler {compiler[0]!r}; install gcc (Debian, Ubuntu: apt install gcc libc6-dev)"
    if runtime(compiler) is None:
        return (
            f"{compiler[0]} has no libasan.so; install gcc with its sanitizers (Debian, Ubuntu: apt install gcc, which "
            "brings libgcc-N-dev; Fedora: dnf install libasan libubsan), or name another compiler: make CC=gcc sanitize"
        )
    return None


def build(compiler: Sequence[str]) -> bool:
    """Build all extensions with sanitizers, beside the ordinary ones; tell whether that was possible."""
    shutil.rmtree(BUILT, ignore_errors=True)
    for extension in declared_extensions():
        target = BUILT / f"{extension.name}.so"
        target.parent.mkdir(parents=True, exist_ok=True)
        flags = [f"-I{sysconfig.get_path('include')}", *FLAGS, *(flag for flag in extension.flags if flag != "-O3")]
        command = [*compiler, *flags, *extension.sources, "-lm", "-o", str(target)]
        if subprocess.run(command, cwd=REPOSITORY, check=False).returncode:
            return False
    return True


def environment(compiler: Sequence[str]) -> dict[str, str]:
    """Return the environment of a process that the sanitizers watch."""
    library = runtime(compiler)
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
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "gcc")
    lacking = missing(compiler)
    if lacking:
        print(f"cannot be run here: {lacking}", file=sys.stderr)  # noqa: T201  # this is a program
        return 1
    if not build(compiler):
        print(f"not all extensions could be built with {compiler[0]}: see above", file=sys.stderr)  # noqa: T201
        return 1
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider"]
    command += ["-p", "hostile.sanitized_extensions", "-m", "not long and not slow", "-o", "timeout=1200"]
    paths = tests or [str(REPOSITORY / "tests" / folder) for folder in TESTED]
    return subprocess.run([*command, *paths], env=environment(compiler), cwd=REPOSITORY, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
