"""Which of orip's camera parameters stand for those that another program has estimated."""

from __future__ import annotations

from orip.records.exchanged import ExchangedCamera
from orip.records.project.camera import CAMERA_PARAMETERS

_RADIAL = ("A3", "A5", "A7")
_HIGH_RADIAL = ("k4", "k5", "k6", "c4", "c5")
"""Radial terms beyond those of most lenses; with any of them A9 is estimated, too."""

_CROSSED = ("opencv", "equidistant", "fisheye624")
"""Lenses with OpenCV's order of p1 and p2."""

_SAME = {
    "f": ("C",), "fx": ("C",), "fy": ("C",), "cx": ("DX",), "cy": ("DY",),
    "k1": ("A3",), "c1": ("A3",), "a1": ("A3",),
    "k2": ("A5",), "c2": ("A5",), "a2": ("A5",),
    "k3": ("A7",), "c3": ("A7",), "a3": ("A7",),
    "k4": ("A9",), "c4": ("A9",),
    "omega": _RADIAL, "alpha": _RADIAL, "beta": (),
    "p1": ("P1",), "p2": ("P2",), "b1": ("B1",), "b2": ("B2",),
}  # fmt: skip


def unknown_parameters(camera: ExchangedCamera, *, is_exact: bool) -> tuple[str, ...]:
    """Return the parameters that the adjustment should estimate, as the other program has.

    Where orip's polynomial is fitted, all of its radial terms stand for any radial one of the other program.
    """
    found: set[str] = set()
    for name in camera.free:
        if not is_exact and name[0] in "kca" and name[1:].isdigit():
            found.update((*_RADIAL, "A9") if name in _HIGH_RADIAL else _RADIAL)
        elif camera.lens in _CROSSED and name in {"p1", "p2"}:
            found.add("P2" if name == "p1" else "P1")
        else:
            found.update(_SAME.get(name, ()))
    if {"fx", "fy"} <= set(camera.free) and camera.parameters.get("fx") != camera.parameters.get("fy"):
        found.add("B1")
    return tuple(name for name in CAMERA_PARAMETERS if name in found)
