"""Gates as text."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.files.text.decimal_numbers import parse_gate
from orip.records.results.tests import OPERATORS, Gate


@pytest.mark.parametrize(
    ("text", "gate"),
    [
        ("sigma0<=1.5", Gate("sigma0", "<=", 1.5)),
        ("  sigma0\t<   1  ", Gate("sigma0", "<", 1.0)),
        ("check_points.rms_xy >= -.5", Gate("check_points.rms_xy", ">=", -0.5)),
        ("singular==0", Gate("singular", "==", 0.0)),
        ("singular!=+1.", Gate("singular", "!=", 1.0)),
        ("enp>4e0", Gate("enp", ">", 4.0)),
        ("nosuchthing > 1E-3", Gate("nosuchthing", ">", 0.001)),
    ],
)
def test_gates(text: str, gate: Gate) -> None:
    assert parse_gate(text) == gate
    assert parse_gate(str(gate)) == gate


@pytest.mark.parametrize(
    "text",
    [
        "", " ", "sigma0", "sigma0<=", "<=1", "sigma0=1", "sigma0=<1", "sigma0 < = 1", "sigma0<1.5.2", "sigma0<1,5",
        "sigma0<nan", "sigma0<inf", "sigma0<1e999", "sigma0<0x10", "sigma0<1_000", "sigma0<1<2", "1<sigma0",
        "sigma0<sigma0_all", "sigma0<1 and 1<2", "__import__('os')<1", "sigma0<(1)", "sigma 0<1", "sigma0<１",
        "sigma0<1\x00",
    ],
)  # fmt: skip
def test_what_is_no_gate(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not a gate; write name operator number, for example 'sigma0<=1.5'"):
        parse_gate(text)


@given(st.text())
def test_any_text_is_a_gate_or_a_fault(text: str) -> None:
    with suppress(ValueError):
        assert parse_gate(str(parse_gate(text))).operator in text


@given(st.sampled_from(list(OPERATORS)), st.floats(allow_nan=False, allow_infinity=False))
def test_any_limit(operator: str, limit: float) -> None:
    assert parse_gate(f"sigma0{operator}{limit!r}") == Gate("sigma0", operator, limit)  # type: ignore[arg-type]
