"""Gates as text: ``name operator number``, in ``[check] gates`` of orip.toml and on the command line."""

from __future__ import annotations

import math
import re
from typing import cast

from orip.files.text.shown import shown_token
from orip.records.results.result_tests import OPERATORS, Gate, GateOperator

GATE_FORM = "name operator number, for example 'sigma0<=1.5'; operators are < <= > >= == !="
"""How a gate is written, for messages."""

_OPERATOR = "|".join(map(re.escape, sorted(OPERATORS, key=len, reverse=True)))
_GATE = re.compile(
    rf"""
    \s* (?P<name> [A-Za-z_][A-Za-z0-9_.]* )
    \s* (?P<operator> {_OPERATOR} )
    \s* (?P<limit> [+-]? (?: [0-9]+ (?: \.[0-9]* )? | \.[0-9]+ ) (?: [eE] [+-]? [0-9]+ )? )
    \s*""",
    re.VERBOSE,
)


def parse_gate(text: str) -> Gate:
    """Return the gate that a text means; whether its name is that of a figure is not looked at.

    Raises
    ------
    ValueError
        With what is wrong and what is allowed.
    """
    match = _GATE.fullmatch(text)
    if match is None or not math.isfinite(limit := float(match["limit"])):
        message = f"'{shown_token(text)}' is not a gate; write {GATE_FORM}"
        raise ValueError(message)
    return Gate(match["name"], cast("GateOperator", match["operator"]), limit)
