"""The aerial block of the published data: five photos with their camera, marks and control as orip has them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from reference.published_data import records
from reference.published_projects import Mark

PIXEL = 0.006
COLUMNS, ROWS = 8858, 12996
PRINCIPAL_POINT = (26.5770, 38.8110)
"""mm to the right of and below the upper left corner."""

CHECK_POINTS = {"351", "410"}


def camera_text() -> str:
    dx = PRINCIPAL_POINT[0] - COLUMNS / 2 * PIXEL
    dy = ROWS / 2 * PIXEL - PRINCIPAL_POINT[1]
    return (
        f'[[camera]]\nname = "CAM"\nc = 123.9392\nprincipal_point = [{dx!r}, {dy!r}]\n'
        f"sensor = {{ columns = {COLUMNS}, rows = {ROWS}, width = {COLUMNS * PIXEL!r}, height = {ROWS * PIXEL!r} }}"
    )


def marks(folder: Path) -> Iterator[Mark]:
    """Yield manual marks with their own half pixel, then automatic ones with the bundle's pixel."""
    for point, photo, x, y in records(folder / "markpts.txt"):
        yield (photo, point, x, y, "0.5")
    for point, photo, x, y in records(folder / "smartpts.txt"):
        yield (photo, point, x, y)


def control(path: Path) -> dict[str, tuple[float, ...]]:
    """Return control with its a-priori errors; those of the check points are negative."""
    found = {}
    for name, _, *numbers in records(path):
        sign = -1.0 if name in CHECK_POINTS else 1.0
        found[name] = (*map(float, numbers[:3]), *(sign * float(error) for error in numbers[3:]))
    return found
