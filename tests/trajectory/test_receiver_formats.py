"""Logs of u-blox and RTCM 3, compressed RINEX, SP3 and clocks, ANTEX and antenna heights, with genuine observations."""

from __future__ import annotations

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from reference.published_data import REFERENCE_DATA
from trajectory import rinex_versions
from trajectory.precise_orbits import antex, clocks, sp3
from trajectory.receiver_streams import rtcm3, ubx

from orip.geometry.ground_ellipsoid import geographic_from_geocentric, place_axes
from orip.stations.gnss.given_files import read_antex
from orip.stations.gnss.raw_files import log_of, moment, seconds_of_date
from orip.stations.gnss.receiver_data import read_receiver_file
from orip.stations.interpolation import WGS84

GNSS = REFERENCE_DATA / "gnss"
ROVER, BASE, ORBITS = "07590920.05o", "30400920.05o", "30400920.05n"
MARK = "--base=-3978242.4348,3382841.1715,3649902.7667"
DAY = 1316 * 604_800.0 + 6 * 86_400.0

SMALL = """\
     2.10           OBSERVATION DATA    G (GPS)             RINEX VERSION / TYPE
 -3978242.4348  3382841.1715  3649902.7667                  APPROX POSITION XYZ
     4    L1    C1    L2    P2                              # / TYPES OF OBSERV
                                                            END OF HEADER
 05  4  2  0  0  0.0000000  0  1G 3
  55923622.160    24767686.375    43647388.2424   24767684.8224
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    if not GNSS.exists():
        pytest.skip("the folder gnss is not in ../shared/reference-data beside the repository")
    pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    found = tmp_path_factory.mktemp("formats")
    for name in (ROVER, BASE, ORBITS):
        shutil.copy(GNSS / name, found)
    return found


def place(folder: Path, rover: str, base: str, *more: str) -> np.ndarray:
    said = orip(folder, "gnss", rover, base, *more, "--way", "static", "-o", "found.pos", "--json")
    assert said.code == 0, said.err
    document = json.loads(said.out)
    assert document["fixed"] > 100
    return np.array(document["place"])


@pytest.fixture(scope="module")
def expected(folder) -> np.ndarray:
    return place(folder, ROVER, BASE, ORBITS)


def test_logs_are_known_by_their_messages():
    assert log_of(ubx(SMALL)) == "ubx"
    assert log_of(rtcm3(SMALL)) == "rtcm3"
    assert log_of(b"$GPGGA,1,2\r\n" + ubx(SMALL)) == "ubx"
    assert log_of(ubx(SMALL)[:-1] + b"\x00") is None  # a wrong check sum
    assert log_of(SMALL.encode()) is None
    assert log_of(b"") is None


@pytest.mark.parametrize(("ending", "made"), [(".ubx", ubx), (".rtcm3", rtcm3)])
def test_logs_of_receivers_give_the_same_baseline(folder, expected, ending, made):
    if shutil.which("convbin") is None:
        pytest.skip("convbin is not on PATH")
    for name in (ROVER, BASE):
        (folder / f"{name[:4]}{ending}").write_bytes(made((GNSS / name).read_text()))
    # the numbers of a log are those of RINEX; RTCM 3 has phases to 0.5 mm
    found = place(folder, f"0759{ending}", f"3040{ending}", ORBITS, MARK)
    np.testing.assert_allclose(found, expected, atol=0.001)


def test_without_a_converter_the_message_says_so(tmp_path, monkeypatch):
    (tmp_path / "a.ubx").write_bytes(ubx(SMALL))
    monkeypatch.setenv("PATH", str(tmp_path))
    (fault,) = read_receiver_file(tmp_path / "a.ubx", "a.ubx")
    assert "put convbin on PATH" in str(fault)


def test_a_log_without_a_week_or_without_what_is_wanted(tmp_path):
    if shutil.which("convbin") is None:
        pytest.skip("convbin is not on PATH")
    (tmp_path / "a.rtcm3").write_bytes(rtcm3(SMALL))
    (fault,) = read_receiver_file(tmp_path / "a.rtcm3", "a.rtcm3")
    assert "RTCM 3 does not say the week" in str(fault)
    found = read_receiver_file(tmp_path / "a.rtcm3", "a.rtcm3", near=DAY + 2 * 86_400.0)
    assert (moment(found.time[0]), found.satellites) == ("2005-04-02 00:00:00", {"G03"})
    (fault,) = read_receiver_file(tmp_path / "a.rtcm3", "a.rtcm3", "N", near=DAY)
    assert "convbin finds no orbits" in str(fault)


def test_compressed_observations_give_the_same(folder, expected):
    hatanaka = pytest.importorskip("hatanaka", reason="pip install 'orip[gnss]'")
    for name in (ROVER, BASE):
        text = (folder / name).read_bytes()
        (folder / f"{name[:-1]}d.gz").write_bytes(gzip.compress(hatanaka.rnx2crx(text)))
    (folder / "orbits.n.gz").write_bytes(gzip.compress((folder / ORBITS).read_bytes()))
    found = place(folder, f"{ROVER[:-1]}d.gz", f"{BASE[:-1]}d.gz", "orbits.n.gz")
    np.testing.assert_array_equal(found, expected)


def test_precise_orbits(folder, expected):
    """Made of the broadcast orbits, they give the same: interpolation is good to centimetres, 3 km away to nothing."""
    (folder / "day.sp3").write_text(sp3((GNSS / ORBITS).read_text(), DAY - 3600.0, DAY + 7200.0))
    np.testing.assert_allclose(place(folder, ROVER, BASE, "day.sp3", ORBITS), expected, atol=0.001)
    said = orip(folder, "gnss", ROVER, BASE, "day.sp3")
    assert "RTKLIB needs broadcast orbits beside precise ones" in said.err
    (folder / "day.sp3.gz").write_bytes(gzip.compress((folder / "day.sp3").read_bytes()))
    np.testing.assert_allclose(place(folder, ROVER, BASE, "day.sp3.gz", ORBITS), expected, atol=0.001)
    (folder / "other.sp3").write_text(sp3((GNSS / ORBITS).read_text(), DAY + 7200.0, DAY + 9000.0))
    said = orip(folder, "gnss", ROVER, BASE, "other.sp3", ORBITS)
    assert "2005-04-02 02:00:00 to 2005-04-02 02:30:00 does not serve for" in said.err
    for text, words in (("nothing", "no orbits in SP3"), ("#cP2005", "no epochs in this file")):
        (folder / "bad.sp3").write_text(text)
        assert words in orip(folder, "gnss", ROVER, BASE, "bad.sp3").err
    (folder / "bad.clk").write_text("nothing")
    assert "no clocks in RINEX" in orip(folder, "gnss", ROVER, BASE, ORBITS, "bad.clk").err


def test_clocks_of_a_file_beside_orbits_without(folder, expected):
    """With the clocks of the broadcast orbits it is as before; with ones wrong by 20 ms no codes fit."""
    text, span = (GNSS / ORBITS).read_text(), (DAY - 3600.0, DAY + 7200.0)
    (folder / "orbits.sp3").write_text(sp3(text, *span, has_clocks=False))
    (folder / "day.clk").write_text(clocks(text, *span))
    np.testing.assert_allclose(place(folder, ROVER, BASE, "orbits.sp3", "day.clk", ORBITS), expected, atol=0.001)
    (folder / "wrong.clk").write_text(clocks(text, *span, wrong=0.02))
    said = orip(folder, "gnss", ROVER, BASE, "orbits.sp3", "wrong.clk", ORBITS)
    assert "RTKLIB finds no position" in said.err


@pytest.mark.parametrize("version", ["3.05", "4.01"])
@pytest.mark.parametrize("program", ["pyrtklib5", "rnx2rtkp"])
def test_newer_versions_of_rinex_give_the_same(folder, expected, monkeypatch, version, program):
    if program == "rnx2rtkp":
        if shutil.which(program) is None:
            pytest.skip("rnx2rtkp is not on PATH")
        monkeypatch.setattr("orip.stations.gnss.rtklib.find_spec", lambda _name: None)
    for name, target in ((ROVER, "rover.rnx"), (BASE, "base.rnx")):
        (folder / target).write_text(rinex_versions.observations((GNSS / name).read_text(), version))
    (folder / "orbits.rnx").write_text(rinex_versions.orbits((GNSS / ORBITS).read_text(), version))
    np.testing.assert_allclose(place(folder, "rover.rnx", "base.rnx", "orbits.rnx"), expected, atol=0.001)


def test_antenna_heights_and_phase_centres_move_the_mark(folder, expected):
    """What lies between mark and phase centre is known: the position moves by its opposite, to rounding."""
    axes = place_axes(geographic_from_geocentric(expected[None], WGS84))[0]
    high = place(folder, ROVER, BASE, ORBITS, "--rover-height", "1.5")
    np.testing.assert_allclose(axes @ (high - expected), [0.0, 0.0, -1.5], atol=0.002)
    high = place(folder, ROVER, BASE, ORBITS, "--base-height", "0.5")
    np.testing.assert_allclose(axes @ (high - expected), [0.0, 0.0, 0.5], atol=0.002)
    own = antex({"TRM29659.00     NONE": (0.0, 0.0, 0.0), "XYZ             NONE": (0.03, -0.02, 0.11)})
    (folder / "own.atx").write_text(own)
    found = place(folder, ROVER, BASE, ORBITS, "--antex", "own.atx", "--rover-antenna", "XYZ NONE")
    np.testing.assert_allclose(axes @ (found - expected), [0.02, -0.03, -0.11], atol=0.002)
    none = place(folder, ROVER, BASE, ORBITS, "--antex", "own.atx")
    np.testing.assert_allclose(none, expected, atol=0.0005)


def test_rnx2rtkp_takes_the_same_calibrations(folder, expected, monkeypatch):
    if shutil.which("rnx2rtkp") is None:
        pytest.skip("rnx2rtkp is not on PATH")
    from orip.stations.gnss import rtklib

    own = antex({"TRM29659.00     NONE": (0.0, 0.0, 0.0), "XYZ             NONE": (0.03, -0.02, 0.11)})
    (folder / "two.atx").write_text(own)
    words = (ROVER, BASE, ORBITS, "--antex", "two.atx", "--rover-antenna", "XYZ")
    mine = place(folder, *words)
    monkeypatch.setattr(rtklib, "find_spec", lambda _name: None)
    np.testing.assert_allclose(place(folder, *words), mine, atol=0.001)


def test_what_is_wrong_with_calibrations_is_said(folder):
    (folder / "some.atx").write_text(antex({"TRM41249.00     NONE": (0.0, 0.0, 0.0)}))
    said = orip(folder, "gnss", ROVER, BASE, ORBITS, "--antex", "some.atx")
    assert "antenna 'TRM29659.00' is not in some.atx; give its type with --rover-antenna: TRM41249.00" in said.err
    assert "--base-antenna" in said.err
    (folder / "cut.atx").write_text(antex({"A               NONE": (0.0, 0.0, 0.0)})[:-90])
    assert "1 antennas begin and 0 end" in str(read_antex(folder / "cut.atx"))
    assert "no ANTEX VERSION" in orip(folder, "gnss", ROVER, BASE, ORBITS, "--antex", ORBITS).err


def test_dates():
    assert moment(DAY) == "2005-04-02 00:00:00"
    assert seconds_of_date([5.0, 4.0, 2.0, 0.0, 0.0, 0.0]) == DAY
    assert seconds_of_date([5.0, 13.0, 2.0, 0.0, 0.0, 0.0]) is None
