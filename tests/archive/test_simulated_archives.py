"""Simulated projects: the same every time, and adjusted as they were made."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.command_line import orip
from support.json_schemas import schema_faults
from workflow.quiet import run_quietly

from orip.archive.simulation import FAULTS, simulate_archive, simulated_project
from orip.errors import InputError, UsageError
from orip.files.text.atomic import write_new_folder


def with_fault(fault: str) -> int:
    return next(number for number in range(1, 200) if simulated_project(number, 1, 1.0).fault == fault)


def test_a_project_does_not_depend_on_the_others(tmp_path: Path) -> None:
    written = simulate_archive(tmp_path / "archive", 3, seed=7, faults=1.0)
    assert written.faults.total() == 3
    last = simulated_project(2, 7, 1.0)
    folder = tmp_path / "archive" / last.folder
    assert {path.name: path.read_text() for path in folder.iterdir()} == last.texts
    assert simulated_project(2, 8, 1.0).texts != last.texts
    with pytest.raises(UsageError, match="has something in it already"):
        simulate_archive(tmp_path / "archive", 3, seed=7, faults=0.0)


def test_the_command_says_what_it_wrote(tmp_path: Path) -> None:
    document = orip(tmp_path, "--json", "archive", "simulate", "2", "surveys", "--faults", "1").document
    assert schema_faults(document) == []
    assert sum(document["faults"].values()) == 2


def test_a_project_without_a_fault_fits(tmp_path: Path) -> None:
    write_new_folder(tmp_path / "project", simulated_project(0, 1, 0.0).texts)
    (outcome,) = run_quietly(tmp_path / "project")
    solution = outcome.solution
    assert solution.status == "converged"
    assert len(solution.photos.names) == 12
    # sigma0 of 150 degrees of freedom lies within 20 % with a probability of 0.9995
    assert 0.8 < solution.sigma0 < 1.2
    assert all(gate.passed for gate in outcome.gates)


def test_faults_are_noticed(tmp_path: Path) -> None:
    assert {simulated_project(with_fault(fault), 1, 1.0).fault for fault in FAULTS} == set(FAULTS)
    write_new_folder(tmp_path / "project", simulated_project(with_fault("measurement text"), 1, 1.0).texts)
    with pytest.raises(InputError, match=r"\.MEA:"):
        run_quietly(tmp_path / "project")


def test_some_use_the_cameras_of_another_project() -> None:
    shared = [simulated_project(number, 1, 0.0).texts["orip.toml"].count("camera_file") for number in range(100)]
    assert 5 < sum(shared) < 40
    assert shared[0] == shared[25] == 0
