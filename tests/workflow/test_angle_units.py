"""Angles of control in gon and radians: the same result as in degrees."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import first_project, replace_in

ELEMENTS = (
    ("left", "PHOTO", "PHI", -1.079, 0.01),
    ("left", "PHOTO", "Z0", 332.0, 5.0),
    ("S", "THEODOLITE", "R", 10.0, 20.0),
)
DEGREES = {"gon": 0.9, "radians": 57.29577951308232, "degrees": 1.0}


def project(folder: Path, unit: str) -> Path:
    """Return a project with an observed rotation, directions with a zenith angle, and a given direction, in a unit."""
    made, size = first_project(folder), DEGREES[unit]
    angles = {"PHI", "R"}
    lines = (
        (name, group, kind, *(number / size if kind in angles else number for number in numbers))
        for name, group, kind, *numbers in ELEMENTS
    )
    (made / "FIRST.ELE").write_text("".join(" ".join(map(repr_of, line)) + "\n" for line in lines), encoding="utf-8")
    directions = (("2", 78.4, 0.05, 90.9, 0.05), ("3", 351.1, 0.05, 88.4, 0.05))
    (made / "FIRST.DIR").write_text(
        "".join(
            f"S 1 {target} {' '.join(repr(number / size) for number in numbers)}\n" for target, *numbers in directions
        ),
        encoding="utf-8",
    )
    (made / "FIRST.CON").write_text(f"EDGE DIRECTION 1 {0.2 / size!r} 2 166.55 4.55 -2.55\n", encoding="utf-8")
    if unit != "degrees":
        replace_in(made / "orip.toml", 'name = "FIRST"', f'name = "FIRST", angle_unit = "{unit}"')
    return made


def repr_of(value: object) -> str:
    return value if isinstance(value, str) else repr(value)


def result(folder: Path) -> dict:
    said = orip(folder, "run", "--no-report")
    assert said.code == 0, said.err
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))


def numbers(value: object) -> list[float]:
    if isinstance(value, dict):
        return [number for key in sorted(value) if key != "run" for number in numbers(value[key])]
    if isinstance(value, list):
        return [number for item in value for number in numbers(item)]
    return [float(value)] if isinstance(value, int | float) else []


@pytest.mark.parametrize("unit", ["gon", "radians"])
def test_results_are_those_of_degrees(tmp_path: Path, unit: str) -> None:
    plain, other = result(project(tmp_path / "degrees", "degrees")), result(project(tmp_path / unit, unit))
    for part in ("photos", "points", "sigma0"):
        # numbers are written with 17 digits
        assert numbers(other[part]) == pytest.approx(numbers(plain[part]), rel=1e-6, abs=1e-7)
    assert plain["sigma0"] > 0.0


def test_another_unit_is_a_change(tmp_path: Path) -> None:
    made = project(tmp_path / "first", "gon")
    result(made)
    assert "up to date" in next(line for line in orip(made, "status").out.splitlines() if "orip solve" in line)
    replace_in(made / "orip.toml", '"gon"', '"radians"')
    assert "angle_unit of orip.toml" in orip(made, "status").out
    replace_in(made / "orip.toml", '"radians"', '"grad"')
    said = orip(made, "solve")
    assert said.code == 3
    assert "gon" in said.err
