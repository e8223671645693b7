"""What a terminal shows: lines of its width, colour where it is wanted, bars that leave nothing behind."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import first_project, replace_in

if os.name != "posix":
    pytest.skip("needs a pseudo terminal", allow_module_level=True)

from support.pseudo_terminal import NEVER, at_terminal

from orip.workflow.sample_projects import write_sample

PASS_WIDE = re.compile(r" {9} *\d+ +-?\d+\.\d  +\d+  +\d+  +\d+\.\d{4}( \*)?")
PASS_NARROW = re.compile(r" *\d+ +-?\d+\.\d +\d+ +\d+ +\d+\.\d{4}( \*)?")
COLOURS = {"1", "2", "0", "31", "33", "1;31", "1;33"}


@pytest.fixture(scope="module")
def solved_cliff(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terminal") / "cliff"
    write_sample("small_frame_block", folder)
    assert orip(folder, "run", "--no-report").code == 0
    for records in ("photos", "points"):  # so that they need not be found each time
        assert orip(folder, "update", records).code == 0
    assert orip(folder, "run", "--no-report").code == 0  # of the same stores, so that all that follow say the same
    return folder


@pytest.fixture
def cliff(solved_cliff: Path, tmp_path: Path) -> Path:
    """Each test has a folder of its own: after `--snoop` the next `solve` has more to say."""
    return Path(shutil.copytree(solved_cliff, tmp_path / "cliff"))


def summary_of(lines: list[str]) -> list[str]:
    return lines[next(row for row, line in enumerate(lines) if line.startswith("status")) :]


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_lines_fit_the_terminal_and_words_stay_whole(cliff: Path, columns: int) -> None:
    shown = at_terminal(cliff, "solve", "--no-report", columns=columns)
    assert shown.code == 0
    lines = shown.screen
    assert max(map(len, lines)) <= columns
    said = orip(cliff, "solve", "--no-report")
    told = said.err + said.out
    words = set(told.split())
    if columns < 68:
        words |= {"pass", "down", "sing"}
    assert set(" ".join(lines).split()) <= words, "broken words, or numbers that came loose of their units"
    passes = [line for line in lines if re.fullmatch(r"[\d .*-]+", line)]
    assert len(passes) == sum(PASS_WIDE.fullmatch(line) is not None for line in told.splitlines()) > 3
    assert all((PASS_NARROW if columns == 40 else PASS_WIDE).fullmatch(line) for line in passes)
    starts = [line[:9] for line in summary_of(lines)]
    labels = {"status", "sigma0", "check", "misfit", "weak", "points", "photos", "camera", "wrote", "note", ""}
    assert {start.strip() for start in starts} <= labels


def test_numbers_stay_with_their_names_and_units(cliff: Path) -> None:
    shown = at_terminal(cliff, "solve", "--no-report", columns=40)
    broken = [line for line in shown.screen if re.match(r" {9}(±|mm\b|m\b|°)", line)]
    assert broken == []


def test_the_summary_has_twenty_lines_at_most(cliff: Path, tmp_path: Path) -> None:
    shown = at_terminal(cliff, "run", columns=80)
    lines = summary_of(shown.screen)
    assert 10 < len(lines) <= 20
    assert lines[-1].startswith("wrote    report.html")


def test_without_a_terminal_a_line_is_a_line(cliff: Path) -> None:
    lines = summary_of(orip(cliff, "solve").out.splitlines())
    assert len(lines) <= 20
    assert all(line[8] == " " and line[9] != " " for line in lines)


@pytest.mark.parametrize(
    ("words", "environment"),
    [((), {"NO_COLOR": "1"}), (("--color", "never"), {}), ((), {"TERM": "dumb"})],
)
def test_no_escape_sequence_where_no_colour_is_wanted(
    cliff: Path, words: tuple[str, ...], environment: dict[str, str]
) -> None:
    shown = at_terminal(cliff, "solve", "--no-report", *words, environment=environment)
    assert shown.code == 0
    assert b"\x1b" not in shown.raw
    assert b"status   doubtful" in shown.raw


def test_colour_is_sparing(cliff: Path, tmp_path: Path) -> None:
    raw = at_terminal(cliff, "solve", "--no-report").raw.decode()
    found = re.findall(r"\x1b\[([\d;]*)m([^\x1b]*)\x1b\[0m", raw)
    assert [code for code, text in found if text.startswith("status")] == ["1;33"]
    assert [code for code, text in found if text == "misfit"] == ["31"], "the label alone"
    assert {code for code, _text in found} <= COLOURS
    assert len(found) <= 4
    sound = at_terminal(first_project(tmp_path / "first"), "run", "--no-report").raw.decode()
    assert re.findall(r"\x1b\[([\d;]*)mstatus", sound) == ["1"]
    assert "\x1b[31m" not in sound


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_utf8_gets_plain_letters(cliff: Path, encoding: str) -> None:
    shown = at_terminal(cliff, "solve", "--no-report", delay=0.0, encoding=encoding)
    assert shown.code == 0
    text = shown.raw.decode("ascii")
    assert "\\u" not in text
    assert "\\x" not in text
    assert "C 35.361 +- 0.060" in text


def test_lc_all_c_raises_nothing(cliff: Path) -> None:
    words = [sys.executable, "-m", "orip.cli.main", "-C", str(cliff), "solve", "--no-report"]
    for environment in ({"LC_ALL": "C"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}):
        done = subprocess.run(words, env={**os.environ, **environment}, capture_output=True, check=False)
        assert done.returncode == 0
        assert b"C 35.361" in done.stdout


# ------------------------------------------------------------------------------------------------------------ bars


def test_bars_appear_for_long_work_and_leave_nothing_behind(cliff: Path) -> None:
    with_bars = at_terminal(cliff, "run", delay=0.0)
    without = at_terminal(cliff, "run", delay=NEVER)
    assert with_bars.code == 0
    assert with_bars.screen == without.screen
    for stage in ("adjusting", "report"):
        assert re.search(rf"{stage} +[━ ]+ 0:00:0", with_bars.text)
        assert not re.search(rf"{stage} +━", without.text)
    assert with_bars.raw.count(b"\x1b[?25l") == with_bars.raw.count(b"\x1b[?25h"), "the cursor is shown again"


def test_each_pass_is_there_while_the_bar_goes_on(cliff: Path) -> None:
    shown = at_terminal(cliff, "solve", "--snoop", "--no-report", delay=0.0)
    searching = shown.text.index("searching for blunders")
    assert re.search(r" 1  +-\d\.\d  +0  +0  +\d+\.\d{4}\n.*searching for blunders", shown.text[searching:])
    assert not [line for line in shown.screen if "searching" in line]


def test_bars_fit_a_narrow_terminal(cliff: Path) -> None:
    shown = at_terminal(cliff, "solve", "--snoop", "--no-report", delay=0.0, columns=40)
    bars = [line for line in re.split(r"[\r\n]|\x1b\[\??\d*[A-Za-z]", shown.text) if "searching" in line]
    assert bars
    assert max(map(len, bars)) <= 40


@pytest.mark.parametrize(
    ("words", "environment"), [(("--quiet",), {}), ((), {"TERM": "dumb"}), (("--quiet", "--json"), {})]
)
def test_no_bar_where_none_is_wanted(cliff: Path, words: tuple[str, ...], environment: dict[str, str]) -> None:
    shown = at_terminal(cliff, "solve", "--no-report", *words, delay=0.0, environment=environment)
    assert b"adjusting" not in shown.raw
    assert b"\x1b[?25" not in shown.raw
    if "--quiet" in words and "--json" not in words:
        assert shown.raw == b""


def test_an_error_ends_the_bar(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    replace_in(folder / "FIRST.MEA", "1436.4", "1436,4")
    shown = at_terminal(folder, "run", delay=0.0)
    assert shown.code == 3
    assert shown.screen[0].startswith("error: FIRST.MEA:2")
    assert shown.raw.count(b"\x1b[?25l") == shown.raw.count(b"\x1b[?25h")
