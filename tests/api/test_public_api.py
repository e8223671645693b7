"""What `import orip` promises: names, signatures, types, and that no command waits for it."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest
from api.public_names import public_api

import orip
import orip.api
from orip.errors import OripError

HERE = Path(__file__).parent


def test_names_and_signatures_are_the_recorded_ones() -> None:
    recorded = (HERE / "public_api.txt").read_text(encoding="utf-8")
    assert public_api() == recorded, "the public API has changed; if that was meant, see tests/api/public_names.py"


def test_the_promised_names_are_those_of_the_package() -> None:
    assert orip.__all__ == orip.api.__all__ == sorted(orip.__all__)
    assert set(orip.__all__) <= set(dir(orip))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = orip.nothing  # type: ignore[attr-defined]


def test_everything_public_is_documented() -> None:
    undocumented = [
        f"{name}.{member}"
        for name in orip.__all__
        for member, found in {"": getattr(orip, name), **vars(getattr(orip, name))}.items()
        if (not member or (not member.startswith("_") and (callable(found) or hasattr(found, "func"))))
        and not inspect.getdoc(found)
    ]
    assert undocumented == []


def test_every_error_is_one_of_the_commands() -> None:
    errors = [found for name in orip.__all__ if name.endswith("Error") and (found := getattr(orip, name))]
    assert len(errors) > 4
    assert all(issubclass(error, OripError) for error in errors)


def test_importing_orip_loads_nothing_else() -> None:
    program = "import sys, orip; print(sorted({name.partition('.')[0] for name in sys.modules} & set(sys.argv[1:])))"
    heavy = ["numpy", "scipy", "pydantic", "typer", "pandas"]
    done = subprocess.run([sys.executable, "-c", program, *heavy], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
