"""A flight that is followed beside its plan, from NMEA lines made without orip's geometry."""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
import urllib.request
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyproj
import pytest
from cli.command_line import orip
from planning.test_plan_commands import project, stations

from orip.errors import UsageError
from orip.planning.following.progress import FollowedFlight, begin_flight, move_to
from orip.planning.following.receiver import lines_of, read_fix
from orip.records.control import Station
from orip.web.page_server import WatchServer

SEPARATION = 42.3


def sentence(body: str) -> str:
    total = 0
    for byte in body.encode("ascii"):
        total ^= byte
    return f"${body}*{total:02X}\r\n"


def degrees(value: float, width: int, letters: str) -> str:
    whole, minutes = divmod(abs(value) * 60.0, 60.0)
    return f"{int(whole):0{width}d}{minutes:010.7f},{letters[value < 0.0]}"


def gga(longitude: float, latitude: float, height: float, quality: int = 4) -> str:
    place = f"{degrees(latitude, 2, 'NS')},{degrees(longitude, 3, 'EW')}"
    return sentence(f"GNGGA,101500.00,{place},{quality},15,0.7,{height:.4f},M,{SEPARATION},M,1.0,0001")


def flight_of(places: np.ndarray, step: float = 4.0) -> np.ndarray:
    """Return the way (n, 3) along places, with fixes every few metres that hit none of them by intent."""
    way = [places[0] - [7.3, 0.0, 0.0]]
    for start, end in pairwise(places):
        count = max(1, int(np.linalg.norm(end - start) / step))
        way += [start + (end - start) * (k + 0.37) / count for k in range(count)]
    return np.array([*way, places[-1] + (places[-1] - places[-2]) * 0.3])


def nmea_of(way: np.ndarray) -> list[str]:
    to_degrees = pyproj.Transformer.from_crs("EPSG:25832", "EPSG:4258", always_xy=True)
    return [gga(*to_degrees.transform(x, y), z) for x, y, z in way.tolist()]


@pytest.fixture
def planned(tmp_path):
    folder = project(tmp_path / "p", direction="90.0")
    assert orip(folder, "plan", "make").code == 0
    return folder, stations(folder)


def test_positions_of_sentences():
    fix = read_fix("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n")
    assert (fix.latitude, fix.longitude) == pytest.approx((48.1173, 11.516666667))
    assert (fix.height, fix.separation, fix.quality) == (545.4, 46.9, 1)
    assert read_fix(gga(-70.5, -33.25, 100.0)).latitude == pytest.approx(-33.25, abs=1e-9)
    assert read_fix(sentence("GPGGA,123519,,,,,0,00,,,M,,M,,")) is None
    assert read_fix(sentence("GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W")) is None
    assert read_fix("!AIVDM,1,1") is None
    for damaged in ("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.5,M,46.9,M,,*47", "$GPGGA,1,2*4F"):
        with pytest.raises(ValueError, match="check sum"):
            read_fix(damaged)
    with pytest.raises(ValueError, match="latitude"):
        read_fix("$GPGGA,123519,48x7.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")


def test_a_flight_as_planned_is_all_flown(planned):
    folder, exposures = planned
    lines = nmea_of(flight_of(np.array([one.position for one in exposures])))
    lines.insert(20, "$GPGGA,broken*00\r\n")
    (folder / "flight.nmea").write_text("".join(lines), encoding="ascii")
    found = orip(folder, "plan", "follow", "flight.nmea", "--json").document
    assert found["flown"] == [one.photo for one in exposures]
    assert (found["missed"], found["left"], found["damaged_lines"]) == ([], [], 1)
    told = orip(folder, "plan", "follow", "flight.nmea")
    assert f"{len(exposures)} exposures flown, 0 missed, 0 left" in told.out
    assert "1 lines were damaged" in told.out


def test_what_is_left_out_and_beside_the_plan_is_missed(planned):
    folder, exposures = planned
    places = np.array([one.position for one in exposures])
    strips = list(dict.fromkeys(one.strip for one in exposures))
    first = [row for row, one in enumerate(exposures) if one.strip == strips[0]]
    moved = places.copy()
    moved[first[2:4], 1] += 14.0  # beside the plan
    moved[first[-2], 2] += 30.0  # too high
    flown = [row for row, one in enumerate(exposures) if one.strip != strips[-1]]
    (folder / "flight.nmea").write_text("".join(nmea_of(flight_of(moved[flown]))), encoding="ascii")
    found = orip(folder, "plan", "follow", "flight.nmea", "--json").document
    assert set(found["missed"]) == {exposures[row].photo for row in (first[2], first[3], first[-2])}
    assert found["left"] == [one.photo for one in exposures if one.strip == strips[-1]]
    again = nmea_of(flight_of(places[first]))
    with (folder / "flight.nmea").open("a", encoding="ascii") as text:
        text.writelines(again)
    assert orip(folder, "plan", "follow", "flight.nmea", "--json").document["missed"] == []


def straight(count: int = 5, height: float = 80.0) -> list[Station]:
    return [
        Station(f"{strip}{k}", (20.0 * k, 50.0 * row, height), (-1.0,) * 3, strip=strip)
        for row, strip in enumerate("AB")
        for k in (range(count) if row == 0 else reversed(range(count)))
    ]


def test_where_the_camera_is_beside_the_next_exposure():
    progress = begin_flight(straight())
    assert progress.flight.within == pytest.approx(5.0)
    for place in ([-10.0, 0.0, 80.0], [5.0, 0.0, 80.0], [25.0, -3.0, 84.0]):
        progress = move_to(progress, np.array(place))
    assert progress.of("flown") == ("A0", "A1")
    beside = progress.beside()
    assert progress.flight.names[progress.next] == "A2"
    assert (beside.ahead, beside.right, beside.above) == pytest.approx((15.0, 3.0, 4.0))
    assert np.degrees(progress.course) == pytest.approx(98.5, abs=0.1)


def test_a_strip_may_be_flown_backwards():
    progress = begin_flight(straight())
    for x in (95.0, 75.0, 55.0):
        progress = move_to(progress, np.array([x, 1.0, 80.0]))
    assert progress.of("flown") == ("A3", "A4")
    assert progress.flight.names[progress.next] == "A2"
    beside = progress.beside()
    assert (beside.ahead, beside.right) == pytest.approx((15.0, 1.0))


def test_sources(tmp_path):
    text = gga(9.0, 50.0, 100.0)
    server = socket.create_server(("127.0.0.1", 0))

    def send() -> None:
        connection, _ = server.accept()
        with connection:
            connection.sendall(text.encode("ascii") * 3)

    thread = threading.Thread(target=send)
    thread.start()
    with server, lines_of(f"tcp://127.0.0.1:{server.getsockname()[1]}", tmp_path, 9600) as lines:
        assert list(lines) == [text] * 3
    thread.join()
    for wrong, said in (("none.nmea", "there is no none.nmea"), ("tcp://host", "is no address"), (".", "neither")):
        with pytest.raises(UsageError, match=said), lines_of(wrong, tmp_path, 9600):
            pass


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such serial lines")
def test_a_serial_line(tmp_path):
    other, line = os.openpty()
    device = os.ttyname(line)
    with lines_of(device, tmp_path, 38400) as lines:
        os.write(other, gga(9.0, 50.0, 100.0).encode("ascii"))
        assert read_fix(next(lines)).longitude == 9.0
        os.close(other)
        os.close(line)


def test_a_project_without_crs_says_so(tmp_path):
    folder = project(tmp_path / "p")
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    (folder / "orip.toml").write_text(text.replace(', crs = "EPSG:25832"', ""), encoding="utf-8")
    assert orip(folder, "plan", "make").code == 0
    refused = orip(folder, "plan", "follow", "flight.nmea")
    assert refused.code != 0
    assert "has no crs" in refused.err


def test_the_page_shows_where_the_flight_is():
    progress = begin_flight(straight())
    flight = FollowedFlight(progress, "m")
    server = WatchServer(flight)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        scene = json.load(urllib.request.urlopen(f"{server.url}scene"))
        assert [photo["name"] for photo in scene["photos"]] == list(progress.flight.names)
        for x in (-10.0, 5.0):
            progress = move_to(progress, np.array([x, 0.0, 80.0]))
            flight.show(progress, read_fix(gga(9.0, 50.0, 100.0)))
        with urllib.request.urlopen(f"{server.url}events") as stream:
            state = json.loads(stream.readline().removeprefix(b"data: "))
        assert state["states"] == "fppppppppp"
        assert (state["next"], state["quality"], state["flown"]) == ("A1", "RTK fixed", 1)
        assert state["beside"] == {"ahead": 15.0, "right": 0.0, "above": 0.0}
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def test_the_page_is_in_the_package():
    assert (Path(str(FollowedFlight(begin_flight(straight()), "m").page))).is_file()
