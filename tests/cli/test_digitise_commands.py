"""`orip digitise`: a whole project measured through the plate processor, and what the commands say and refuse."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
from cli.command_line import orip
from support.sample_projects import sample

from orip.files.log.text import read_measurements


@contextmanager
def emulator(folder):
    """Run the plate processor as a program of its own; yield its URL."""
    words = [sys.executable, "-m", "orip.cli.main", "-C", str(folder), "drive", "emulate", "--listen", "127.0.0.1:0"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        found = None
        while found is None:
            line = process.stdout.readline()
            assert line, "the emulator ended"
            found = re.search(r"127\.0\.0\.1:[0-9]+", line)
        yield f"tcp://{found[0]}"
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


def new_cliff(folder):
    """Return the small frame block before anything is measured, and the films that its measurements describe."""
    new = sample(folder, "small_frame_block")
    (new / "films").mkdir()
    for name in ("DAY1.MEA", "DAY2.MEA"):
        (new / name).rename(new / "films" / name)
    assert orip(new, "init").code == 0
    return new


def done(folder, *words):
    said = orip(folder, *words)
    assert said.code == 0, said.err
    return said


def numbers(value):
    """Return all numbers of a document in their order."""
    if isinstance(value, dict):
        return [number for key in sorted(value) for number in numbers(value[key])]
    if isinstance(value, list):
        return [number for part in value for number in numbers(part)]
    return [value] if isinstance(value, float) else []


def test_a_project_is_measured_through_the_plate_processor_from_nothing(tmp_path):
    original = sample(tmp_path / "original", "small_frame_block")
    done(original, "run", "-q")
    folder = new_cliff(tmp_path / "new")
    day1 = ["--simulate", "films/DAY1.MEA"]
    day2 = [*day1, "--simulate", "films/DAY2.MEA"]
    with emulator(folder) as url:
        link = ["--link", url]
        for template in ("LEFT", "RIGHT"):
            done(folder, "digitise", "template", template, *link, *day1)
            done(folder, "digitise", "photo", "--template", template, *link, *day1)
        done(folder, "digitise", "points", "--list", "films/DAY1.MEA", *link, *day1)
        # the next day template LEFT is mounted again
        done(folder, "digitise", "template", "LEFT", *link, *day2)
        said = done(folder, "digitise", "points", "--list", "films/DAY2.MEA", *link, *day2)
        assert "log      DIGITISED.MEA: " in said.err
        assert "warning" not in said.err
        assert "warning" not in done(folder, "measure").err
        solved = done(folder, "solve", "--json").document
        expected = json.loads((original / "result.json").read_text())
        assert solved["points"].keys() == expected["points"].keys()
        for key in ("cameras", "photos", "points"):
            # the log has all digits of the films; what is left comes from the order of observations
            assert numbers(solved[key]) == pytest.approx(numbers(expected[key]), rel=1e-4, abs=1e-5)
        assert solved["sigma0"] == pytest.approx(expected["sigma0"], rel=1e-6)
        # oriented, the block is driven in, and a point measured again where the adjustment predicts it
        done(folder, "drive", "table")
        done(folder, "drive", "download", *link)
        (folder / "again.txt").write_text("POINTS MAIN 101\n1103\nPOINTS MAIN 102\n1103\n")
        again = done(folder, "digitise", "points", "--list", "again.txt", "--json", *link, *day2).document
        assert [(entry["owner"], entry["known"], entry["outcome"]) for entry in again["entries"]] == [
            ("101", "predicted", "digitised"), ("102", "predicted", "digitised"),
        ]  # fmt: skip
        for entry in again["entries"]:
            assert entry["driven"] == pytest.approx(entry["xy"], abs=0.02)
        assert (again["log"], again["ending"], again["warnings"]) == ("DIGITISED.MEA", "complete", [])
        ground = done(folder, "digitise", "ground", "1103", "--model", "1-1", *link, *day2, "--json").document
        (point,) = ground["points"]
        assert point["xyz"] == pytest.approx(expected_xyz(expected, "1103"), abs=0.05)


def expected_xyz(result, name):
    return [result["points"][name][axis]["value"] for axis in "XYZ"]


def test_a_dry_run_needs_no_link(tmp_path):
    folder = new_cliff(tmp_path)
    said = done(folder, "digitise", "template", "LEFT", "--dry-run")
    assert said.out.splitlines()[-1].split() == ["tick", "LEFT", "4", "-104.9930", "105.0150", "predicted"]
    assert "trial    4 would be driven to; nothing is written" in said.err
    document = done(folder, "digitise", "template", "LEFT", "--dry-run", "--json").document
    assert document["dry_run"] is True
    assert [entry["name"] for entry in document["entries"]] == ["1", "2", "3", "4"]
    assert not (folder / "DIGITISED.MEA").exists()


def test_usage(tmp_path):
    folder = new_cliff(tmp_path)
    said = orip(folder, "digitise", "template", "LEFT")
    assert said.code == 2
    assert "which plate processor? name it with --link" in said.err
    said = orip(
        folder, "digitise", "template", "LEFT", "--link", "tcp://127.0.0.1:1", "--script", "a", "--simulate", "b"
    )
    assert said.code == 2
    assert "give --simulate or --script" in said.err
    said = orip(folder, "digitise", "template", "LEFT", "--link", "tcp://127.0.0.1:1", "--simulate", "b.MEA")
    assert said.code == 3
    assert "b.MEA: there is no such file" in said.err
    (folder / "script.txt").write_text("FOOT RIGHT\nQUIT\n")
    said = orip(folder, "digitise", "template", "LEFT", "--link", "tcp://127.0.0.1:1", "--script", "script.txt")
    assert said.code == 3
    assert "script.txt:2: 'QUIT' is not an operator's request" in said.err


def test_nobody_answers(tmp_path, monkeypatch):
    monkeypatch.setattr("orip.multimodel.link.client.FIRST_PAUSE_S", 0.001)
    folder = new_cliff(tmp_path)
    said = orip(folder, "digitise", "template", "LEFT", "--link", "tcp://127.0.0.1:1")
    assert said.code == 7
    assert "no plate processor answers at tcp://127.0.0.1:1" in said.err
    assert not (folder / "DIGITISED.MEA").exists()


def digitising(folder, *words):
    words = [sys.executable, "-m", "orip.cli.main", "-C", str(folder), "digitise", *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe, text=True)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_an_operator_types_and_is_interrupted(tmp_path, how):
    folder = new_cliff(tmp_path)
    with emulator(folder) as url, digitising(folder, "template", "LEFT", "--link", url, "--script", "-") as process:
        process.stdin.write("MOVE 1 2\nFOOT RIGHT\nHELP\nFOOT LEFT\nDRIVE PLATE UPPER 3.25 -7\nFOOT RIGHT\n")
        process.stdin.flush()
        heard = []
        for line in process.stderr:
            heard.append(line)
            if line.startswith("at tick 4"):
                break
        time.sleep(0.1)  # it waits for what is typed next
        process.send_signal(how)
        _, err = process.communicate(timeout=20)
    said = "".join(heard) + err
    assert "'HELP' is not an operator's request" in said
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert "2 digitised so far; all of it is in DIGITISED.MEA; repeat the command" in said
    found = read_measurements(folder / "DIGITISED.MEA", "log")
    assert found.complaints == ()
    (record,) = found.value
    assert record.marks.names == ("1", "3")
    assert record.marks.measured[1].tolist() == [3.25, -7.0]


def test_the_operator_who_ends_keeps_what_he_has(tmp_path, monkeypatch):
    folder = new_cliff(tmp_path)
    (folder / "script.txt").write_text("FOOT RIGHT ! the first\nMOVE 1 1\nFOOT RIGHT\nKEY ZERO\n")
    with emulator(folder) as url:
        said = done(folder, "digitise", "template", "LEFT", "--link", url, "--script", "script.txt")
        assert "2 digitised, 0 skipped, 0 kept; ended by the operator" in said.err
        assert "warning: template LEFT: template LEFT has 2 usable marks; transformation A needs 3" in said.err
        monkeypatch.setenv("ORIP_LINK", url)
        refused = orip(folder, "digitise", "photo", "101", "--script", "script.txt")
        assert refused.code == 3
        assert "digitise its tick marks first" in refused.err


def test_groups_and_their_help(tmp_path):
    for command in ("template", "photo", "points", "ground"):
        said = orip(tmp_path, "digitise", command, "--help")
        assert said.code == 0
        assert f"Example: orip digitise {command}" in said.out


def test_why_nothing_is_simulated_is_said(tmp_path):
    folder = sample(tmp_path / "block", "small_frame_block")
    done(folder, "run", "-q")
    with emulator(folder) as url:
        words = ["digitise", "points", "--new", "--model", "2-1", "--log", "NEW.MEA", "--link", url, "--simulate"]
        said = done(folder, *words, "DAY2.MEA", "--json")
        document = said.document
        assert not document["entries"]
        (warning,) = [one for one in document["warnings"] if one["code"] == "not-simulated"]
        assert warning["where"] == "any point in photo 201 and photo 202"
        # the second day has no orientation of the template that stayed mounted
        assert "do not tell where it is: DAY2.MEA:" in warning["text"]
        assert "not oriented" in warning["text"]
        (folder / "list.txt").write_text("POINTS MAIN 101\nNOWHERE\n1103\n")
        words = ["digitise", "points", "--list", "list.txt", "--log", "NEW.MEA", "--link", url, "--json"]
        listed = done(folder, *words, "--simulate", "DAY1.MEA").document
        outcomes = {entry["name"]: entry["outcome"] for entry in listed["entries"]}
        assert outcomes == {"NOWHERE": "kept", "1103": "digitised"}
        unknown = [one["where"] for one in listed["warnings"] if one["code"] == "not-simulated"]
        assert unknown == ["point NOWHERE of 101"]
