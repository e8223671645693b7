"""The stereo screen: rectified photos, the same readings as the emulator's, and what is measured on the disk."""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import suppress
from http.client import HTTPException
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

Images = pytest.importorskip("PIL.Image")
cv2 = pytest.importorskip("cv2")

from cli.command_line import orip  # noqa: E402  # after what it needs
from link.served import loaded_station, served  # noqa: E402
from screen.rendered_project import asked  # noqa: E402
from screen.stereo_project import Adjusted, adjusted_strip, served_stereo, stereo_of  # noqa: E402
from support.driven_projects import measured, residuals_of  # noqa: E402
from support.rendered_surface import COLUMNS, MODELS, NOISE, PHOTOS, PIXEL, ROWS, C, ground_points, height, write_strip  # noqa: E402

from orip.files.log.stereo import read_stereo  # noqa: E402
from orip.multimodel.link.client import open_link  # noqa: E402
from orip.multimodel.movement import drive_object  # noqa: E402
from orip.multimodel.readout import object_position, photo_positions  # noqa: E402
from orip.screen.stereo_screen import STEREO_FILE  # noqa: E402
from orip.web.page_server import RequestError  # noqa: E402


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Adjusted:
    return adjusted_strip(tmp_path_factory.mktemp("stereo") / "project")


@pytest.fixture
def project(adjusted: Adjusted) -> Path:
    for name in (STEREO_FILE, "hills.GEO"):
        (adjusted.folder / name).unlink(missing_ok=True)
    return adjusted.folder


def test_rectified_points_have_the_parallax_that_the_adjustment_has_left(adjusted: Adjusted) -> None:
    """y of measured points, left minus right, is minus that of their residuals, turned to the base by hand."""
    processor, _ = stereo_of(adjusted.folder)
    log, residuals = measured(adjusted.folder / "hills.MEA"), residuals_of(adjusted.solution)
    off, count = 0.0, 0
    for model in range(PHOTOS - 1):
        names, pair = processor.photo_names(model), processor.rectified(model)
        for point in (name for photo, name in log if photo == names[0] and (names[1], name) in log):
            y, expected = [], 0.0
            for side, photo in enumerate(names):
                xy = log[photo, point]
                y.append(pair.place(side, tuple(xy))[1])
                # residuals are small: their direction and scale in the rectified photo by a step of a pixel
                step = [pair.place(side, tuple(xy + one)) for one in ([0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5])]
                by_column, by_row = step[0][1] - step[1][1], step[2][1] - step[3][1]
                vx, vy = residuals[photo, point]
                expected += (-1.0, 1.0)[side] * (by_column * vx / PIXEL - by_row * vy / PIXEL)
            off, count = max(off, abs(y[0] - y[1] - expected)), count + 1
    assert count > 60
    assert off < 0.05


def test_a_point_of_the_ground_is_seen_in_one_row(adjusted: Adjusted) -> None:
    """By the true orientations: what a photo shows of the surface is where the rectified tile has it."""
    processor, screen = stereo_of(adjusted.folder)
    at = np.array([[200.0, 150.0], [300.0, 250.0]])
    for model in range(PHOTOS - 1):
        pair = processor.rectified(model)
        for side, name in enumerate(processor.photo_names(model)):
            tile = np.asarray(Images.open(BytesIO(screen.picture(f"{model}/{side}/0/0/0"))).convert("L"), dtype=float)
            for place in at:
                log = pair.logs_of(side, place[None, :] + [0.5, 0.5])[0]
                grey = cv2.getRectSubPix(adjusted.strip.photos[int(name[1])].astype(np.float32), (1, 1), log - 0.5)
                assert abs(tile[int(place[1]), int(place[0])] - grey[0, 0]) < 6.0  # JPEG, and another interpolation
                assert pair.place(side, tuple(log)) == pytest.approx(tuple(place + 0.5), abs=1e-6)


def test_screen_and_emulator_read_the_same(adjusted: Adjusted) -> None:
    """To 1e-6 mm by the emulator's own state, and to the last decimal of what it says on the link."""
    _, screen = stereo_of(adjusted.folder)
    station = loaded_station((adjusted.folder / "MAIN.DRV").read_bytes())
    state, random, changes = station.state, np.random.default_rng(3), set()
    with served(station) as port, open_link(f"tcp://127.0.0.1:{port}") as link:
        for xyz in ground_points(adjusted.strip, 60, random):
            shown = screen.commands["drive"]({"object": xyz.tolist()})["state"]
            link.drive_object(*xyz.tolist())
            state, _ = drive_object(station.block, state, tuple(xyz.tolist()))
            status, there = link.status(), object_position(station.block, state)
            assert (scene_model(screen, shown), shown["condition"]) == (status.model, status.condition)
            changes.add(status.model)
            photos = [one.xy for one in photo_positions(station.block, state)]
            assert np.abs(np.subtract(shown["photos"], photos)).max() < 1e-6
            assert np.abs(np.subtract(shown["mark"], there.xyz)).max() < 1e-6
            assert abs(shown["y_parallax"] - there.y_parallax) < 1e-6
            assert np.abs(np.subtract(shown["plates"], link.position("PLATE"))).max() < 1e-6
            said = [one.xy for one in link.position("PHOTO")]
            assert np.abs(np.subtract(shown["photos"], said)).max() <= 0.5e-4 + 1e-9
    assert len(changes) == PHOTOS - 1


def scene_model(screen, state) -> str:
    return screen.scene["models"][state["model"]]["name"]


def test_an_operator_measures_the_surface(project: Path, adjusted: Adjusted) -> None:
    """Points set with noise in both photos: coordinates off the truth by their standard deviations."""
    strip, random = adjusted.strip, np.random.default_rng(23)
    truth = ground_points(strip, 60, random)
    with served_stereo(project) as server:
        scene = asked(server.url, "scene")[1]
        for number, xyz in enumerate(truth):
            _, said = asked(server.url, "drive", {"object": xyz.tolist()})
            assert said["refused"] is None
            for photo in scene["models"][said["state"]["model"]]["photos"]:
                x, y = (strip.pixels(int(photo[1]), xyz)[0] + NOISE * random.normal(size=2)).tolist()
                assert asked(server.url, "plate", {"photo": photo, "x": x, "y": y})[1]["refused"] is None
            status, said = asked(server.url, "record", {"kind": "POINT", "code": "G", "name": f"{number}"})
            assert (status, said["said"]) == (200, f"recorded POINT G {number}")
    found = orip(project, "restitute", "compute", STEREO_FILE, "--json")
    assert found.code == 0, found.err
    rows = [line.split() for line in (project / "hills.GEO").read_text().splitlines() if line.startswith(" ")]
    off = np.array([[float(word) for word in row[:6]] for row in rows])
    standardised = (off[:, :3] - truth) / off[:, 3:]
    assert 0.8 < np.sqrt(np.mean(standardised**2)) < 1.2
    assert np.abs(standardised).max() < 4.5


def test_matching_sets_the_mark_on_the_surface(project: Path, adjusted: Adjusted) -> None:
    _, screen = stereo_of(project)
    off, left_alone = [], 0
    for xyz in ground_points(adjusted.strip, 10, np.random.default_rng(31)):
        screen.commands["drive"]({"object": np.add(xyz, [0.0, 0.0, 2.0]).tolist()})
        try:
            said = screen.commands["match"]({})
        except RequestError as error:
            left_alone += "matching:" in str(error)
            continue
        state = said["state"]
        names = screen.scene["models"][state["model"]]["photos"]
        surface = adjusted.strip.surface(int(names[0][1]), np.array([state["pixels"][0]]))
        off.append(np.subtract(state["pixels"][1], adjusted.strip.pixels(int(names[1][1]), surface)[0]))
    assert left_alone <= 3
    assert len(off) + left_alone == 10
    assert np.sqrt(np.mean(np.square(off))) < 0.12


def test_movements_are_seen_as_they_are_asked_for(project: Path) -> None:
    _, screen = stereo_of(project)
    for guide in ("OBJECT", "MODEL", "BOTH", "UPPER", "LOWER"):
        assert screen.commands["drive"]({"object": [10.0, 10.0, 11.0]})["refused"] is None
        before = screen.commands["guide"]({"system": guide})["state"]
        after = screen.commands["move"]({"right": 5.0, "up": 3.0})["state"]
        moved = np.subtract(after["places"], before["places"])
        still = {"UPPER": "LOWER", "LOWER": "UPPER"}.get(guide)
        stages = screen.scene["models"][before["model"]]["stages"]
        for side in (0, 1):
            expected = [0.0, 0.0] if stages[side] == still else [5.0, -3.0]
            tolerance = {"OBJECT": 0.6, "BOTH": 1.5}.get(guide, 1e-6)
            assert moved[side] == pytest.approx(expected, abs=tolerance), guide
        if guide == "OBJECT":
            assert after["mark"][2] == pytest.approx(before["mark"][2], abs=1e-9)
        if guide in ("OBJECT", "MODEL"):
            assert abs(after["y_pixels"]) < 1e-6
            nearer = screen.commands["move"]({"higher": 4.0})["state"]
            parallax = [np.subtract(*one["places"])[0] for one in (after, nearer)]
            # the left photo's place goes right and the right one's left where a point comes nearer
            assert parallax[1] - parallax[0] == pytest.approx(4.0, abs=0.05 if guide == "OBJECT" else 1e-6)
            assert nearer["mark"][2] > after["mark"][2]
        else:
            assert "choose OBJECT or MODEL" in screen.commands["move"]({"higher": 1.0})["refused"]
    assert abs(screen.state()["y_pixels"]) > 1.0


def test_a_model_that_does_not_show_the_mark_is_begun_in_its_middle(project: Path, adjusted: Adjusted) -> None:
    _, screen = stereo_of(project)
    start = screen.commands["drive"]({"object": [-20.0, 0.0, 10.0]})["state"]
    assert (start["model"], start["condition"]) == (0, "IN")
    there = screen.commands["model"]({"name": "M3"})["state"]
    assert (there["model"], there["condition"]) == (2, "IN")
    names = screen.scene["models"][2]["photos"]
    assert all(adjusted.strip.shows(int(name[1]), np.array(there["mark"]))[0] for name in names)
    again = screen.commands["model"]({"name": "M2"})["state"]
    assert again["mark"] == pytest.approx(there["mark"], abs=1e-6) or again["condition"] == "IN"
    assert screen.commands["next"]({})["state"]["model"] == 2


def test_lines_and_areas_are_closed_go_on_and_are_undone(project: Path) -> None:
    _, screen = stereo_of(project)
    do = screen.commands
    places = {"LINE": [(20, 10), (22, 12), (25, 12)], "AREA": [(30, 20), (35, 20), (35, 24)]}
    for kind, plan in places.items():
        for number, (x, y) in enumerate(plan):
            do["drive"]({"object": [x, y, height(x, y)]})
            do["record"]({"kind": kind, "code": "K", "name": kind})
            if number == 0:
                with pytest.raises(Exception, match="1 of at least"):
                    do["close"]({})
                with pytest.raises(Exception, match="measure the others, or undo"):
                    do["record"]({"kind": "POINT", "code": "T", "name": "1"})
        assert do["close"]({})["state"]["open"] is None
    do["record"]({"kind": "POINT", "code": "T", "name": "1"})
    for again in ({"kind": "POINT", "code": "t", "name": "1"}, {"kind": "LINE", "code": "K", "name": "LINE"}):
        with pytest.raises(Exception, match=r"is in STEREO\.STE already"):
            do["record"](again)
    assert do["undo"]({})["said"] == "taken back: vertex 1 of POINT T 1"
    assert do["undo"]({})["said"] == "taken back: vertex 3 of AREA K AREA"
    _, screen = stereo_of(project)  # ended meanwhile: the area goes on
    assert screen.state()["open"] == "AREA K AREA, vertex 2 of at least 3"
    with pytest.raises(Exception, match="nothing that was measured in this run"):
        screen.commands["undo"]({})
    screen.commands["record"]({"kind": "AREA", "code": "K", "name": "AREA"})
    assert [one["left"] and one["name"] for one in screen.commands["drawn"]({})["features"]] == ["AREA", "LINE"]
    found = orip(project, "restitute", "compute", STEREO_FILE)
    assert found.code == 0, found.err
    text = (project / "hills.GEO").read_text()
    assert "LINE K LINE" in text
    assert "AREA K AREA" in text


def test_what_others_write_meanwhile_stays_and_what_cannot_be_is_refused(project: Path) -> None:
    path = project / STEREO_FILE
    with served_stereo(project) as server:
        asked(server.url, "record", {"kind": "POINT", "code": "T", "name": "1"})
        with path.open("a", encoding="utf-8") as file:
            file.write("! by hand\nPOINT H 1\n  P0 300 200 P1 120 200")
        asked(server.url, "record", {"kind": "POINT", "code": "T", "name": "2"})
        text = path.read_text()
        assert text.index("T 1") < text.index("! by hand") < text.index("T 2")
        before = path.read_bytes()
        for faulty in (
            {"kind": "ROAD", "code": "T", "name": "3"}, {"kind": "POINT", "code": "a b", "name": "3"},
            {"kind": "POINT", "code": "T", "name": ""}, {"kind": "POINT", "code": "T"}, {},
            {"kind": "POINT", "code": "!", "name": "3"}, {"kind": ["POINT"], "code": "T", "name": "3"},
        ):  # fmt: skip
            assert asked(server.url, "record", faulty)[0] == 400
        for command, wrong in {
            "move": {"right": "1"}, "drive": {"object": [1, 2]}, "plate": {"photo": "P9", "x": 1, "y": 1},
            "guide": {"system": "X"}, "automatic": {"on": 1}, "model": {},
        }.items():  # fmt: skip
            assert asked(server.url, command, wrong)[0] == 400
        assert asked(server.url, "drive", {"object": [1e6, 0, 0]})[1]["refused"]
        assert asked(server.url, "model", {"name": "NONE"})[1]["refused"]
        for wrong in ("0/2/0/0/0", "9/0/0/0/0", "0/0/9/0/0", "0/0/0/7/0", "0/0/0/0", "0/0/0/0/-1"):
            assert asked(server.url, f"pictures/{wrong}")[0] == 404
        path.write_text("POINT T\n", encoding="utf-8")
        status, said = asked(server.url, "record", {"kind": "POINT", "code": "T", "name": "4"})
        assert status == 400
        assert "STEREO.STE:1" in said["error"]
        assert path.read_text() == "POINT T\n"
        assert asked(f"http://{server.host}:{server.port}/guess/", "record", {})[0] == 403
    assert before.count(b"POINT") == 3


def test_an_image_that_vanishes_is_one_message_and_strangers_are_refused(project: Path) -> None:
    image, wanted = project / "images" / "P1.png", {"kind": "POINT", "code": "T", "name": "1"}
    with served_stereo(project) as server:
        assert asked(server.url, "pictures/0/1/0/0/0")[0] == 200
        there = image.read_bytes()
        image.unlink()
        try:
            status, said = asked(server.url, "pictures/0/1/0/0/0")
        finally:
            image.write_bytes(there)
        assert status == 404
        assert "P1.png" in said["error"]
        assert "not there any more" in said["error"]
        assert asked(server.url, "pictures/0/1/0/0/0")[0] == 200
        for header in ({"Origin": "http://example.org"}, {"Host": "example.org"}):
            assert asked(server.url, "record", wanted, **header)[0] == 403
    assert not (project / STEREO_FILE).exists()


def test_what_was_acknowledged_is_in_the_file_whenever_the_program_is_killed(project: Path) -> None:
    command = [sys.executable, "-m", "orip", "-C", str(project), "screen", "--stereo", "--no-open"]
    for killed_after in (5, 12):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            assert process.stdout is not None
            url = process.stdout.readline().strip()
            said, timer = [], threading.Timer(0.02, process.kill)
            with suppress(OSError, HTTPException):
                for number in range(1000):
                    if number == killed_after:
                        timer.start()
                    name = f"{killed_after}-{number}"
                    status, reply = asked(url, "record", {"kind": "POINT", "code": "T", "name": name})
                    assert (status, reply["said"]) == (200, f"recorded POINT T {name}")
                    said.append(name)
            timer.join()
        finally:
            process.kill()
            process.communicate()
        there = read_stereo(project / STEREO_FILE, STEREO_FILE)
        assert not there.complaints
        names = [one.name for one in there.value if one.name.startswith(f"{killed_after}-")]
        assert len(said) >= killed_after
        assert names[: len(said)] == said
        assert len(names) <= len(said) + 1


def test_a_block_without_models_is_seen_in_pairs_of_neighbours(tmp_path: Path, adjusted: Adjusted) -> None:
    folder = write_strip(tmp_path / "single", adjusted.strip, models=False)
    assert orip(folder, "run", "--no-report").code == 0
    processor, screen = stereo_of(folder)
    assert [one["photos"] for one in screen.scene["models"]] == [(left, right) for _, left, right, *_ in MODELS]
    assert [one.code for one in processor.warnings] == ["pairs-of-photos"]
    assert screen.commands["drive"]({"object": [30.0, 20.0, 12.0]})["refused"] is None
    assert screen.state()["condition"] == "IN"


def test_scanned_film_gives_the_same_places(tmp_path: Path, project: Path, adjusted: Adjusted) -> None:
    """Measured in millimetres in the fiducial system, from scans whose pixels count from their middles."""
    film = write_strip(tmp_path / "film", adjusted.strip, is_film=True)
    assert orip(film, "run", "--no-report").code == 0
    found = []
    for folder in (project, film):
        _, screen = stereo_of(folder)
        for number, xyz in enumerate(ground_points(adjusted.strip, 12, np.random.default_rng(9))):
            said = screen.commands["drive"]({"object": xyz.tolist()})
            assert said["refused"] is None
            names = screen.scene["models"][said["state"]["model"]]["photos"]
            for name in names:
                x, y = adjusted.strip.pixels(int(name[1]), xyz)[0].tolist()
                state = screen.commands["plate"]({"photo": name, "x": x, "y": y})["state"]
                assert state["pixels"][names.index(name)] == pytest.approx((x, y), abs=1e-9)
            screen.commands["record"]({"kind": "POINT", "code": "G", "name": f"{number}"})
        assert orip(folder, "restitute", "compute", STEREO_FILE).code == 0
        rows = [line.split() for line in (folder / "hills.GEO").read_text().splitlines() if line.startswith("  ")]
        found.append(np.array([[float(word) for word in row[:3]] for row in rows]))
    largest = max(abs(float(word)) for word in (film / STEREO_FILE).read_text().split() if word.count(".") == 1)
    assert largest < COLUMNS * PIXEL / 2.0
    assert np.abs(found[0] - found[1]).max() < 6e-3  # what is recorded of film has 0.1 µm, here 0.005 px


def test_the_strip_is_what_it_is_said_to_be(adjusted: Adjusted) -> None:
    """Points of the surface come back from their pixels, which stand in the photo where the conventions say."""
    strip, xyz = adjusted.strip, ground_points(adjusted.strip, 20, np.random.default_rng(2))
    for photo in range(PHOTOS):
        shown = xyz[strip.shows(photo, xyz)]
        at = strip.pixels(photo, shown)
        assert np.abs(strip.surface(photo, at) - shown).max() < 1e-6
        assert ((at > 0) & (at < (COLUMNS, ROWS))).all()
    assert C / PIXEL == 500.0
