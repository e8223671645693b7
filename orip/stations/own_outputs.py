"""Files that commands of stations write: replaced only where they are of this kind, and never what is read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from orip.errors import UsageError
from orip.files.text.atomic import reporting_failure, require_no_link
from orip.files.text.regular_file import open_regular

_RECORDS = {".sbet": 17, ".smrmsg": 10}
"""Numbers of a record."""


def require_solution(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse to replace what is read, or what is no solution of RTKLIB.

    Raises
    ------
    UsageError, OripError
    """
    _require_own(target, inputs, _is_solution, "no solution of RTKLIB; name another file with --output")


def require_trajectory(target: Path, inputs: Iterable[Path]) -> None:
    """Refuse to replace what is read, or what is no SBET and no SMRMSG.

    Raises
    ------
    UsageError, OripError
    """
    _require_own(target, inputs, _is_trajectory, "no trajectory; name another file, NAME.sbet, with --output")


def _require_own(target: Path, inputs: Iterable[Path], is_own: Callable[[Path], bool], fault: str) -> None:
    with reporting_failure(target.name, "name another file with --output"):
        require_no_link(target)
        if not target.exists():
            return
        if any(path.exists() and target.samefile(path) for path in inputs):
            message = f"--output {target.name} is a file that is read; name another"
            raise UsageError(message)
        if not (target.is_file() and is_own(target)):
            message = f"{target.name} is there and is {fault}"
            raise UsageError(message)


def _is_solution(path: Path) -> bool:
    with open_regular(path) as file:
        return bool(file.read(9) == b"% program")


def _is_trajectory(path: Path) -> bool:
    return path.suffix in _RECORDS and path.stat().st_size % (8 * _RECORDS[path.suffix]) == 0
