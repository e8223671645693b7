"""The Olympus C4040Z of the camera calibration data sets, in the words of orip and in those of the reports.

The reports have the y axis up, the origin at the lower left corner, pixels counted from the outer corner of the upper
left one, and Brown's terms with the opposite sign.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from reference.published_data import Published, records

COLUMNS, ROWS, HEIGHT = 2272, 1704, 5.43764
PIXEL = HEIGHT / ROWS
"""mm; the reports' pixels are square before the affinity."""

UNKNOWN = ("C", "DX", "DY", "A3", "A5", "A7", "P1", "P2", "B1")

PRECISION = 'measurement_precision = "0.1px"'

_BROWN = {"K1": "A3", "K2": "A5", "K3": "A7", "P1": "P1", "P2": "P2", "as": "B1"}


def camera_text(c: float, *, distortion_at: str = "measured", unknown: tuple[str, ...] = UNKNOWN) -> str:
    """Return the camera's table of orip.toml, without distortion to begin with."""
    names = ", ".join(f'"{name}"' for name in unknown)
    return (
        f'[[camera]]\nname = "CAM"\nc = {c}\ndistortion_at = "{distortion_at}"\nunknown = [{names}]\n'
        f"sensor = {{ columns = {COLUMNS}, rows = {ROWS}, width = {COLUMNS * PIXEL!r}, height = {HEIGHT} }}"
    )


def as_reported(result: Any) -> dict[str, Published]:
    """Return the unknown camera parameters of a result in the names and signs of the reports."""
    camera = result["cameras"]["CAM"]
    found = {
        "C": (camera["C"]["value"], camera["C"]["sd"]),
        "px": (camera["DX"]["value"] + COLUMNS / 2 * PIXEL, camera["DX"]["sd"]),
        "py": (ROWS / 2 * PIXEL - camera["DY"]["value"], camera["DY"]["sd"]),
        **{name: (-camera[kind]["value"], camera[kind]["sd"]) for name, kind in _BROWN.items()},
    }
    return {name: Published(value, sd) for name, (value, sd) in found.items() if sd is not None}


def distortion_correlations(result: Any) -> dict[tuple[str, str], float]:
    """Return the correlations of K1, K2 and K3 beyond 0.95, by both orders of their names."""
    names = {f"CAM.{_BROWN[name]}": name for name in ("K1", "K2", "K3")}
    found = {}
    for row in result["correlations"]:
        if {row["a"], row["b"]} <= names.keys() and abs(row["r"]) > 0.95:
            a, b = names[row["a"]], names[row["b"]]
            found[a, b] = found[b, a] = row["r"]
    return found


def constant_control(path: Path) -> dict[str, tuple[float, ...]]:
    """Return control points of a file ``id,label,X,Y,Z`` as constants."""
    return {name: (*map(float, xyz), 0.0, 0.0, 0.0) for name, _, *xyz in records(path)}
