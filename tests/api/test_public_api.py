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


SCRIPT = """
import numpy as np
import orip

camera = orip.Camera("C35", c=35.0, unknown=["C"])
photos = orip.Photos(["1", "2"], "C35", orientation=np.zeros((2, 6)))
points = orip.PhotoPoints(["1", "2"], ["a", "a"], np.zeros((2, 2)))
block = orip.Block([camera], photos, points, datum="free")
solution = block.adjust(snoop=True, alpha=0.01)
solution = orip.open_project("cliff").solve("MAIN", prune=True)
value: float = solution.cameras["C35"]["C"] + float(solution.points["a"].covariance[0, 0])
for name, photo in solution.photos.items():
    print(name.upper(), photo.orientation.shape, photo.covariance)
try:
    solution.save()
except orip.InputError as error:
    print(len(error.complaints))
"""

WRONG = {
    'orip.Camera("C35", c="35")': "arg-type",
    "solution.sigma": "attr-defined",
    "orip.open_projct": "attr-defined",
    'solution.to_dataframe("point")': "arg-type",
}


def test_a_script_passes_the_type_checker(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT + "\n".join(WRONG) + "\n", encoding="utf-8")
    checker = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--follow-imports=silent"]
    done = subprocess.run([*checker, script], cwd=HERE.parents[1], capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    assert [line.rpartition("[")[2].rstrip("]") for line in lines if "error:" in line] == list(WRONG.values())
    first = len(SCRIPT.splitlines()) + 1
    assert [int(line.split(":")[1]) for line in lines if "error:" in line] == [first + row for row in range(len(WRONG))]
