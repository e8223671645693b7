"""Angles in degrees, minutes and seconds, and with the letter of a hemisphere."""

from __future__ import annotations

import re

_NUMBER = r"[0-9]{1,3}(?:[.,][0-9]{0,15})?"
_ANGLE = re.compile(
    rf"""
    (?P<before> [NSEW]? ) \s* (?P<sign> [+−-]? ) \s* (?P<degrees> {_NUMBER} )
    (?P<mark> \s* [°º˚] )?
    (?: (?: (?(mark) \s* | (?: \s*:\s* | \s+ ) ) ) (?P<minutes> {_NUMBER} )
        (?: (?: \s*['′’´]\s* | \s*:\s* | \s+ ) (?: (?P<seconds> {_NUMBER} ) \s* (?: ["″”] | '' | ′′ | ’’ )? )? )?
    )?
    \s* (?P<after> [NSEW]? )
    """,
    re.VERBOSE,
)
_ANGLE_PARTS = ("degrees", "minutes", "seconds")
_LONGEST = 60
_SIXTY = 60.0


def degrees_and_side(token: str) -> tuple[float, str] | None:
    """Return an angle in degrees and the letter of its hemisphere, "" without one; None if it is not so written.

    South and west are negative. A plain number is not so written.
    """
    match = _ANGLE.fullmatch(token.strip()) if len(token) <= _LONGEST else None
    if match is None:
        return None
    side = match["before"] or match["after"]
    parts = [match[part] for part in _ANGLE_PARTS if match[part] is not None]
    is_written = side or match["mark"] or ":" in token or len(parts) == len(_ANGLE_PARTS)
    if not is_written or (match["before"] and match["after"]) or (match["sign"] and side):
        return None
    numbers = [float(part.replace(",", ".")) for part in parts]
    if any(not part.isdigit() for part in parts[:-1]) or any(number >= _SIXTY for number in numbers[1:]):
        return None
    size = sum(number / _SIXTY**power for power, number in enumerate(numbers))
    return (-size if side in ("S", "W") or match["sign"] in ("-", "−") else size), side
