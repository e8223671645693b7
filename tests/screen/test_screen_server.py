"""The server of `orip screen`: tiles, measurements on the disk before they are answered, control, misfits."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

Images = pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")

from cli.command_line import orip  # noqa: E402  # after what it needs
from screen.rendered_project import NEW, Rendered, asked, served  # noqa: E402

from orip.cli.terminal import Terminal  # noqa: E402
from orip.errors import UsageError  # noqa: E402
from orip.screen.command import shown_first  # noqa: E402
from orip.screen.plates import plates_of  # noqa: E402
from orip.workflow.project.state import read_project  # noqa: E402


def test_the_tiles_are_the_image(project: Path, rendered: Rendered) -> None:
    with served(project) as server:
        _, scene = asked(server.url, "scene")
        assert [one["levels"] for one in scene["photos"]] == [1, 1, 1]
        assert scene["control"] == [f"C{number}" for number in (0, 1, 2, 3, 4, 5, 7, 8, 9)]
        for _ in range(2):  # made, and as kept
            status, tile = asked(server.url, "pictures/1/0/0/0")
            shown = np.asarray(Images.open(BytesIO(tile)).convert("L"), dtype=float)
            assert status == 200
            assert np.abs(shown - rendered.plane.photos[1]).mean() < 2.0
        for wrong in ("3/0/0/0", "0/9/0/0", "0/0/7/0", "0/0/0", "../orip.toml", "0/0/0/-1", "0/0/0/%2e"):
            assert asked(server.url, f"pictures/{wrong}")[0] == 404


def test_a_measurement_is_in_the_file_before_it_is_answered_and_is_undone(project: Path, rendered: Rendered) -> None:
    with served(project) as server:
        x, y = rendered.pixel(0, NEW["C7"])
        status, said = asked(server.url, "measure", {"photo": "P0", "point": "C7", "x": x, "y": y})
        assert (status, said["photo"], said["point"]) == (200, "P0", "C7")
        assert f"C7 {x:18.4f} {y:11.4f}".split() == (project / "EDITS.MEA").read_text().split()[-3:]
        assert f"{x:.4f}" in (project / "EDITS.MEA").read_text()
        assert said["state"] in ("included", "unchecked")
        status, said = asked(server.url, "undo", {})
        assert said["state"] == "removed"
        assert "KILL POINT MAIN P0 C7" in (project / "EDITS.MEA").read_text()


def test_one_click_marks_a_control_point_in_all_photos(project: Path, rendered: Rendered) -> None:
    with served(project) as server:
        off, standardised = [], []
        for name, part in NEW.items():
            _, said = asked(server.url, "views", {"point": name})
            assert {view["photo"] for view in said["views"]} == {"P0", "P1", "P2"}
            for view in said["views"]:
                truth = rendered.pixel(int(view["photo"][1]), part)
                assert np.hypot(*np.subtract(view["expected"], truth)) < 0.5
                assert 0.0 < view["ellipse"][0] < 1.0
            x, y = rendered.pixel(0, part)
            asked(server.url, "measure", {"photo": "P0", "point": name, "x": x, "y": y})
            _, said = asked(server.url, "propose", {"photo": "P0", "point": name, "x": x, "y": y})
            assert [one["reason"] for one in said["proposals"]] == ["", ""]
            for one in said["proposals"]:
                truth = rendered.pixel(int(one["photo"][1]), part)
                away = np.subtract((one["x"], one["y"]), truth)
                off.append(away)
                standardised.append(away / one["error"])
                asked(server.url, "measure", {**one, "point": name})
            _, said = asked(server.url, "views", {"point": name})
            assert all(np.hypot(*view["residual"]) < 0.3 for view in said["views"])
            assert np.abs(said["control"]).max() < 0.3
        assert np.sqrt(np.mean(np.square(off))) < 0.1
        assert np.sqrt(np.mean(np.square(standardised))) < 3.0


def test_what_does_not_fit_is_listed_and_a_ray_passes_through_the_point(project: Path, rendered: Rendered) -> None:
    with served(project) as server:
        x, y = rendered.pixel(1, (0.44, 0.49))
        _, said = asked(server.url, "measure", {"photo": "P1", "point": "T6", "x": x + 30.0, "y": y})
        _, found = asked(server.url, "misfits", {})
        assert [one["observation"] for one in found["suspects"]] == ["T6 in P1"]
        asked(server.url, "exclude", {"photo": "P1", "point": "T6"})
        assert "DISREGARD POINT MAIN P1 T6" in (project / "EDITS.MEA").read_text()
        x, y = rendered.pixel(0, (0.44, 0.49))
        _, said = asked(server.url, "ray", {"photo": "P0", "point": "T6", "x": x, "y": y})
        line = np.array(said["lines"]["P2"])
        truth = np.array(rendered.pixel(2, (0.44, 0.49)))
        along = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
        away = truth - line[0]
        assert abs(along[0] * away[1] - along[1] * away[0]) < 0.3


def test_what_strangers_ask_is_refused(project: Path) -> None:
    before = {path: path.read_bytes() for path in project.glob("*.MEA")}
    wanted = {"photo": "P0", "point": "C7", "x": 10.0, "y": 10.0}
    with served(project) as server:
        base = f"http://{server.host}:{server.port}/"
        refused = [
            asked(base, "measure", wanted),
            asked(f"{base}guess/", "pictures/0/0/0/0"),
            asked(server.url, "measure", wanted, Origin="http://example.org"),
            asked(server.url, "measure", wanted, Host="example.org"),
            asked(server.url, "pictures/0/0/0/0", Origin="http://example.org"),
        ]
        assert {status for status, _ in refused} == {403}
        assert asked(server.url, "measure", wanted, **{"Content-Type": "text/plain"})[0] == 415
        for faulty in (
            {**wanted, "photo": "<b>P0</b>"}, {**wanted, "x": "1"}, {**wanted, "x": 1e9}, {"point": "C7"}, [],
            {**wanted, "y": None},
        ):  # fmt: skip
            assert asked(server.url, "measure", faulty)[0] == 400
        for name in ("a b", "", None, 7, "-", "x" * 5000):
            status, said = asked(server.url, "measure", {**wanted, "point": name})
            assert status == 413 or "error" in said
        assert {path: path.read_bytes() for path in project.glob("*.MEA")} == before


def test_an_image_that_vanishes_is_one_message(project: Path) -> None:
    with served(project) as server:
        (project / "images" / "P1.png").unlink()
        status, said = asked(server.url, "pictures/1/0/0/0")
        assert status == 404
        assert "not there any more" in said["error"]
        assert "P1.png" in said["error"]


def test_run_and_status_name_the_command_that_shows_the_worst_misfit(
    project: Path, rendered: Rendered, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = orip(project, "run", "--no-report")
    assert "orip screen" not in said.out
    x, y = rendered.pixel(1, (0.44, 0.49))
    with (project / "plane.MEA").open("a") as file:
        file.write(f"POINTS MAIN P1\n  T6 {x + 30.0:.4f} {y:.4f}\n")
    said = orip(project, "run", "--no-report")
    assert "look     orip screen --at P1/T6 shows the worst misfit in its picture" in said.out
    assert "does not fit" in said.out
    # where a screen is open, its page does; the address is for whoever reads the terminal, and not for a file
    monkeypatch.setattr("orip.workflow.open_screen.open_screen", lambda _: "http://127.0.0.1:9/t/")
    assert "look     the open orip screen shows the worst misfit, T6 in P1" in orip(project, "solve").out
    monkeypatch.setattr(Terminal, "is_terminal", True)
    assert "look     http://127.0.0.1:9/t/#photo=P1&point=T6 shows the worst misfit" in orip(project, "solve").out
    status = orip(project, "status").out
    assert ("orip screen shows where" in status) == ("doubtful" in status)


def test_the_report_is_served_and_leads_to_the_images(project: Path, rendered: Rendered) -> None:
    x, y = rendered.pixel(1, (0.44, 0.49))
    with served(project) as server:
        status, page = asked(server.url, "report")
        assert status == 200
        assert b"bundle MAIN has not been adjusted yet; run &#x27;orip solve&#x27; first" in page
        with (project / "plane.MEA").open("a") as file:
            file.write(f"POINTS MAIN P1\n  T6 {x + 30.0:.4f} {y:.4f}\n")
        orip(project, "run")
        page = asked(server.url, "report")[1].decode()
        assert '<a href="./#photo=P1&amp;point=T6">photo P1 point T6</a>' in page
        assert '<a href="./#point=C3">control point C3</a>' in page
        assert '<a href="./#photo=P2"><svg' in page
        assert "This is the last adjustment, which" not in page
        assert asked(server.url, "report")[1].decode() == page
        asked(server.url, "measure", {"photo": "P1", "point": "T6", "x": x, "y": y})
        assert (
            "out of date (changed since: EDITS.MEA): orip run makes the next."
            in asked(server.url, "report")[1].decode()
        )
        assert asked(server.url.replace(server.token, "x" * 22), "report")[0] == 403
    on_disk = (project / "report.html").read_text()
    assert 'href="./' not in on_disk
    assert "<code>orip screen --at P1/T6</code>" in on_disk


def test_what_is_shown_first_is_behind_the_address(project: Path) -> None:
    plates = plates_of(read_project(project, "definitions"), None)
    assert shown_first("P1/T6", plates) == "photo=P1&point=T6"
    assert shown_first("p1/<b>&#/", plates) == "photo=P1&point=%3Cb%3E%26%23%2F"
    assert shown_first("/T6", plates) == "point=T6"
    assert shown_first("a/b/c", {"a/b": plates["P1"]}) == "photo=a%2Fb&point=c"
    for wrong in ("P9/T6", "T6", "", "/", "P1/"):
        with pytest.raises(UsageError, match="such as P0/12"):
            shown_first(wrong, plates)
