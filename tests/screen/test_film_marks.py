"""Fiducial and tick marks on `orip screen`: their orientation at once, and what the log has of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")

from cli.command_line import orip  # after what it needs
from screen.film_project import FIDUCIALS, make_film, pixel, tick_pixel
from screen.rendered_project import asked, served


def measure(url: str, name: str, place: tuple[float, float], what: str = "MARK", photo: str = "F1") -> dict:
    _, said = asked(url, "mark", {"do": "measure", "photo": photo, "what": what, "name": name, "x": place[0],
                                  "y": place[1]})  # fmt: skip
    return said


def marks(url: str, photo: str = "F1") -> dict[str, dict]:
    _, said = asked(url, "marks", {"photo": photo})
    return {group["what"]: group for group in said["groups"]}


def of_log(folder: Path) -> list[list[str]]:
    lines = (folder / "EDITS.MEA").read_text().splitlines()
    return [line.split() for line in lines if line and not line.startswith("!")]


def test_marks_orient_a_photo_and_are_in_the_log_before_they_are_answered(tmp_path: Path) -> None:
    with served(make_film(tmp_path)) as server:
        assert marks(server.url)["MARK"]["text"] == "photo F1 has 0 marks: measure 3 more marks to orient it"
        for count, name in enumerate(("1", "2", "3", "4"), start=1):
            x, y = pixel(FIDUCIALS[name])
            said = measure(server.url, name, (x + (4.0 if name == "4" else 0.0), y))
            assert said["state"] == ("included" if count >= 3 else "waiting")
            block = of_log(tmp_path)
            assert block[0] == ["PHOTO", "F1", "A"]
            assert [line[0] for line in block[1:]] == ["1", "2", "3", "4"][:count]
            # where the next one is to be looked for, by two marks and more
            if count in (2, 3):
                for one in marks(server.url)["MARK"]["marks"]:
                    assert one["expected"] == pytest.approx(pixel(FIDUCIALS[one["name"]]), abs=0.01)
        found = marks(server.url)["MARK"]
        columns_rows = np.array([one["measured"] for one in found["marks"]])
        equations, given = np.column_stack([columns_rows, np.ones(4)]), np.array(list(FIDUCIALS.values()))
        residuals = equations @ np.linalg.lstsq(equations, given)[0] - given
        assert np.abs(residuals).max() > 0.02
        assert np.array([one["residual"] for one in found["marks"]]) == pytest.approx(residuals, abs=1e-9)
        s0 = np.sqrt(np.sum(residuals**2) / (8 - 6))
        assert f"by 4 marks, s0 {1000.0 * s0:.1f} µm" in found["text"]
        measure(server.url, "4", pixel(FIDUCIALS["4"]))
        assert [line[0] for line in of_log(tmp_path)] == ["PHOTO", "1", "2", "3", "4"]
        assert all(np.hypot(*one["residual"]) < 1e-5 for one in marks(server.url)["MARK"]["marks"])
        _, said = asked(server.url, "measure", {"photo": "F1", "point": "P", "x": 100.0, "y": 120.0})
        assert said["state"] == "waiting", said
    assert orip(tmp_path, "measure").code == 0
    listing = (tmp_path / "INTERIOR_RESULT.OUT").read_text()
    assert all(any(line.split()[:1] == [name] for line in listing.splitlines()) for name in FIDUCIALS)


def test_measurements_of_marks_are_undone(tmp_path: Path) -> None:
    with served(make_film(tmp_path)) as server:
        for name in ("1", "2", "3", "4"):
            measure(server.url, name, pixel(FIDUCIALS[name]))
        x, y = pixel(FIDUCIALS["2"])
        measure(server.url, "2", (x + 9.0, y))
        asked(server.url, "undo", {})
        found = {one["name"]: one for one in marks(server.url)["MARK"]["marks"]}
        assert found["2"]["measured"] == pytest.approx((x, y), abs=1e-4)
        for left in (["1", "2", "3"], ["1", "2"], ["1"], []):
            asked(server.url, "undo", {})
            found = marks(server.url)["MARK"]
            assert [one["name"] for one in found["marks"] if one["measured"]] == left
        assert of_log(tmp_path)[-1] == ["KILL", "MARK", "F1", "1"]
        for name in ("1", "2", "3"):
            said = measure(server.url, name, pixel(FIDUCIALS[name]))
        assert said["state"] == "included"
    assert orip(tmp_path, "measure").code == 0


def test_marks_that_points_need_stay(tmp_path: Path) -> None:
    with served(make_film(tmp_path)) as server:
        for name in ("1", "2", "3", "4"):
            measure(server.url, name, pixel(FIDUCIALS[name]))
        asked(server.url, "measure", {"photo": "F1", "point": "P", "x": 100.0, "y": 120.0})
        one = {"photo": "F1", "what": "MARK"}
        _, said = asked(server.url, "mark", {**one, "do": "exclude", "name": "4"})
        assert said["state"] == "excluded"
        for do in ("exclude", "remove"):
            _, said = asked(server.url, "mark", {**one, "do": do, "name": "3"})
            assert "would have too few marks" in said["error"]
        _, said = asked(server.url, "mark", {**one, "do": "include", "name": "4"})
        assert said["state"] == "included"
        _, said = asked(server.url, "mark", {**one, "do": "remove", "name": "4"})
        assert said["state"] == "removed"
        # points that are measured after a mark was measured again are where the log, replayed, has them
        x, y = pixel(FIDUCIALS["4"])
        measure(server.url, "4", (x + 2.0, y))
        asked(server.url, "measure", {"photo": "F1", "point": "Q", "x": 200.0, "y": 140.0})
        measure(server.url, "4", (x, y))
        asked(server.url, "measure", {"photo": "F1", "point": "R", "x": 160.0, "y": 150.0})
        _, before = asked(server.url, "points", {"photos": [0]})
    with served(tmp_path) as server:
        _, after = asked(server.url, "points", {"photos": [0]})
        assert before == after
        found = {row[0]: row[1:3] for row in after["photos"]["F1"]["points"]}
        assert found["R"] == [160.0, 150.0]
        # Q stays on the film: its place is that of the orientation in which it was measured
        assert 0.1 < np.hypot(*np.subtract(found["Q"], [200.0, 140.0])) < 2.0


def test_tick_marks_come_first_on_a_template(tmp_path: Path) -> None:
    with served(make_film(tmp_path, on_template=True)) as server:
        assert set(marks(server.url)) == {"TICK"}
        said = measure(server.url, "1", (50.0, 50.0))
        assert "measure its tick marks first" in said["error"]
        assert not (tmp_path / "EDITS.MEA").exists()
        for name in ("A", "B", "C", "D"):
            said = measure(server.url, name, tick_pixel(name), "TICK")
        assert said["state"] == "included", said
        for name in ("1", "2", "3", "4"):
            said = measure(server.url, name, pixel(FIDUCIALS[name]))
        assert said["state"] == "included", said
        assert [line[:3] for line in of_log(tmp_path) if len(line) == 3 and line[0].isalpha() and len(line[0]) > 1] == [
            ["TEMPLATE", "T1", "A"], ["PHOTO", "F1", "A"],
        ]  # fmt: skip
    assert orip(tmp_path, "measure").code == 0


def test_what_is_no_mark_is_refused(tmp_path: Path) -> None:
    with served(make_film(tmp_path)) as server:
        right = {"do": "measure", "photo": "F1", "what": "MARK", "name": "1", "x": 10.0, "y": 10.0}
        for wrong in ({"name": "9"}, {"name": "*"}, {"name": ""}, {"what": "TICK"}, {"what": "POINT"}, {"do": "kill"},
                      {"x": -1.0}, {"x": "1"}, {"photo": "F9"}, {"do": "remove"}):  # fmt: skip
            assert "error" in asked(server.url, "mark", {**right, **wrong})[1], wrong
    assert not (tmp_path / "EDITS.MEA").exists()
