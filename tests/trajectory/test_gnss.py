"""Positions from the observations of receivers: what is in the files, both ways in time, and RTKLIB's own results."""

from __future__ import annotations

import gzip
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from reference.published_data import REFERENCE_DATA
from support.json_schemas import schema_faults

from orip.errors import Complaint, OripError
from orip.stations.gnss import rtklib
from orip.stations.gnss.receiver_data import read_receiver_file
from orip.stations.gnss.solution import (
    doubted_stretches,
    join_directions,
    parse_solution,
    satellites_used,
    unlike_the_others,
)

GNSS = REFERENCE_DATA / "gnss"
ROVER, BASE, ORBITS = "07590920.05o", "30400920.05o", "30400920.05n"

OLD = """\
     2.10           OBSERVATION DATA    G (GPS)             RINEX VERSION / TYPE
HILL                                                        MARKER NAME
                    TRM29659.00                             ANT # / TYPE
 -3978242.4348  3382841.1715  3649902.7667                  APPROX POSITION XYZ
        1.5000        0.0200        0.0300                  ANTENNA: DELTA H/E/N
                                                            END OF HEADER
 05  4  2  0  0  0.0000000  0 13G 3G 7G 8G11G19G20G24G27G28R 1R 2R 3
                                R 4
 05  4  2  0  0 30.0000000  0  1G 3
 05  4  2  0  0 31.2500000  5  0
 05  4  2  0  1  0.0000000  1  1G 9
"""

NEW = """\
     3.04           OBSERVATION DATA    M (MIXED)           RINEX VERSION / TYPE
                                                            END OF HEADER
> 2024 05 06 07 08 09.5000000  0  2
G07  20000000.123
E11  20000000.123
> 2024 05 06 07 08 10.0000000  5  0
> 2024 05 06 07 08 10.5000000  4  1
                                                            COMMENT
"""


def read(tmp_path: Path, text: str | bytes, name: str = "a.obs"):
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_receiver_file(path, name)


def first_complaint(found) -> str:
    assert isinstance(found, list)
    assert all(isinstance(fault, Complaint) for fault in found)
    return str(found[0])


def test_observations_of_rinex_2(tmp_path):
    found = read(tmp_path, OLD)
    assert (found.kind, found.marker, found.antenna_type) == ("O", "HILL", "TRM29659.00")
    np.testing.assert_array_equal(found.antenna, [0.02, 0.03, 1.5])  # east, north, up
    start = found.time[0]
    np.testing.assert_allclose(found.time - start, [0.0, 30.0, 60.0])
    assert start == 1316 * 604800 + 518400  # the GPS week and its seconds, as RTKLIB prints them of this epoch
    np.testing.assert_allclose(found.events - start, [31.25])
    assert len(found.satellites) == 14
    assert {"G03", "G09", "G28", "R04"} <= found.satellites


def test_observations_of_rinex_3(tmp_path):
    found = read(tmp_path, NEW)
    assert found.satellites == {"G07", "E11"}
    assert len(found.time) == len(found.events) == 1
    assert found.events[0] - found.time[0] == 0.5
    assert np.isnan(found.place).all()


def test_a_compressed_file_is_the_same(tmp_path):
    plain, packed = read(tmp_path, OLD), read(tmp_path, gzip.compress(OLD.encode()), "a.obs.gz")
    assert packed.data == plain.data
    hatanaka = pytest.importorskip("hatanaka")
    text = (GNSS / ROVER).read_bytes() if GNSS.exists() else pytest.skip(f"{GNSS} is not there")
    compact = read(tmp_path, gzip.compress(hatanaka.rnx2crx(text)), "a.crx.gz")
    np.testing.assert_array_equal(compact.time, read(tmp_path, text).time)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "it begins with 'nothing'"),
        ("%PDF-1.4\n", "this is no RINEX file (version 2 to 4)"),
        (OLD[:200], "no END OF HEADER; the file is cut off"),
        (OLD[: OLD.index(" 05")], "no observations after the header"),
        (OLD.replace("OBSERVATION", "METEOROLOG."), "a RINEX file of the kind 'M'"),
        (OLD.replace("        1.5000", "     1500.000 "), "the antenna above its mark is needed"),
        (OLD.replace(" -3978242.4348", " -39782x2.4348"), "three coordinates in metres are needed"),
        (gzip.compress(OLD.encode())[:-20], "the compressed file is cut off"),
        (b"\x1f\x9d\x90", "compressed by compress (.Z); unpack it first"),
        (bytes(range(256)) * 9, "this is no RINEX file"),
    ],
)
def test_what_is_no_file_of_a_receiver(tmp_path, text, said):
    assert said in first_complaint(read(tmp_path, text))


def solution(*rows: tuple[float, float, int, float]):
    """Return a solution of time, X, quality and standard deviation."""
    lines = [
        f"1316 {time:.3f}  {x:.4f}  3382372.5408  3652513.0516   {quality}   7  {sd:.4f} {sd:.4f} {sd:.4f} "
        "0.0000 0.0000 0.0000 0.00 9.9"
        for time, x, quality, sd in rows
    ]
    return parse_solution("\n".join(["% program", *lines]))


def test_both_ways_are_joined_by_quality_not_averaged():
    forward = solution((0, 1.0, 2, 0.5), (30, 2.0, 1, 0.01), (60, 3.0, 1, 0.01), (90, 4.0, 1, 0.01))
    backward = solution((120, 5.0, 1, 0.01), (60, 3.0002, 1, 0.01), (30, 2.06, 1, 0.01), (0, 1.3, 1, 0.01))
    joined = join_directions(forward, backward)
    assert joined.solution.place[:, 0].tolist() == [1.3, 2.0, 3.0, 4.0, 5.0]
    # the same observations twice are not better than once
    np.testing.assert_allclose(joined.solution.deviations, 0.01)
    # 6 cm are another set of integers: not taken for fixed any more, in the file either
    assert joined.solution.quality.tolist() == [1, 2, 1, 1, 1]
    assert joined.solution.lines[1].split()[5] == "2"
    assert joined.solution.lines[1].split()[:5] == forward.lines[1].split()[:5]
    (stretch,) = doubted_stretches(joined)
    assert (stretch.epochs, stretch.why[:45]) == (1, "forward and backward contradict each other: a")
    np.testing.assert_allclose(joined.difference[1:3, 0], [-0.06, -0.0002], atol=1e-9)


def test_stretches_say_from_when_to_when_and_why():
    rows = [(30.0 * at, 1.0, 1, 0.01) for at in range(10)]
    rows[2], rows[3], rows[7] = (60.0, 1.0, 2, 0.4), (90.0, 1.0, 2, 0.3), (210.0, 1.0, 1, 0.09)
    found = doubted_stretches(join_directions(solution(*rows), solution(*rows)))
    assert [(stretch.epochs, stretch.end - stretch.begin) for stretch in found] == [(2, 30.0), (1, 0.0)]
    assert [stretch.why for stretch in found] == ["ambiguities are not fixed", "weak geometry, 7 satellites"]


@pytest.fixture
def folder(tmp_path) -> Path:
    if not GNSS.exists():
        pytest.skip("the folder gnss is not in ../shared/reference-data beside the repository")
    pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    for name in (ROVER, BASE, ORBITS):
        shutil.copy(GNSS / name, tmp_path)
    return tmp_path


def published(name: str):
    return parse_solution((GNSS / name).read_text())


def computed(folder: Path, *words: str) -> dict:
    said = orip(folder, "gnss", ROVER, BASE, ORBITS, *words, "--json")
    assert said.code == 0, said.err
    document = json.loads(said.out)
    assert schema_faults(document) == []
    return document


def test_a_baseline_that_stands(folder):
    found = computed(folder, "--way", "static")
    last = published("static-rnx2rtkp.pos")
    assert found["fixed"] == found["epochs"]
    # the same observations and models in another version of RTKLIB: 3 mm is the accuracy of the method
    np.testing.assert_allclose(found["place"], last.place[-1], atol=0.003)
    vector = np.array(found["place"]) - found["base"]
    np.testing.assert_allclose(vector, [2022.770, -468.628, 2610.290], atol=0.003)
    assert np.linalg.norm(vector) == pytest.approx(3335.389, abs=0.003)
    assert np.linalg.norm(found["closure"]) < 0.01


@pytest.mark.parametrize("way", ["epochs", "kinematic"])
def test_epochs_are_fixed_and_scatter_by_millimetres(folder, way):
    found = computed(folder, "--way", way)
    assert found["fixed"] >= 0.98 * found["epochs"] > 100
    own, theirs = parse_solution((folder / "07590920.pos").read_text()), published("kinematic-rnx2rtkp.pos")
    trusted = own.deviations.max(axis=1) < 0.05  # the last epoch has five satellites and says so itself
    assert np.count_nonzero(~trusted) <= 3
    assert (own.place[trusted].std(axis=0, ddof=1) <= [0.008, 0.008, 0.012]).all()
    common, mine, its = np.intersect1d(own.time, theirs.time, return_indices=True)
    assert len(common) > 100
    np.testing.assert_allclose(own.place[mine], theirs.place[its], atol=0.002)


def test_residuals_and_cycle_slips_of_satellites(folder):
    """What RTKLIB's own program says of them; and a slip of 300 cycles that is put into the observations."""
    found = {row["name"]: row for row in computed(folder)["satellites"]}
    assert len(found) >= 7
    assert all(row["epochs"] > 10 and row["residual"] < 0.02 for row in found.values())
    lines = (folder / ROVER).read_text().splitlines(keepends=True)
    epochs = [at for at, line in enumerate(lines) if line.startswith(" 05  4  2")]
    for at in epochs[60:]:
        names = [lines[at][32 + 3 * n : 35 + 3 * n] for n in range(int(lines[at][29:32]))]
        if "G11" in names:
            row = at + 1 + names.index("G11")
            lines[row] = f"{float(lines[row][:14]) + 300.0:14.3f}" + lines[row][14:]
    (folder / ROVER).write_text("".join(lines))
    slipped = {row["name"]: row for row in computed(folder)["satellites"]}
    assert slipped["G11"]["slips"] > found["G11"]["slips"]
    assert slipped["G19"]["slips"] == found["G19"]["slips"]


def test_satellites_of_a_file_of_status():
    line = "$SAT,1316,518400.000,{},{},1.0,16.2,1.0,{},{},0.0,2,0,1,0,{},0"
    rows = [("G07", 1, 0.003, 1, 0), ("G07", 2, -0.004, 1, 2), ("G07", 1, 9.0, 0, 1), ("G08", 1, 0.5, 0, 3)]
    rows += [(f"E{n:02d}", 1, 0.001, 1, 0) for n in range(5)] + [("E09", 1, 0.1, 1, 0)]
    found = satellites_used("\n".join(["$POS,1", "", *(line.format(*row) for row in rows)]))
    assert [one.name for one in found] == ["E00", "E01", "E02", "E03", "E04", "E09", "G07"]
    assert (found[-1].epochs, found[-1].slips) == (1, 3)
    assert found[-1].residual == pytest.approx(np.sqrt((9.0 + 16.0) / 2.0) / 1000.0)
    assert [one.name for one in unlike_the_others(found)] == ["E09"]


def test_wavelengths_are_those_of_the_thesis():
    """Yom 2000, chapter 4: L1, L2 and the wide lane, of the constants with which RTKLIB computes."""
    rtk = pytest.importorskip("pyrtklib5", reason="pip install 'orip[gnss]'")
    first, second = rtk.FREQL1, rtk.FREQL2
    assert rtk.CLIGHT / first == pytest.approx(0.190294, abs=5e-7)
    assert rtk.CLIGHT / second == pytest.approx(0.244210, abs=5e-7)
    assert (first - second) / 1e6 == pytest.approx(347.82, abs=0.005)
    assert rtk.CLIGHT / (first - second) == pytest.approx(0.861918, abs=5e-7)


def test_the_program_rnx2rtkp_gives_the_same(folder, monkeypatch):
    if shutil.which("rnx2rtkp") is None:
        pytest.skip("rnx2rtkp is not on PATH")
    mine = computed(folder, "--way", "static")
    monkeypatch.setattr(rtklib, "find_spec", lambda _name: None)
    theirs = computed(folder, "--way", "static")
    assert (mine["engine"], theirs["engine"]) == ("pyrtklib5", "rnx2rtkp")
    np.testing.assert_allclose(mine["place"], theirs["place"], atol=0.001)


def test_the_place_of_a_standing_receiver_becomes_control(folder):
    assert orip(folder, "init", "--sample", "drone_rtk", "p").code == 0
    project = folder / "p"
    text = (project / "orip.toml").read_text().replace("EPSG:25832", "EPSG:32654")
    (project / "orip.toml").write_text(text)
    files = [f"../{name}" for name in (ROVER, BASE, ORBITS)]
    refused = orip(project, "gnss", *files, "--point", "B1")
    assert refused.code == 2
    assert "add --way static" in refused.err
    said = orip(project, "gnss", *files, "--way", "static", "--point", "B1")
    assert said.code == 0, said.err
    line = (project / "DRONE.PNT").read_text().splitlines()[-1].split()
    from pyproj import Transformer

    last = published("static-rnx2rtkp.pos").place[-1]
    expected = Transformer.from_crs(4978, 32654, always_xy=True).transform(*last)
    assert line[0] == "B1"
    np.testing.assert_allclose([float(word) for word in line[1:3]], expected[:2], atol=0.003)
    assert all(0.0 < float(word) < 0.01 for word in line[4:])


def test_what_is_wrong_with_the_files_is_said_together_and_nothing_is_written(folder):
    rover = (folder / ROVER).read_text()
    (folder / "old.obs").write_text(rover.replace("\n 05  4  2", "\n 95  4  2"))
    (folder / "cut.obs").write_text(rover[:900])
    for words, said in [
        ((ORBITS, BASE, ROVER), "this file has orbits where observations are needed: the order is ROVER BASE NAV..."),
        ((ROVER, ROVER, ORBITS), "rover and base are the same file"),
        (("old.obs", BASE, ORBITS), "rover and base have no epoch in common: 1995-04-02 00:00:00"),
        (("cut.obs", BASE, ORBITS), "cut.obs:12: the header has no END OF HEADER"),
        ((BASE, ROVER, ORBITS, "--base=-3978242.4348,3382841.1715,3649902.7667"), "are rover and base exchanged?"),
        ((ROVER, BASE, ORBITS, "--systems", "E"), "no satellite of the systems E in common"),
        ((ROVER, BASE, ORBITS, "--base", "35,139,70"), "write geocentric X, Y and Z in metres"),
        ((ROVER, BASE, ORBITS, "--output", BASE), "is a file that is read"),
        ((ROVER, BASE, ORBITS, "--rover-height", "1520"), "'1520' is not a number from -100 to 100"),
        (("nix.obs", "no.obs", "none.nav"), "no.obs: there is no such file"),
    ]:
        answer = orip(folder, "gnss", *words)
        assert answer.code != 0
        assert said in answer.err
    assert not list(folder.glob("*.pos"))


def test_one_epoch_and_no_orbits_of_what_was_observed(folder):
    lines = (folder / ROVER).read_text().splitlines(keepends=True)
    second = [at for at, line in enumerate(lines) if line.startswith(" 05  4  2")][1]
    (folder / "one.obs").write_text("".join(lines[:second]))
    said = orip(folder, "gnss", "one.obs", BASE, ORBITS, "--way", "static")
    assert "there is one epoch in common" in said.err
    assert orip(folder, "gnss", "one.obs", BASE, ORBITS, "--way", "epochs").code == 0
    orbits = (folder / ORBITS).read_text().splitlines(keepends=True)
    end = next(at for at, line in enumerate(orbits) if "END OF HEADER" in line) + 1
    (folder / "few.nav").write_text("".join(orbits[: end + 8]))
    answer = orip(folder, "gnss", ROVER, BASE, "few.nav")
    assert answer.code != 0
    assert "RTKLIB finds no position" in answer.err or "other satellites" in answer.err


def test_without_rtklib_the_command_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setattr(rtklib, "find_spec", lambda _name: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OripError, match=r"pip install 'orip\[gnss\]'"):
        rtklib.engine()
    said = orip(tmp_path, "gnss", "a", "b", "c")
    assert said.code != 0
    assert "rnx2rtkp on PATH" in said.err


def test_a_process_that_breaks_off_is_one_sentence():
    settings = rtklib.Settings("static", (1.0, 2.0, 6.4e6))
    with pytest.raises(OripError, match="RTKLIB broke off"):
        rtklib.run_rtklib(settings, [], shutil.which("false") or "/bin/false")
