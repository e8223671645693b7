"""Tiles and grey values of images: kept in a folder with a limit, decoded once, of images that stay as they were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

Images = pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")

from screen.rendered_project import NEW, Rendered, asked, served  # noqa: E402  # after what it needs

from orip.images import TILE_FOLDER, tiles  # noqa: E402
from orip.images.tiles import (  # noqa: E402
    StoredImage,
    TileFolder,
    TileName,
    TileStore,
)
from orip.online.block.online_block import OnlineBlock  # noqa: E402


@pytest.fixture
def image(tmp_path: Path) -> StoredImage:
    grey = np.random.default_rng(3).integers(0, 255, (700, 900), dtype=np.uint8)
    Images.fromarray(grey).save(tmp_path / "a.png")
    return StoredImage(tmp_path / "a.png", "a.png", (900, 700))


def test_the_oldest_files_go_where_there_are_too_many(tmp_path: Path) -> None:
    folder, names = TileFolder(tmp_path, most=1000), [f"{n:024x}-0-0-0.jpg" for n in range(40)]
    (tmp_path / TILE_FOLDER / "notes.txt").write_bytes(b"x" * 90)
    for name in names:
        assert folder.write(name, b"x" * 90)
    there = {path.name for path in (tmp_path / TILE_FOLDER).iterdir()}
    assert sum(path.stat().st_size for path in (tmp_path / TILE_FOLDER).iterdir()) <= 1000
    assert names[-1] in there
    assert names[0] not in there
    assert "notes.txt" in there  # somebody else's
    TileFolder(tmp_path, most=300)
    assert len(list((tmp_path / TILE_FOLDER).glob("*.jpg"))) <= 2


def test_grey_values_of_a_part_are_those_of_the_image_which_is_decoded_once(
    tmp_path: Path, image: StoredImage, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded, read = [], tiles.read_eight_bits
    monkeypatch.setattr(tiles, "read_eight_bits", lambda *given: decoded.append(given) or read(*given))
    truth = np.asarray(Images.open(image.path))
    parts = [(slice(0, 320), slice(580, 900)), (slice(400, 700), slice(0, 12)), (slice(3, 4), slice(5, 6))]
    for rows, columns in parts:
        for store in (TileStore(tmp_path), TileStore(tmp_path)):
            assert np.array_equal(store.grey(image, rows, columns), truth[rows, columns])
    assert len(decoded) == 1


def test_where_nothing_can_be_kept_grey_values_stay_in_memory(
    tmp_path: Path, image: StoredImage, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / TILE_FOLDER).write_bytes(b"")  # a file has the folder's name
    decoded, read = [], tiles.read_eight_bits
    monkeypatch.setattr(tiles, "read_eight_bits", lambda *given: decoded.append(given) or read(*given))
    store = TileStore(tmp_path)
    for _ in range(3):
        assert store.grey(image, slice(0, 9), slice(0, 7)).shape == (9, 7)
    assert len(decoded) == 1
    assert store.tile(image, TileName(0, 1, 1))[:2] == b"\xff\xd8"


def test_an_image_of_another_size_is_refused_and_one_with_other_pixels_shown(project: Path, rendered: Rendered) -> None:
    x, y = rendered.pixel(0, NEW["C7"])
    wanted = {"photo": "P0", "point": "C7", "x": x, "y": y}
    with served(project) as server:
        before = asked(server.url, "pictures/0/0/0/0")[1]
        Images.fromarray(rendered.plane.photos[0][:, ::-1]).save(project / "images" / "P0.png")
        status, after = asked(server.url, "pictures/0/0/0/0")
        assert status == 200
        assert after != before
        # what was measured in the picture that was there before is no longer what is seen; then it is
        status, said = asked(server.url, "measure", wanted)
        assert status == 400
        assert "images/P0.png: the image has been replaced since it was shown" in said["error"]
        assert not (project / "EDITS.MEA").exists()
        assert asked(server.url, "measure", {**wanted, "point": "NEW"})[0] == 200
        log = (project / "EDITS.MEA").read_text()
        Images.fromarray(rendered.plane.photos[0][:300]).save(project / "images" / "P0.png")
        for command, content, faulty in (
            ("pictures/0/0/0/0", None, 404), ("measure", wanted, 400), ("propose", wanted, 400)
        ):  # fmt: skip
            status, said = asked(server.url, command, content)
            assert status == faulty
            assert "420 x 300 pixels now, and had 420 x 420" in said["error"]
        assert (project / "EDITS.MEA").read_text() == log
        x, y = rendered.pixel(1, NEW["C7"])
        _, said = asked(server.url, "propose", {**wanted, "photo": "P1", "x": x, "y": y})
        assert [one["photo"] for one in said["proposals"]] == ["P2"]
        assert "images/P0.png" in said["faults"][0]


def test_the_block_is_taken_to_its_solution_once_for_each_change(
    project: Path, rendered: Rendered, monkeypatch: pytest.MonkeyPatch
) -> None:
    count, solution = [], OnlineBlock.at_solution
    monkeypatch.setattr(OnlineBlock, "at_solution", lambda block: count.append(1) or solution(block))
    x, y = rendered.pixel(0, NEW["C7"])
    with served(project) as server:
        asked(server.url, "views", {"point": "C7"})
        count.clear()
        assert asked(server.url, "measure", {"photo": "P0", "point": "C7", "x": x, "y": y})[0] == 200
        for _ in range(3):
            for command in ("propose", "views", "ray"):
                asked(server.url, command, {"photo": "P0", "point": "C7", "x": x, "y": y})
        assert len(count) <= 2  # the answer may be told before the rest is reconsidered
        _, said = asked(server.url, "points", {"photos": [0, 2]})
        assert set(said["photos"]) == {"P0", "P2"}
        assert ["C7", round(x, 4), round(y, 4)] in [one[:3] for one in said["photos"]["P0"]["points"]]
        for wrong in (["P0"], [3], [-1], [True], None):
            assert asked(server.url, "points", {"photos": wrong})[0] == 400
