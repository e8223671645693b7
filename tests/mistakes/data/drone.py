"""The drone sample freed of what is wrong in it, and edits of its stations, control and measurements."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mistakes.edits import SAMPLES
from scipy.spatial.transform import Rotation
from workflow.small_projects import replace_in

DRONE = SAMPLES / "drone_rtk"
COLUMNS, ROWS, PIXEL_MM = 5472, 3648, 13.2 / 5472

Line = list[str]


def truth() -> dict[str, Any]:
    """Return what the block was simulated from."""
    found: dict[str, Any] = json.loads((DRONE / "truth.json").read_text(encoding="utf-8"))
    return found


def drone(folder: Path) -> Path:
    """Write the project of the drone without its shifted strip and its bad fix."""
    folder.mkdir()
    for name in ("orip.toml", "DRONE.MEA", "DRONE.PNT", "DRONE.STA"):
        shutil.copy(DRONE / name, folder)
    known = truth()
    strip, shift = known["shifted strip"]["strip"], np.array(known["shifted strip"]["east north up"])
    photo, fix = known["bad fix"]["photo"], np.array(known["bad fix"]["east north up"])

    def mended(words: Line) -> Line:
        off = shift * (known["strips"][words[0]] == strip) + fix * (words[0] == photo)
        return moved(words, -off)

    in_lines(folder / "DRONE.STA", mended)
    return folder


def calibrated_drone(folder: Path) -> Path:
    """Write the same project with a camera that is known: in a self-calibration it takes up what stations are off."""
    drone(folder)
    c = truth()["camera"]
    distortion = f"distortion = {{ A3 = {c['A3']}, A5 = {c['A5']} }}"
    known = f"c = {c['C']}\nprincipal_point = [{c['DX']}, {c['DY']}]\n{distortion}\n"
    replace_in(folder / "orip.toml", "c = 8.8\n", known)
    replace_in(folder / "orip.toml", 'unknown = ["C", "DX", "DY", "A3", "A5"]\n', "")
    return folder


def in_lines(path: Path, rule: Callable[[Line], Line]) -> None:
    """Change the lines of a file, word by word; comments stay."""
    lines = path.read_text(encoding="utf-8").splitlines()
    changed = [line if not line.strip() or line.startswith("!") else "  ".join(rule(line.split())) for line in lines]
    path.write_text("\n".join(changed) + "\n", encoding="utf-8")


def moved(words: Line, by: np.ndarray) -> Line:
    """Return the words of a line with name, X, Y, Z and more, moved."""
    places = (np.array(words[1:4], dtype=np.float64) + by).tolist()
    return [words[0], *(f"{value:.4f}" for value in places), *words[4:]]


def in_measurements(folder: Path, rule: Callable[[str, str, float, float], tuple[str, float, float]]) -> None:
    """Change what was measured: from photo, point, column and row to point, column and row."""
    photo, lines = "", []
    path = folder / "DRONE.MEA"
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if words[0] == "POINTS":
            photo = words[2]
            lines.append(line)
        else:
            point, column, row = rule(photo, words[0], float(words[1]), float(words[2]))
            lines.append(f"{point:4s} {column:9.2f} {row:9.2f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def image(photo: str, place: np.ndarray) -> np.ndarray:
    """Return the pixel (2,) where a photo shows a place on the map grid, without distortion."""
    known = truth()
    values = np.array(known["photos"][photo])
    u = Rotation.from_euler("XYZ", values[3:], degrees=True).as_matrix().T @ (place - values[:3])
    x, y = -known["camera"]["C"] * u[:2] / u[2]
    return np.array([x / PIXEL_MM + COLUMNS / 2, ROWS / 2 - y / PIXEL_MM])
