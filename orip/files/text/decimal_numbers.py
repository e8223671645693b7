"""Numbers as people and Fortran programs write them, and the messages about what is not a number."""

from __future__ import annotations

import re

from orip.files.text.shown import shown_token

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][+-]?[0-9]+)?")
_DECIMAL_COMMA = re.compile(r"([+-]?)([0-9]*),([0-9]+(?:[eEdD][+-]?[0-9]+)?)")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_D_EXPONENT = str.maketrans("dD", "ee")
_MINUS_SIGNS = str.maketrans("−–—", "---")
_LONGEST_GUESS = 40
LARGEST_NUMBER = 1e30
"""Nothing measured is larger, and the fourth power of a larger number would overflow."""


def parse_number(token: str) -> float:
    """Return the value of a decimal number; Fortran's ``1.5D-3`` is one.

    Raises
    ------
    ValueError
        With a sentence that says what was found and what to write.
    """
    if _NUMBER.fullmatch(token):
        value = float(token.translate(_D_EXPONENT))
        if abs(value) <= LARGEST_NUMBER:
            return value
        message = f"'{shown_token(token)}' is too large for a number; check its exponent"
        raise ValueError(message)
    raise ValueError(_number_fault(token))


def is_number(token: str) -> bool:
    """Tell whether a token is a finite decimal number."""
    return _NUMBER.fullmatch(token) is not None and abs(float(token.translate(_D_EXPONENT))) <= LARGEST_NUMBER


def parse_photo_error(token: str) -> tuple[float, bool]:
    """Return an a-priori error of photo coordinates and whether it is in pixels: ``0.004`` (mm) or ``0.5px``.

    Raises
    ------
    ValueError
        With a sentence that says what was found and what to write.
    """
    if token[-2:].lower() == "px":
        if is_number(token[:-2]):
            return parse_number(token[:-2]), True
        message = f"'{shown_token(token)}' is not a number of pixels; write for example 0.5px"
        raise ValueError(message)
    return parse_number(token), False


def _number_fault(token: str) -> str:
    shown = shown_token(token)
    if _NOT_FINITE.fullmatch(token):
        return f"'{shown}' is not allowed; write a finite decimal number"
    comma = _DECIMAL_COMMA.fullmatch(token)
    if comma:
        sign, whole, fraction = comma.groups()
        return f"'{shown}' has a decimal comma; write a decimal point: {shown_token(f'{sign}{whole or 0}.{fraction}')}"
    if token.endswith(",") and _NUMBER.fullmatch(token[:-1]):
        return f"'{shown}' ends in a comma; separate fields by blanks and write {shown_token(token[:-1])}"
    return f"'{shown}' is not a number; write a plain decimal such as {_likely_number(token)}"


def _likely_number(token: str) -> str:
    """Return the decimal that was probably meant, or an example where none can be guessed."""
    candidate = token.translate(_MINUS_SIGNS)
    first_point = candidate.find(".") + 1
    candidate = candidate[:first_point] + candidate[first_point:].replace(".", "")
    if len(candidate) > _LONGEST_GUESS or not _NUMBER.fullmatch(candidate):
        return "12.345"
    sign = candidate[0] if candidate[0] in "+-" else ""
    digits = candidate[len(sign) :]
    return f"{sign}0{digits}" if digits.startswith(".") else candidate
