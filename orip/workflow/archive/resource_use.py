"""What a project uses: time on the clock, of the processor, memory."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_BYTES = 1 if sys.platform == "darwin" else 1024
"""Of the unit in which the system tells the largest memory."""
_FORGET_PEAK = "5"


class ResourceUse(NamedTuple):
    """What a project has used: seconds on the clock, of the processor, largest memory in MB; None: not known."""

    seconds: float
    cpu_seconds: float | None = None
    peak_mb: float | None = None


NOT_MEASURED = ResourceUse(0.0)
"""Of what was given up from outside."""


def begin_use() -> Callable[[], ResourceUse]:
    """Return what tells the use of this process since now.

    Its largest memory is that since then on Linux; elsewhere it is that since the process began.
    """
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_FORGET_PEAK)
    began, used = time.monotonic(), time.process_time()
    return lambda: ResourceUse(time.monotonic() - began, time.process_time() - used, peak_megabytes())


def peak_megabytes() -> float | None:
    """Return the largest memory of this process; None where the system does not tell."""
    if os.name != "posix":
        return None
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _BYTES / (1 << 20)
