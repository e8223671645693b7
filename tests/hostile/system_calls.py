"""Processes killed at a system call that changes something on the disk, as the kernel counts them (Linux, x86-64)."""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import sys

CAN_COUNT = sys.platform == "linux" and platform.machine() == "x86_64"

_TRACED, _NUMBER_OF_CALL, _GO_ON, _OPTIONS, _TELL_CALLS = 0, 3, 24, 0x4200, 1
_PLACE_OF_NUMBER = 15 * 8
"""Requests of ptrace (<sys/ptrace.h>), and where the registers (<sys/user.h>) have the number of the call."""

_CHANGING = frozenset(
    {1, 18, 20, 74, 75, 76, 77, 82, 83, 84, 85, 86, 87, 88, 90, 91, 257, 258, 263, 264, 265, 266, 268, 280, 296, 316}
)
"""write, pwrite64, writev, fsync, fdatasync, truncate, ftruncate, rename, mkdir, rmdir, creat, link, unlink, symlink,
chmod, fchmod, openat, mkdirat, unlinkat, renameat, linkat, symlinkat, fchmodat, utimensat, pwritev, renameat2."""

_ptrace = ctypes.CDLL(None, use_errno=True).ptrace if CAN_COUNT else None
if _ptrace is not None:
    _ptrace.restype = ctypes.c_long
    _ptrace.argtypes = (ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)


def let_count() -> None:
    """Let the parent count what this process does from now on."""
    assert _ptrace is not None
    _ptrace(_TRACED, 0, None, None)
    os.kill(os.getpid(), signal.SIGSTOP)


def ended_by(child: int, last: int) -> tuple[int, int]:
    """Wait for a process that lets count; kill it before its call `last`; return its status and how many it did."""
    assert _ptrace is not None
    os.waitpid(child, 0)
    _ptrace(_OPTIONS, child, None, _TELL_CALLS)
    count, is_entering, given = 0, True, 0
    while True:
        _ptrace(_GO_ON, child, None, given)
        _, status = os.waitpid(child, 0)
        if not os.WIFSTOPPED(status):
            return status, count
        stopped, given = os.WSTOPSIG(status), 0
        if stopped != signal.SIGTRAP | 0x80:
            given = stopped
            continue
        if is_entering and _ptrace(_NUMBER_OF_CALL, child, _PLACE_OF_NUMBER, None) in _CHANGING:
            count += 1
            if count == last:
                os.kill(child, signal.SIGKILL)
                return os.waitpid(child, 0)[1], count
        is_entering = not is_entering
