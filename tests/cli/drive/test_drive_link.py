"""`orip drive emulate` and the commands over the link: what they print, keep and refuse, and how they end."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import contextmanager

import pytest
from cli.command_line import orip
from link.served import OTHER_TABLE, TABLE, Raw, loaded_station, served
from support.aerial_block_in_crs import CRS, aerial_block
from support.driven_projects import add_models
from workflow.small_projects import first_project

from orip.multimodel.link import client as client_module
from orip.multimodel.link.station import bare_stages


@pytest.fixture(autouse=True)
def no_long_pauses(monkeypatch):
    monkeypatch.setattr(client_module, "FIRST_PAUSE_S", 0.01)


@pytest.fixture
def port():
    with served(loaded_station()) as port:
        yield port


@contextmanager
def emulator(*options):
    """Start the command, yield the process and its port, and end it whatever comes."""
    words = [sys.executable, "-m", "orip.cli.main", "drive", "emulate", "--listen", "127.0.0.1:0", *map(str, options)]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        line = process.stdout.readline()
        assert line.startswith("listening on 127.0.0.1:"), process.stderr.read()
        yield process, int(line.rpartition(":")[2])
    finally:
        process.kill()
        process.communicate()


def ended(process, number):
    """Send a signal; return the exit code and what was said at last."""
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert "Traceback" not in said
    return process.returncode, said


def download(client, table=TABLE):
    client.send(b"DOWNLOAD %d\n" % table.count(b"\n") + table)
    assert client.read().startswith("OK LOADED ")


def test_a_signal_ends_it_and_the_state_is_kept(tmp_path):
    state = tmp_path / "state.json"
    with emulator("--state", state) as (process, port), Raw(port) as client:
        download(client)
        client.ask("DRIVE OBJECT 30 0 0")
        assert ended(process, signal.SIGTERM) == (
            0, f"the emulated plate processor has ended (SIGTERM); its state is in {state}\n"
        )  # fmt: skip
    with emulator("--state", state) as (process, port), Raw(port) as client:
        assert client.greeting == "OK KDPP-EMU 1 READY"
        assert client.ask("MODEL?") == "OK M1-2"
        assert client.ask("POS OBJECT") == "OK 30.0000 0.0000 0.0000"
        # the wheels go on from where the mark was
        assert client.ask("MOVE 2 0") == "OK MODEL M1-2 UPPER 46.0040 60.0840 LOWER 35.9940 59.8740"
        assert ended(process, signal.SIGINT)[0] == 0


def test_a_table_survives_a_kill(tmp_path):
    state = tmp_path / "state.json"
    with emulator("--state", state) as (process, port), Raw(port) as client:
        download(client)
        download(client, OTHER_TABLE)
        process.kill()
    with emulator("--state", state) as (_, port), Raw(port) as client:
        assert client.ask("MODELS") == "OK 2"
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


def test_an_emulator_that_is_not_asked_to_keep_anything_says_so(tmp_path):
    with emulator("--speed", "100", "--rate", "20") as (process, port), Raw(port) as client:
        assert client.greeting == "OK KDPP-EMU 1 EMPTY"
        assert client.ask("STATUS").endswith(" MOVING NO")
        assert ended(process, signal.SIGTERM) == (0, "the emulated plate processor has ended (SIGTERM)\n")


def test_a_port_that_is_in_use(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        said = orip(tmp_path, "drive", "emulate", "--listen", address)
    assert said.code == 7
    assert said.err == (
        f"error: {address} is in use by another program, perhaps another emulator; stop that one, or name another "
        "port with --listen\n"
    )


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--listen", "0.0.0.0:0"], "can be reached from other machines"),
        (["--listen", "[::]:0"], "can be reached from other machines"),
        (["--listen", "4788"], "'4788' is not an address to listen on; write HOST:PORT"),
        (["--listen", "127.0.0.1:70000"], "is not an address to listen on"),
        (["--listen", "no-such-host.invalid:0"], "is not known"),
        (["--rate", "50"], "give --speed too"),
        (["--speed", "0"], "speed"),
    ],
)
def test_options_that_cannot_be_used(tmp_path, options, text):
    said = orip(tmp_path, "drive", "emulate", *options)
    assert said.code == 2
    assert text in said.err


def kept(**changes):
    document = {"schema": "orip.plate-processor/1", "table": TABLE.decode(), "model": "M1-1", "mark": None}
    return json.dumps({**document, "plates": [[1.0, 2.0], [3.0, 4.0]], "condition": "IN", **changes})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "Input data was truncated"),
        (kept()[:-40], "not the state of a plate processor, or a damaged one"),
        ("[1, 2]", "Expected `object`, got `array`"),
        (kept(schema="orip.result/1"), "schema"),
        (kept(plates=[[1.0, 2.0]]), "plates"),
        (kept(plates=[[1.0, 2.0], [3.0, 1e999]]), "not the state of a plate processor"),
        (kept(mark=[1.0, "2", 3.0]), "mark"),
        (kept(more=1), "more"),
        (kept(condition="ON"), "condition"),
        (kept(model="M9-9"), "model M9-9 or its plate positions are not within its drive table and the stages"),
        (kept(plates=[[1.0, 2.0], [3.0, -400.0]]), "are not within its drive table and the stages"),
        (kept(table=TABLE.decode()[:-3]), "its drive table: the last line is not END"),
        (kept(table=TABLE.decode().replace("Any", "Äny")), "its drive table"),
    ],
)
def test_a_damaged_state_file(tmp_path, text, reason):
    path = tmp_path / "state.json"
    path.write_text(text, encoding="utf-8")
    said = orip(tmp_path, "drive", "emulate", "--listen", "127.0.0.1:0", "--state", str(path))
    assert said.code == 3
    assert reason in said.err
    assert "remove the file" in said.err
    assert path.read_text(encoding="utf-8") == text


def test_a_state_file_that_cannot_be_written(tmp_path):
    said = orip(tmp_path, "drive", "emulate", "--listen", "127.0.0.1:0", "--state", str(tmp_path / "no" / "state"))
    assert said.code == 1
    assert "cannot be written: there is no such folder; the plate processor's state is not kept" in said.err


def test_goto_where_profile_next_model_forward(tmp_path, port):
    link = ("--link", f"tcp://127.0.0.1:{port}")
    said = orip(tmp_path, "drive", "goto", "30", "-0.5", "0", *link)
    assert (said.code, said.out, said.err) == (
        0, "model M1-2  upper 45.0000 59.8550  lower 34.9900 59.6450  IN\n", ""
    )  # fmt: skip
    assert orip(tmp_path, "drive", "where", *link).out.splitlines() == [
        "model   M1-2  IN",
        "ground  30.0000 -0.5000 0.0000  y-parallax 0.0000 mm",
        "upper   45.0000 59.8550",
        "lower   34.9900 59.6450",
        "left    photo P1-2  5.0000 -0.2500",
        "right   photo P1-3  -5.0000 -0.2500",
        "guide   OBJECT  lock NONE  automatic ON",
    ]
    lines = orip(tmp_path, "drive", "profile", "10", "0", "0", "-10", "0", "-1", "20", *link).out.splitlines()
    assert lines[0] == "10.0000 0.0000 0.0000  model M1-1  upper 34.9950 59.8950  lower 25.0050 60.1050"
    assert len(lines) == 3
    assert orip(tmp_path, "drive", "model", "m1-1", *link).code == 0
    assert orip(tmp_path, "drive", "next", *link).out.startswith("model M1-2 ")
    forward = orip(tmp_path, "drive", "forward", *link)
    assert forward.out == "model M1-2  upper 120.0000 0.0000  lower 120.0000 0.0000  LIMIT\n"


def test_json(tmp_path, port, monkeypatch):
    monkeypatch.setenv("ORIP_LINK", f"tcp://127.0.0.1:{port}")
    assert orip(tmp_path, "drive", "goto", "30", "0", "0", "--json").document == {
        "schema": "orip.drive-to/1",
        "command": "drive goto", "model": "M1-2", "upper": [45.005, 60.105], "lower": [34.995, 59.895],
        "condition": "IN",
    }  # fmt: skip
    assert orip(tmp_path, "drive", "where", "--json").document == {
        "schema": "orip.drive-where/1",
        "command": "drive where", "model": "M1-2", "condition": "IN", "ground": [30.0, 0.0, 0.0], "y_parallax": 0.0,
        "upper": [45.005, 60.105], "lower": [34.995, 59.895], "guide": "OBJECT", "lock": None, "automatic": True,
        "photos": {"left": {"photo": "P1-2", "xy": [5.0, 0.0]}, "right": {"photo": "P1-3", "xy": [-5.0, 0.0]}},
    }  # fmt: skip
    points = orip(tmp_path, "drive", "profile", "30", "0", "0", "30", "0", "200", "200", "--json").document["points"]
    assert points[0]["ground"] == [30.0, 0.0, 0.0]
    assert points[1] == {"ground": [30.0, 0.0, 200.0], "model": None}
    refused = orip(tmp_path, "drive", "goto", "30", "0", "200", "--json")
    assert refused.code == refused.document["exit_code"] == 7
    assert "refused, error 310: the point is not in front of photo" in refused.document["errors"][0]["message"]


def test_rays_that_do_not_meet(tmp_path, port):
    with Raw(port) as client:
        client.ask("DRIVE PHOTO P1-1 1 0")
        client.ask("DRIVE PHOTO P1-2 1 0")
    said = orip(tmp_path, "drive", "where", "--link", f"tcp://127.0.0.1:{port}")
    assert "ground  -  the rays of the two photos do not meet" in said.out
    assert orip(tmp_path, "drive", "where", "--link", f"tcp://127.0.0.1:{port}", "--json").document["ground"] is None


def test_an_empty_plate_processor(tmp_path):
    with served(bare_stages()) as port:
        link = ("--link", f"tcp://127.0.0.1:{port}")
        assert orip(tmp_path, "drive", "where", *link).out.startswith("model   -  IN\nupper   0.0000 0.0000\n")
        said = orip(tmp_path, "drive", "goto", "1", "2", "3", *link)
    assert said.code == 7
    assert "error 200: no table is loaded" in said.err


def test_a_second_operator_is_told_who_is_there(tmp_path, port):
    link = ("--link", f"tcp://127.0.0.1:{port}")
    with Raw(port) as operator:
        said = orip(tmp_path, "drive", "goto", "30", "0", "0", *link)
        assert said.code == 7
        assert f"is operated by {operator.address}; wait, or stop that session" in said.err
        assert orip(tmp_path, "drive", "where", *link).code == 0


def test_nobody_there(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        link = f"tcp://127.0.0.1:{closed.getsockname()[1]}"
    for words in (["goto", "1", "2", "3"], ["where"], ["forward"], ["next"]):
        said = orip(tmp_path, "drive", *words, "--link", link)
        assert said.code == 7
        assert said.err.startswith(f"error: no plate processor answers at {link} (Connection refused); start it")


def test_download(tmp_path):
    """The table is made where it is missing; a table that is there and up to date stays as it is."""
    folder = add_models(first_project(tmp_path / "first"), [("M1", "left", "right", 1, 1)])
    with served(bare_stages()) as port:
        link = ("--link", f"tcp://127.0.0.1:{port}")
        early = orip(folder, "drive", "download", *link)
        assert early.code == 3
        assert "run 'orip init' first" in early.err
        assert orip(folder, "run").code == 0
        (folder / "MAIN.DRV").unlink(missing_ok=True)
        first = orip(folder, "drive", "download", *link)
        assert first.code == 0
        assert f"MAIN.DRV loaded at tcp://127.0.0.1:{port}: 1 model;" in first.err
        again = orip(folder, "drive", "download", *link, "--json").document
        assert (again["changed"], again["file"], again["photos"]) == (False, "MAIN.DRV", 2)
        with Raw(port) as client:
            assert client.ask("DIGEST") == f"OK {again['sha256']}"


def test_coordinates_of_a_crs(tmp_path):
    """They are driven to in the local frame of the table, and read back as eastings, northings and heights."""
    aerial = aerial_block()
    control = aerial.control(dict.fromkeys(range(len(aerial.points)), (0.01, 0.01, 0.01)))
    folder = add_models(aerial.write(tmp_path / "aerial", CRS, control), [("M", *aerial.photo_names[:2], 1, 1)])
    assert orip(folder, "run").code == 0
    with served(bare_stages()) as port:
        link = ("--link", f"tcp://127.0.0.1:{port}")
        assert orip(folder, "drive", "download", *link).code == 0
        seen = [point for photo, point in zip(aerial.photo, aerial.point, strict=True) if photo == 0]
        shared = [
            point for photo, point in zip(aerial.photo, aerial.point, strict=True) if photo == 1 and point in seen
        ]
        xyz = aerial.points[shared[0]].tolist()
        driven = orip(folder, "drive", "goto", *map(str, xyz), *link, "--json").document
        # points are rounded to 0.1 mm, the photo's scale is some 1 : 10 000, the least count 1 um
        measured = {photo: xy for photo, point, xy in zip(aerial.photo, aerial.point, aerial.xy, strict=True)
                    if point == shared[0]}  # fmt: skip
        assert driven["upper"] == pytest.approx(measured[0].tolist(), abs=2e-3)
        assert driven["lower"] == pytest.approx(measured[1].tolist(), abs=2e-3)
        where = orip(folder, "drive", "where", *link, "--json").document
        assert where["ground"] == pytest.approx(xyz, abs=2e-4)
        line = orip(folder, "drive", "profile", *map(str, [*xyz, *xyz]), "1", *link, "--json").document
        assert line["points"][0]["ground"] == pytest.approx(xyz, abs=2e-4)
        nowhere = orip(folder, "drive", "goto", "1e12", "5340000", "0", *link)
        assert nowhere.code == 2
        assert "crs has no place 1e+12 5.34e+06 0" in nowhere.err
        with Raw(port) as client:
            download(client)
        other = orip(folder, "drive", "goto", *map(str, xyz), *link)
        assert other.code == 7
        assert "has a table other than that of bundle MAIN of this project" in other.err
        assert "run 'orip drive download' first" in other.err


def test_a_broken_option_is_no_coordinate(tmp_path):
    said = orip(tmp_path, "drive", "goto", "1", "2", "3", "--lnik", "x")
    assert said.code == 2
