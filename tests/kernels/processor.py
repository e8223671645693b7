"""Which kernels of OpenBLAS this processor can run, and which of them really differ.

OpenBLAS chooses its kernels by the processor, or as OPENBLAS_CORETYPE says. It takes the name on trust: kernels with
instructions that the processor does not have are stopped by the system. Several names stand for the same kernels.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from typing import NamedTuple

NAMES = {
    "x86_64": ("Haswell", "Nehalem", "Prescott", "Sandybridge", "SkylakeX"),
    "aarch64": ("ARMV8", "NEOVERSEN1", "NEOVERSEV1"),
}
"""By `platform.machine()`: values of OPENBLAS_CORETYPE, those first that most processors can run."""

_PROBE = """
import numpy as np, scipy.linalg, threadpoolctl
matrix = np.random.default_rng(1).normal(size=(150, 150))
square = matrix @ matrix.T
for algebra in (np.linalg, scipy.linalg):
    algebra.cholesky(square), algebra.qr(matrix), algebra.svd(matrix), algebra.eig(matrix), algebra.inv(square)
libraries = threadpoolctl.threadpool_info()
found = {library["architecture"] for library in libraries if library["internal_api"] == "openblas"}
print("+".join(sorted(found)))
"""


class Kernel(NamedTuple):
    """Kernels that were tried.

    Attributes
    ----------
    name : str
        The value of OPENBLAS_CORETYPE.
    architecture : str
        What numpy and scipy say that they use then; empty if the processor cannot run it, or there is no OpenBLAS.
    """

    name: str
    architecture: str

    def environment(self) -> dict[str, str]:
        """Return the environment in which it is used."""
        return {**os.environ, "OPENBLAS_CORETYPE": self.name}


def names_to_try() -> tuple[str, ...]:
    """Return the names of kernels for a processor of this kind."""
    machine = platform.machine()
    return NAMES.get({"AMD64": "x86_64", "arm64": "aarch64"}.get(machine, machine), ())


def tried(names: Iterable[str]) -> list[Kernel]:
    """Return each name with the architecture that calculates in a program of its own."""
    found = []
    for name in names:
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE],
            env=Kernel(name, "").environment(),
            check=False,
            capture_output=True,
            text=True,
        )
        found.append(Kernel(name, probe.stdout.strip() if probe.returncode == 0 else ""))
    return found


def different(kernels: Iterable[Kernel]) -> list[Kernel]:
    """Return the kernels that can be run, the first one of each architecture."""
    found: dict[str, Kernel] = {}
    for kernel in kernels:
        if kernel.architecture:
            found.setdefault(kernel.architecture, kernel)
    return list(found.values())
