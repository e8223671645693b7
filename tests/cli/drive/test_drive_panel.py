"""`orip drive guide`, `move`, `lock` …, beside a running `orip digitise` too; and a drive table that is out of date."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from cli.command_line import orip
from link.served import Raw, served
from workflow.small_projects import film_project, replace_in

from orip.multimodel.emulation import stages_of_words
from orip.multimodel.link.station import bare_stages

TEMPLATE = """TEMPLATE SHEET A UPPER
 1 {0} 0
 2 {1} 0
 3 {1} 100
 4 {0} 100
"""


@pytest.fixture
def port():
    with served() as port:
        yield port


def link_to(port):
    return ("--link", f"tcp://127.0.0.1:{port}")


def test_the_panel_by_commands(tmp_path, port):
    def drive(*words):
        said = orip(tmp_path, "drive", *words, *link_to(port))
        assert said.code == 0, said.err
        return said.out.split("\n")

    assert drive("guide", "upper")[1] == "guide   UPPER  lock NONE  prism 0 0  automatic ON"
    assert drive("move", "1", "-1")[0] == "model M1-1  upper 35.9950 58.8950  lower 25.0050 60.1050  IN"
    assert drive("guide", "4")[1].startswith("guide   MODEL ")
    assert drive("lock", "LEFT")[1] == "guide   MODEL  lock LEFT  prism 0 0  automatic ON"
    assert drive("lock", "none")[1].startswith("guide   MODEL  lock NONE ")
    assert drive("prism", "90")[1] == "guide   MODEL  lock NONE  prism 90 90  automatic ON"
    assert drive("prism", "0", "left")[1] == "guide   MODEL  lock NONE  prism 0 90  automatic ON"
    drive("foot", "right")
    drive("key", "enter")
    with Raw(port) as client:
        assert client.ask("EVENT") == "OK RIGHT UPPER 35.9950 58.8950 LOWER 25.0050 60.1050"
        assert client.ask("EVENT") == "OK KEY ENTER"
    document = orip(tmp_path, "drive", "guide", "object", *link_to(port), "--json").document
    assert document == {
        "schema": "orip.drive-panel/1",
        "command": "drive guide", "model": "M1-1", "guide": "OBJECT", "condition": "IN", "lock": None,
        "prisms": [0, 90], "automatic": True,
    }  # fmt: skip


def test_what_the_panel_refuses(tmp_path, port):
    for words, code, text in [
        (("guide", "sky"), 7, "error 104: 'SKY' is not a guiding system"),
        (("move", "1"), 2, "a movement has two or three increments, not 1"),
        (("key", "16"), 7, "error 104: '16' is not a key"),
        (("prism", "45"), 2, "45"),
        (("foot", "both"), 2, "both"),
    ]:
        said = orip(tmp_path, "drive", *words, *link_to(port))
        assert said.code == code
        assert text in said.err


def test_stages_of_the_emulator():
    assert stages_of_words("table") is None
    upper, lower = stages_of_words("DSR")
    assert upper == lower
    assert (upper.x_min, upper.x_max, upper.y_min, upper.y_max) == (-120.0, 120.0, -120.0, 120.0)
    assert stages_of_words("0,230,-10,250")[0].y_max == 250.0


@pytest.mark.parametrize("words", ["kern", "1,2,3", "1,0,0,1", "nan,1,0,1", "0,1e9,0,1"])
def test_stages_that_are_none(tmp_path, words):
    said = orip(tmp_path, "drive", "emulate", "--listen", "127.0.0.1:0", "--stages", words)
    assert said.code == 2
    assert "names no stages; write dsr, table, or x_min,x_max,y_min,y_max in mm" in said.err


def test_an_operator_with_commands_beside_orip_digitise(tmp_path):
    """What is digitised is heard from another connection; the session says what it waits for, and where to press."""
    folder = film_project(tmp_path / "film")
    assert orip(folder, "init").code == 0
    with served(bare_stages()) as port:
        script = "import sys; from orip.cli.main import main; sys.exit(main())"
        words = ["-C", str(folder), "digitise", "fiducials", "C35", *link_to(port)]
        session = subprocess.Popen(
            [sys.executable, "-c", script, *words], stderr=subprocess.PIPE, text=True
        )  # fmt: skip
        guard = threading.Timer(60.0, session.kill)
        guard.start()
        try:
            said = ""

            def hear(words):
                nonlocal said
                line = ""
                while words not in line:
                    line = session.stderr.readline()
                    assert line, said  # the session has ended
                    said += line

            for mark, (x, y) in enumerate(((-18, -12), (18, -12), (18, 12), (-18, 12)), 1):
                # What is pressed before the session waits does not count.
                hear(f"waiting    fiducial {mark} of C35")
                with Raw(port) as panel:
                    assert panel.ask(f"DRIVE PLATE UPPER {x} {y}").startswith("OK ")
                    assert panel.ask("CLEAR").startswith("ERR 110 hosted by ")
                assert orip(folder, "drive", "foot", "right", *link_to(port)).code == 0
                hear(f"digitised  fiducial {mark} of C35")
            assert "'orip drive foot right'" in said
            hear("waiting    fiducial 5 of C35")
            assert orip(folder, "drive", "key", "ENTER", *link_to(port)).code == 0
            rest = session.communicate(timeout=60)[1]
        finally:
            guard.cancel()
            session.kill()
            session.wait()
    assert session.returncode == 0, rest
    assert (folder / "DIGITISED.MEA").read_text().split("\n") == [
        "! measured for project FIRST",
        "",
        "! orip digitise fiducials C35",
        "FIDUCIALS C35 corners",
        "  1           -18.0000    -12.0000",
        "  2            18.0000    -12.0000",
        "  3            18.0000     12.0000",
        "  4           -18.0000     12.0000",
        "",
    ]


@pytest.fixture
def sheet(tmp_path) -> Path:
    """The first project on film, its left photo on a template; one model."""
    folder = film_project(tmp_path / "sheet")
    ticks = ", ".join(f'{{ name = "{n}", x = {x}, y = {y} }}' for n, (x, y) in
                      enumerate(((0, 0), (100, 0), (100, 100), (0, 100)), start=1))  # fmt: skip
    more = f"""
[[temtick]]
name = "SHEETS"
ticks = [{ticks}]
[[template]]
name = "SHEET"
temtick = "SHEETS"
"""
    replace_in(folder / "orip.toml", 'name = "left"\n', 'name = "left"\ntemplate = "SHEET"\n')
    replace_in(folder / "orip.toml", "[[bundle]]", f"{more}[[bundle]]")
    text = (
        folder / "orip.toml"
    ).read_text() + '[[bundle.model]]\nname = "M"\nleft = "left"\nright = "right"\nrow = 1\ncolumn = 1\n'
    (folder / "orip.toml").write_text(text)
    log = TEMPLATE.format(0, 100) + (folder / "FIRST.MEA").read_text()
    (folder / "FIRST.MEA").unlink()
    (folder / "DAY1.MEA").write_text(log)
    said = orip(folder, "run")
    assert said.code == 0, said.err
    return folder


def driven_upper(said):
    return [float(word) for word in re.search(r"upper (\S+) (\S+)", said.out).groups()]


PLACE = ("1101.3", "2083.6", "108")


def test_a_table_from_before_the_last_mounting_is_said(sheet):
    """The sheet is put 6 mm to the right: said by status and by all that drives until the table is loaded again."""
    stale = "is not the one that the last adjustment, mounting and measurement of marks give"
    with served(bare_stages()) as port:
        link = link_to(port)
        assert orip(sheet, "drive", "download", *link).code == 0
        first = orip(sheet, "drive", "goto", *PLACE, *link)
        assert "warning" not in first.err
        assert "up to date   the plate processor" in orip(sheet, "status", *link).out
        (sheet / "DAY2.MEA").write_text(TEMPLATE.format(6, 106))
        for _measured in range(2):
            moved = orip(sheet, "drive", "goto", *PLACE, *link)
            assert stale in moved.err
            assert driven_upper(moved) == driven_upper(first)
            for words in (("where",), ("model", "M"), ("profile", *PLACE, *PLACE, "1")):
                assert stale in orip(sheet, "drive", *words, *link).err
            assert f"out of date  the drive table at tcp://127.0.0.1:{port} {stale}" in orip(sheet, "status", *link).out
            assert orip(sheet, "measure").code == 0
        assert orip(sheet, "drive", "download", *link).code == 0
        mended = orip(sheet, "drive", "goto", *PLACE, *link)
        assert "warning" not in mended.err
        assert driven_upper(mended) == pytest.approx([driven_upper(first)[0] + 6.0, driven_upper(first)[1]], abs=2e-3)


def test_a_template_that_is_digitised_is_downloaded(sheet):
    """At once, and without 'orip measure'."""
    (sheet / "other").mkdir()
    (sheet / "other/DAY2.MEA").write_text(TEMPLATE.format(6, 106))
    with served(bare_stages()) as port:
        link = link_to(port)
        assert orip(sheet, "drive", "download", *link).code == 0
        first = orip(sheet, "drive", "goto", *PLACE, *link)
        said = orip(sheet, "digitise", "template", "SHEET", "--simulate", "other/DAY2.MEA", *link)
        assert said.code == 0, said.err
        assert "MAIN.DRV with this orientation is loaded into the plate processor" in said.err
        moved = orip(sheet, "drive", "goto", *PLACE, *link)
        assert "warning" not in moved.err
        assert driven_upper(moved) == pytest.approx([driven_upper(first)[0] + 6.0, driven_upper(first)[1]], abs=2e-3)


def test_a_plate_processor_that_status_does_not_reach(sheet):
    said = orip(sheet, "status", "--link", "tcp://127.0.0.1:1")
    assert said.code == 0
    assert "warning: no plate processor answers at tcp://127.0.0.1:1" in said.err
    assert "next     nothing" in said.out
