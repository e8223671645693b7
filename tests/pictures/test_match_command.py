"""`orip match`, on rendered photos: what it writes, what it keeps, and what it says of bad images."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from numpy.typing import NDArray
from pictures.rendered_plane import RenderedPlane, project_text, render

from orip.pictures import tie_points
from orip.pictures.matching.features import Features
from orip.pictures.matching_cache import CACHE_FOLDER

Images = pytest.importorskip("PIL.Image")
pytest.importorskip("cv2")
pytest.importorskip("pycolmap")

SIDE = 330
TOML = project_text(SIDE, "1px", 'datum = "free"\n')


@pytest.fixture(scope="module")
def plane() -> RenderedPlane:
    return render(4, SIDE, np.random.default_rng(7), noise=4.0)


@pytest.fixture(scope="module")
def matched(plane: RenderedPlane, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose photos are matched."""
    folder = project(tmp_path_factory.mktemp("plane"), plane.photos)
    said = orip(folder, "match", "--points", "60")
    assert said.code == 0, said.told
    return folder


def project(folder: Path, photos: list[NDArray[np.uint8]]) -> Path:
    names = [f"P{number}" for number in range(len(photos))]
    text = TOML + "".join(f'\n[[photo]]\nname = "{name}"\ncamera = "C"\n' for name in names)
    (folder / "orip.toml").write_text(text, encoding="utf-8")
    for name, grey in zip(names, photos, strict=True):
        Images.fromarray(grey).save(folder / f"{name}.png")
    return folder


def measured(folder: Path) -> dict[str, dict[str, list[float]]]:
    """Return x, y and errors by point and photo."""
    found: dict[str, dict[str, list[float]]] = {}
    photo = ""
    for line in (folder / "TIES.MEA").read_text(encoding="utf-8").splitlines():
        if line.startswith("POINTS"):
            photo = line.split()[2]
        elif not line.startswith("!"):
            name, *values = line.replace("px", "").split()
            found.setdefault(name, {})[photo] = [float(value) for value in values]
    return found


def test_the_rays_are_where_the_points_are(matched: Path, plane: RenderedPlane) -> None:
    root, standardised, freedom = against_truth(matched, plane)
    assert freedom > 100
    assert root < 0.07
    assert standardised == pytest.approx(1.0, abs=0.25)  # 1.03 to 1.07 in several scenes


def against_truth(folder: Path, plane: RenderedPlane) -> tuple[float, float, int]:
    """Return root mean squares of errors (pixels), and of standardised errors, and their degrees of freedom.

    A point may be anywhere on the plane: it is where its rays fit best.
    """
    errors, standardised, freedom = [], [], 0
    for rays in measured(folder).values():
        numbers = [int(photo[1:]) for photo in rays]
        places = np.array([values[:2] for values in rays.values()])
        sds = np.array([values[2:] for values in rays.values()])
        there = np.mean([plane_place(plane, n, xy) for n, xy in zip(numbers, places, strict=True)], axis=0)
        shapes = np.array([plane.partials(n, there) for n in numbers])
        off = np.array([xy - plane.pixels(n, there[None])[0] for n, xy in zip(numbers, places, strict=True)])
        design, right = (shapes / sds[:, :, None]).reshape(-1, 2), (off / sds).ravel()
        left = right - design @ np.linalg.lstsq(design, right, rcond=None)[0]
        standardised.append(left)
        errors.append(left * sds.ravel())
        freedom += off.size - 2
    root, ratio = (np.sqrt(np.sum(np.concatenate(parts) ** 2) / freedom) for parts in (errors, standardised))
    return float(root), float(ratio), freedom


def plane_place(plane: RenderedPlane, photo: int, place: NDArray[np.float64]) -> NDArray[np.float64]:
    found = np.linalg.inv(plane.homographies[photo]) @ [*place, 1.0]
    return found[:2] / found[2]


def test_the_file_is_read_as_any_other(matched: Path) -> None:
    assert orip(matched, "init").code == 0
    said = orip(matched, "measure", "--json")
    assert said.code == 0, said.told
    assert said.document["points"]["MAIN"] == sum(map(len, measured(matched).values()))


def test_again_the_file_is_the_same_from_what_was_kept(matched: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = (matched / "TIES.MEA").read_bytes()

    def never(*_: object) -> None:
        raise AssertionError

    for name in ("find_features", "match_features"):
        monkeypatch.setattr(f"orip.pictures.tie_points.{name}", never)
    said = orip(matched, "match", "--points", "60", "--json")
    assert said.code == 0, said.told
    assert (matched / "TIES.MEA").read_bytes() == before
    assert said.document["points"] == len(measured(matched))


def test_what_is_damaged_in_the_folder_of_what_was_kept_is_found_again(matched: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(matched, folder)
    kept = sorted((folder / CACHE_FOLDER).iterdir())
    assert len([path for path in kept if path.suffix == ".features"]) == 4
    kept[0].write_bytes(kept[0].read_bytes()[:-3])
    kept[1].write_bytes(kept[2].read_bytes())
    (folder / "TIES.MEA").unlink()
    assert orip(folder, "match", "--points", "60").code == 0
    assert (folder / "TIES.MEA").read_bytes() == (matched / "TIES.MEA").read_bytes()


def test_a_run_that_was_interrupted_goes_on(matched: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for source in (*matched.glob("*.png"), matched / "orip.toml"):
        shutil.copy(source, tmp_path)
    found: list[object] = []
    real = tie_points.match_features

    def once(*features: Features) -> NDArray[np.intp]:
        found.append(features)
        if len(found) == 4:  # of the second photo
            raise KeyboardInterrupt
        return real(*features)

    monkeypatch.setattr(tie_points, "match_features", once)
    assert orip(tmp_path, "match", "--points", "60", "--threads", "1").code != 0
    assert not (tmp_path / "TIES.MEA").exists()
    monkeypatch.delattr(tie_points, "find_features")  # all photos have their features
    assert orip(tmp_path, "match", "--points", "60", "--threads", "1").code == 0
    # neither threads nor what was kept change the file
    assert len(found) == 4 + 3  # six pairs, of which the three of the first photo were kept
    assert (tmp_path / "TIES.MEA").read_bytes() == (matched / "TIES.MEA").read_bytes()


@pytest.mark.long
def test_twenty_photos(tmp_path: Path) -> None:
    plane = render(20, SIDE, np.random.default_rng(11), noise=3.0)
    folder = project(tmp_path, plane.photos)
    assert orip(folder, "match", "--points", "100").code == 0
    root, standardised, freedom = against_truth(folder, plane)
    assert freedom > 2000
    assert root < 0.05
    assert standardised == pytest.approx(1.0, abs=0.15)


def test_features_as_they_are(matched: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(matched, folder)
    assert orip(folder, "match", "--features", "--points", "60").code == 0
    assert measured(folder)
    assert (folder / "TIES.MEA").read_bytes() != (matched / "TIES.MEA").read_bytes()


def test_another_file_of_that_name_stays(plane: RenderedPlane, tmp_path: Path) -> None:
    folder = project(tmp_path, plane.photos[:2])
    (folder / "TIES.MEA").write_text("POINTS MAIN P0\n  1 2.0 3.0\n", encoding="utf-8")
    said = orip(folder, "match")
    assert said.code == 2
    assert "--force" in said.err


def damaged(path: Path) -> str:
    path.write_bytes(path.read_bytes()[:2000])
    return "cut off|damaged"


def empty(path: Path) -> str:
    path.write_bytes(b"")
    return "empty"


def folder_of_that_name(path: Path) -> str:
    path.unlink()
    path.mkdir()
    return "directory|folder|no regular file"


def of_other_size(path: Path) -> str:
    Images.new("L", (300, 200)).save(path)
    return r"300 x 200 pixels, the sensor of its camera 330 x 330"


def of_one_pixel(path: Path) -> str:
    Images.new("L", (1, 1)).save(path)
    return "1 x 1"


def huge(path: Path) -> str:
    data = bytearray(path.read_bytes())
    data[16:24] = (100_000).to_bytes(4, "big") * 2
    path.write_bytes(bytes(data))
    return "megapixels"


def flat(path: Path) -> str:
    Images.new("L", (SIDE, SIDE), 90).save(path)
    return "no other photo shows the same"


def same(path: Path) -> str:
    shutil.copy(path.with_name("P0.png"), path)
    return "the same file as that of photo P0"


@pytest.mark.parametrize("spoil", [damaged, empty, folder_of_that_name, of_other_size, of_one_pixel, huge, flat, same])
def test_a_bad_image_is_named_and_the_others_are_matched(spoil, matched: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(matched, folder)
    said_of_it = spoil(folder / "P3.png")
    said = orip(folder, "match", "--features", "--points", "60")
    assert said.code == 0, said.told
    assert re.search(f"P3.*({said_of_it})", said.err), said.err
    assert {photo for rays in measured(folder).values() for photo in rays} == {"P0", "P1", "P2"}


def test_nothing_to_match(plane: RenderedPlane, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    noise = [rng.integers(0, 255, (SIDE, SIDE)).astype(np.uint8) for _ in range(2)]
    cases = {
        "only one photo has an image": plane.photos[:1],
        "no photo has features": [np.full((SIDE, SIDE), 90 + number, dtype=np.uint8) for number in range(2)],
        "no two photos show the same": noise,
        "only one photo": [plane.photos[0]] * 3,
    }
    for number, (words, photos) in enumerate(cases.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        said = orip(project(folder, photos), "match")
        assert said.code == 3, said.told
        assert words in said.err
        assert not (folder / "TIES.MEA").exists()


def test_photos_of_two_objects_are_two_parts_and_none_is_lost(plane: RenderedPlane, tmp_path: Path) -> None:
    others = render(4, SIDE, np.random.default_rng(8), noise=4.0).photos
    said = orip(project(tmp_path, [*plane.photos, *others]), "match", "--points", "60")
    assert said.code == 0, said.told
    assert "the photos fall into 2 parts" in said.err
    rays = [list(found) for found in measured(tmp_path).values()]
    assert {photo for found in rays for photo in found} == {f"P{number}" for number in range(8)}
    assert all(len({int(photo[1:]) < 4 for photo in found}) == 1 for found in rays)


def test_images_that_the_project_names(matched: Path, tmp_path: Path) -> None:
    for source in (*matched.glob("*.png"), matched / "orip.toml"):
        shutil.copy(source, tmp_path)
    (tmp_path / "P1.png").rename(tmp_path / "second of all.png")
    text = (tmp_path / "orip.toml").read_text(encoding="utf-8")
    named = text.replace('name = "P1"\n', 'name = "P1"\nimage = "second of all.png"\n')
    (tmp_path / "orip.toml").write_text(named, encoding="utf-8")
    assert orip(tmp_path, "match", "--features", "--points", "60").code == 0
    assert {photo for rays in measured(tmp_path).values() for photo in rays} == {"P0", "P1", "P2", "P3"}


def test_photos_measured_in_millimetres_are_refused(plane: RenderedPlane, tmp_path: Path) -> None:
    folder = project(tmp_path, plane.photos[:2])
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    (folder / "orip.toml").write_text(re.sub("sensor = .*\n", "", text).replace('"1px"', "0.01"), encoding="utf-8")
    said = orip(folder, "match")
    assert said.code == 3
    assert "give its camera a sensor" in said.err
