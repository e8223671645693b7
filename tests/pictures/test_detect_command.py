"""`orip detect`: from pictures of a printed board to a calibrated camera, what is said, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli.command_line import orip
from pictures.rendered import Camera, looking_at, photograph_of

from orip.pictures.targets.boards import Board

CAMERA = Camera()
BOARD = Board("charuco", 9, 6, 24.0, 18.0, "5X5_100")
VIEWS = ((0, 0, 0), (30, 5, 90), (-30, 10, 180), (5, 32, 270), (10, -30, 45))
DESCRIBED = ("--kind", "charuco", "--size", "9x6", "--square", "24", "--tag", "18")


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    for number, angles in enumerate(VIEWS, start=1):
        grey = photograph_of(BOARD, CAMERA, looking_at(BOARD, angles, 300.0), seed=number)
        cv2.imwrite(str(folder / f"V{number}.png"), grey)
    return folder


@pytest.fixture
def project(tmp_path: Path) -> Path:
    write_project(tmp_path, photos=5)
    return tmp_path


def write_project(folder: Path, photos: int, unit: str = "mm") -> None:
    columns, rows, pixel = CAMERA.columns, CAMERA.rows, CAMERA.pixel
    sensor = f"{{ columns = {columns}, rows = {rows}, width = {columns * pixel}, height = {rows * pixel} }}"
    text = f"""project = {{ name = "BOARD", ground_unit = "{unit}" }}
[[camera]]
name = "CAM"
c = 4.8
sensor = {sensor}
unknown = ["C", "DX", "DY", "A3", "A5", "P1", "P2"]
[[bundle]]
name = "MAIN"
"""
    text += "".join(f'[[photo]]\nname = "V{number}"\ncamera = "CAM"\n' for number in range(1, photos + 1))
    (folder / "orip.toml").write_text(text, encoding="utf-8")


def detect(folder: Path, *words: str) -> tuple[int, str]:
    done = orip(folder, "detect", *words)
    return done.code, done.err


def test_a_camera_is_calibrated_with_a_printed_board(project: Path, pictures: Path) -> None:
    code, said = detect(project, "board", str(pictures), *DESCRIBED)
    assert code == 0, said
    assert "marks in 5 of 5 photos written to DETECTED.MEA" in said
    assert (project / "BOARD.PNT").read_text(encoding="utf-8").count("R1C1 ") == 1
    assert orip(project, "run").code == 0
    result = json.loads((project / "result.json").read_text(encoding="utf-8"))
    assert result["status"] == "converged"
    camera = result["cameras"]["CAM"]
    true = {"C": CAMERA.c, "DX": 0.0, "DY": 0.0, "A3": 2e-3, "P1": 5e-5, "P2": -4e-5}
    for name, value in true.items():
        assert abs(camera[name]["value"] - value) < 4.0 * camera[name]["sd"], name
    assert camera["C"]["sd"] < 0.002


def test_without_pictures_those_that_the_photos_name_are_measured(project: Path, pictures: Path) -> None:
    path = project / "orip.toml"
    text = path.read_text(encoding="utf-8")
    picture = pictures / "V1.png"
    path.write_text(text.replace('name = "V1"\n', f'name = "V1"\nimage = "{picture.as_posix()}"\n'), encoding="utf-8")
    code, said = detect(project, "board", *DESCRIBED)
    assert code == 0, said
    assert "marks in 1 of 1 photos written to DETECTED.MEA" in said


def test_a_second_run_replaces_its_own_file_and_leaves_control_alone(project: Path, pictures: Path) -> None:
    arguments = ("board", str(pictures / "V1.png"), *DESCRIBED)
    assert detect(project, *arguments)[0] == 0
    files = [project / name for name in ("DETECTED.MEA", "BOARD.PNT")]
    before = [path.read_bytes() for path in files]
    assert detect(project, *arguments)[0] == 0
    assert [path.read_bytes() for path in files] == before


def test_distances_give_the_size_in_the_ground_unit(tmp_path: Path, pictures: Path) -> None:
    write_project(tmp_path, photos=1, unit="m")
    code, said = detect(tmp_path, "board", str(pictures / "V1.png"), *DESCRIBED, "--control", "distances")
    assert code == 0, said
    lines = (tmp_path / "BOARD.LEN").read_text(encoding="utf-8").splitlines()
    lengths = [float(line.split()[4]) for line in lines if not line.startswith("!")]
    assert lengths[0] == pytest.approx(0.024 * np.hypot(7, 4))
    assert len(lengths) == 3
    assert not (tmp_path / "BOARD.PNT").exists()


def test_a_dry_run_writes_nothing_and_a_document_says_all(project: Path, pictures: Path) -> None:
    done = orip(project, "--json", "detect", "board", str(pictures), *DESCRIBED, "--dry-run")
    document = done.document
    assert [photo["photo"] for photo in document["photos"]] == [f"V{number}" for number in range(1, 6)]
    assert document["dry_run"] is True
    assert [path.name for path in project.iterdir()] == ["orip.toml"]


def test_every_wrong_picture_is_named_and_the_others_are_used(project: Path, pictures: Path, tmp_path: Path) -> None:
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    (mixed / "V1.png").write_bytes((pictures / "V1.png").read_bytes())
    (mixed / "V2.png").write_bytes((pictures / "V2.png").read_bytes()[:3000])
    cv2.imwrite(str(mixed / "V3.png"), np.full((CAMERA.columns, CAMERA.rows), 128, dtype=np.uint8))
    cv2.imwrite(str(mixed / "V4.png"), np.full((CAMERA.rows, CAMERA.columns), 128, dtype=np.uint8))
    (mixed / "V5.jpg").write_bytes(b"")
    code, said = detect(project, "board", str(mixed), *DESCRIBED)
    assert code == 0, said
    assert "V3: has 680 x 900 pixels, but camera CAM has 900 x 680" in said
    assert "V4: no board was found" in said
    assert "marks in 1 of 5 photos" in said
    assert said.count("V2: ") == said.count("V5: ") == 1


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("board", "missing.png"), "no photo of the project is called missing"),
        (("board",), "name the pictures"),
        (("board", "x.png", "--size", "9"), "--size 9"),
        (("board", "x.png", "--kind", "round"), "charuco, chess, circles, tags"),
        (("tags", "x.png", "--dictionary", "7X8"), "APRILTAG_36H11"),
        (("sheet", "NONE.PNT", "x.png", "--rings", "1"), "NONE.PNT"),
        (("board", "V1.png", "--output", "MARKS.TXT"), "measurement_files"),
    ],
)
def test_wrong_words_are_refused_with_what_is_allowed(project: Path, words: tuple[str, ...], expected: str) -> None:
    code, said = detect(project, *words)
    assert code in {2, 3}
    assert expected in said
    assert "Traceback" not in said


def test_a_measurement_file_of_other_origin_stays(project: Path, pictures: Path) -> None:
    (project / "DETECTED.MEA").write_text("POINTS MAIN V1\n  7 1.0 2.0\n", encoding="utf-8")
    arguments = ("board", str(pictures / "V1.png"), *DESCRIBED)
    code, said = detect(project, *arguments)
    assert code == 3
    assert "--replace" in said
    assert detect(project, *arguments, "--replace")[0] == 0


def test_a_board_is_drawn_without_a_project_and_nothing_is_overwritten(tmp_path: Path) -> None:
    for name, begins in (("BOARD.svg", b"<svg"), ("BOARD.pdf", b"%PDF")):
        assert detect(tmp_path, "board", *DESCRIBED, "--print", name)[0] == 0
        assert (tmp_path / name).read_bytes().startswith(begins)
        code, said = detect(tmp_path, "board", *DESCRIBED, "--print", name)
        assert code == 2
        assert "--force" in said
    assert detect(tmp_path, "board", *DESCRIBED, "--print", "BOARD.doc")[0] == 2
