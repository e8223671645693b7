"""Processes that can harm nothing outside of a folder: in a mount namespace of their own, or as a plain user."""

from __future__ import annotations

import ctypes
import json
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

NOBODY = 65534
"""User and group that own nothing (Linux Standard Base: nobody)."""

_NEW_USERS, _NEW_MOUNTS = 0x10000000, 0x00020000
_READ_ONLY, _REMOUNT, _BIND, _ALL_BELOW, _PRIVATE = 1, 32, 4096, 16384, 1 << 18
_KEPT_FLAGS = {"nosuid": 2, "nodev": 4, "noexec": 8, "noatime": 1024, "nodiratime": 2048, "relatime": 1 << 21}
"""Numbers of Linux: <linux/sched.h> and <linux/mount.h>."""


class NotAllowedError(Exception):
    """This system does not let a process confine itself so; the text says why."""


def in_private_mounts(folder: Path) -> None:
    """Make everything but a folder read-only for this process and its children.

    Raises
    ------
    NotAllowedError
        Where the system allows no mount namespace.
    """
    if sys.platform != "linux":
        message = f"mount namespaces are those of Linux, and this is {sys.platform}"
        raise NotAllowedError(message)
    users = 0 if os.geteuid() == 0 else _NEW_USERS
    identity = os.geteuid()
    _call("unshare", users | _NEW_MOUNTS)
    if users:
        Path("/proc/self/uid_map").write_text(f"0 {identity} 1")
    _mount(None, "/", _PRIVATE | _ALL_BELOW)
    _mount(str(folder), str(folder), _BIND)
    for point, flags in _mounted():
        if point == "/" or not Path(point).is_relative_to(folder):
            _made_read_only(point, flags)
    os.chdir(folder)  # as it is mounted now


def as_plain_user(folder: Path) -> None:
    """Give root's rights away, and the folder with all that is in it to the user who is left.

    Raises
    ------
    NotAllowedError
        Where there are no such users, or their rights cannot be given away.
    """
    if not hasattr(os, "setgroups"):
        message = f"rights are given away as POSIX does it, and this is {sys.platform}"
        raise NotAllowedError(message)
    if os.geteuid() != 0:
        return
    for path in (folder, *folder.rglob("*")):
        os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
    try:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)
    except OSError as error:
        raise NotAllowedError(str(error)) from error


def confined(confine: Callable[[Path], None], folder: Path, work: Callable[[], Any]) -> Any:
    """Do some work in a forked process that is confined to a folder; return what it returns, which JSON can hold.

    Raises
    ------
    NotAllowedError
        If this system does not allow it.
    AssertionError
        If the work ended with an exception; with its traceback.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        answer: Sequence[Any]
        try:
            confine(folder)
            answer = ("done", work())
        except NotAllowedError as error:
            answer = ("not allowed", str(error))
        except BaseException:  # noqa: BLE001  # told by the parent
            answer = ("failed", traceback.format_exc())
        os.write(writing, json.dumps(answer).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        outcome, told = json.loads(stream.read() or b'["failed", "it was killed"]')
    os.waitpid(child, 0)
    if outcome == "not allowed":
        raise NotAllowedError(told)
    assert outcome == "done", told
    return told


def _mounted() -> list[tuple[str, int]]:
    """Return the places of all mounts and the flags that have to stay, the lowest first."""
    found = []
    for line in Path("/proc/self/mounts").read_text(encoding="utf-8").splitlines():
        _, point, _, options, *_ = line.split(" ")
        flags = sum(_KEPT_FLAGS.get(option, 0) for option in options.split(","))
        found.append((point.encode().decode("unicode_escape"), flags))
    return found


def _made_read_only(point: str, flags: int) -> None:
    """Make a mount read-only; one that is out of reach can stay as it is."""
    try:
        _mount(None, point, _REMOUNT | _BIND | _READ_ONLY | flags)
    except NotAllowedError:
        if point == "/" or os.access(point, os.W_OK):
            raise


def _mount(source: str | None, target: str, flags: int) -> None:
    _call("mount", source.encode() if source else None, target.encode(), None, ctypes.c_ulong(flags), None)


def _call(name: str, *arguments: Any) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if getattr(library, name)(*arguments) != 0:
        number = ctypes.get_errno()
        message = f"{name}: {os.strerror(number)}"
        raise NotAllowedError(message)
