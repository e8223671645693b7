"""Ctrl-C: while an adjustment iterates it ends after the current iteration; elsewhere nothing is left half-done."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from cli.command_line import orip
from support.long_cases import every
from workflow.small_projects import contents, first_project, replace_in

from orip.__main__ import main as program


def endless(folder: Path) -> Path:
    """Return a project that iterates until it is stopped: no correction ever gets that small."""
    first_project(folder)
    bundle = 'measurement_precision = "0.5px"'
    replace_in(folder / "orip.toml", bundle, f"{bundle}\nenp_stop = 300\nmax_iterations = 1000000")
    return folder


@pytest.mark.parametrize("command", every(2, ["run", "solve"]))
def test_ctrl_c_keeps_the_iteration_in_hand(tmp_path: Path, command: str) -> None:
    folder = endless(tmp_path / "endless")
    orip(folder, "init")
    orip(folder, "measure")
    words = [sys.executable, "-m", "orip.cli.main", "-C", str(folder), command, "--json"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    for line in process.stderr:
        if line.split()[0] == "5":
            process.send_signal(signal.SIGINT)
            break
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "stopping after this iteration" in err
    assert "status   stopped" in err
    result = json.loads(out)
    assert result == json.loads((folder / "result.json").read_text())
    assert result["status"] == "stopped"
    assert result["sigma0"] == pytest.approx(result["iterations"][-1]["sigma0"], rel=1e-6)
    assert all(photo["X0"]["sd"] > 0 for photo in result["photos"].values())
    assert "out of date  stopped" in orip(folder, "status").out


@pytest.mark.parametrize(
    "place", ["orip.workflow.records.initialise.apply_text", "orip.workflow.project.commit.write_definitions"]
)
def test_ctrl_c_before_the_commit_changes_nothing(tmp_path: Path, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = first_project(tmp_path / "first")
    orip(folder, "run")
    replace_in(folder / "orip.toml", "c = 35.0", "c = 35.1")
    before = contents(folder)

    def interrupt(*_arguments: object, **_options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(place, interrupt)
    said = orip(folder, "run", "--json")
    assert said.code == said.document["exit_code"] == 130
    assert "interrupted; stores and outputs are consistent" in said.err
    assert contents(folder) == before


def test_ctrl_c_while_the_program_loads_is_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("orip.cli.main.main", interrupt)
    with pytest.raises(SystemExit) as end:
        program()
    assert end.value.code == 130
    assert capsys.readouterr().err == "error: interrupted before anything was done\n"


def test_the_program_runs_as_a_module(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "orip", "-C", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 3
    assert done.stderr.startswith("error: there is no orip.toml in")
    assert "orip init --sample" in done.stderr
