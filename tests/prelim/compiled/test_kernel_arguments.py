"""The compiled loops of preliminary values refuse arguments that do not belong together, and write nowhere else."""

from __future__ import annotations

import pytest
from support.wrong_calls import call, functions_of, overlapping, recorded, written_by, wrong_calls
from test_every_kernel import CASES

from orip.prelim.compiled import is_compiled, kernels

pytestmark = pytest.mark.skipif(not is_compiled(), reason="the extension was not built: no compiler here")


@pytest.mark.parametrize("name", sorted(CASES))
def test_wrong_arguments(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = recorded(kernels, CASES[name], monkeypatch)[name]
    function = getattr(kernels, name)
    assert call(function, arguments) is None
    written = written_by(function, arguments)
    assert written
    for wrong in (*wrong_calls(arguments, written), *overlapping(arguments, written)):
        fault = call(function, wrong.arguments)
        assert wrong.refused is None or (fault is not None) == wrong.refused, wrong.what


def test_every_function_is_called() -> None:
    assert set(functions_of(kernels)) == set(CASES)
