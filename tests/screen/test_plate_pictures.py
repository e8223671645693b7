"""The images of photos on the plates that `orip drive watch` shows: at the mark they show what was driven to."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

Images = pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")

from cli.command_line import orip  # noqa: E402  # after what it needs
from link.served import loaded_station, served  # noqa: E402
from screen.rendered_project import asked  # noqa: E402
from screen.stereo_project import Adjusted, adjusted_strip  # noqa: E402
from support.rendered_surface import ground_points, write_strip  # noqa: E402

from orip.multimodel.link.watch import Watch  # noqa: E402
from orip.multimodel.project_link import open_watch  # noqa: E402
from orip.web.page_server import WatchServer  # noqa: E402


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Adjusted:
    return adjusted_strip(tmp_path_factory.mktemp("plates") / "project")


@contextmanager
def watched(watch: Watch) -> Iterator[str]:
    with WatchServer(watch, pictures=watch.picture) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server.url
        finally:
            server.shutdown()
            thread.join()
            watch.close()


def pixels_at_the_mark(watch: Watch, state: dict) -> dict[str, np.ndarray]:
    """Return by photo the columns and rows of its image that are at the mark."""
    model = next(one for one in watch.scene["models"] if one["name"] == state["model"])
    found = {}
    for stage, plate in watch.scene["plates"].items():
        for photo in (one["name"] for one in plate["photos"] if one["name"] in model["photos"]):
            a, b, c, d, e, f = watch.scene["pictures"]["photos"][photo]["to_plate"]
            found[photo] = np.linalg.solve([[a, c], [b, d]], np.array(state["plates"][stage]) - [e, f])
    return found


@pytest.mark.parametrize("is_film", [False, True])
def test_the_pictures_show_what_was_driven_to(tmp_path: Path, adjusted: Adjusted, is_film: bool) -> None:
    """Off by what the adjustment leaves, some tenths of a pixel; of film with scans, too, and of the emulator."""
    folder = adjusted.folder
    if is_film:
        folder = write_strip(tmp_path / "film", adjusted.strip, is_film=True)
        assert orip(folder, "run", "--no-report").code == 0
    station = loaded_station((folder / "MAIN.DRV").read_bytes())
    with served(station) as port:
        for link in (None, f"tcp://127.0.0.1:{port}"):
            watch, off = open_watch(folder, None, link), []
            try:
                for xyz in ground_points(adjusted.strip, 12, np.random.default_rng(4)):
                    state = watch.drive({"object": xyz.tolist()})["state"]
                    for photo, pixel in pixels_at_the_mark(watch, state).items():
                        off.append(pixel - adjusted.strip.pixels(int(photo[1]), xyz)[0])
            finally:
                watch.close()
            assert len(off) == 24
            assert np.abs(off).max() < 1.0


def test_the_pictures_are_served(adjusted: Adjusted) -> None:
    with watched(open_watch(adjusted.folder, None, None)) as url:
        pictures = asked(url, "scene")[1]["pictures"]["photos"]
        assert set(pictures) == {"P0", "P1", "P2", "P3"}
        number = pictures["P2"]["number"]
        tile = np.asarray(Images.open(BytesIO(asked(url, f"pictures/{number}/0/0/0")[1])).convert("L"), dtype=float)
        assert np.abs(tile - adjusted.strip.photos[2]).mean() < 2.0
        for wrong in ("9/0/0/0", "0/9/0/0", "0/0/0", "../orip.toml", "0/0/0/-1"):
            assert asked(url, f"pictures/{wrong}")[0] == 404


def test_a_project_without_images_is_watched_as_before(tmp_path: Path) -> None:
    assert orip(tmp_path, "init", "--sample", "small_frame_block", "cliff").code == 0
    assert orip(tmp_path / "cliff", "run", "--no-report").code == 0
    with watched(open_watch(tmp_path / "cliff", None, None)) as url:
        assert asked(url, "scene")[1]["pictures"]["photos"] == {}
        assert asked(url, "pictures/0/0/0/0")[0] == 404
    assert not (tmp_path / "cliff" / ".orip-tiles").exists()
