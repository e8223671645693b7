"""Models for projects without any, and where the plates have to be driven to: what was measured, plus the residuals."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orip.records.results.solution import Solution

ZURICH_MODELS = [
    ("A", "st1", "st2", 1, 1),
    ("B", "st4", "st5", 1, 2),
    ("C", "st7", "st8", 1, 3),
    ("D", "st15", "st16", 2, 1),
]


def models_text(models):
    return "".join(
        f'\n[[bundle.model]]\nname = "{name}"\nleft = "{left}"\nright = "{right}"\nrow = {row}\ncolumn = {column}\n'
        for name, left, right, row, column in models
    )


def add_models(folder, models):
    with (folder / "orip.toml").open("a", encoding="utf-8") as file:
        file.write(models_text(models))
    return folder


def measured(path: Path) -> dict[tuple[str, str], np.ndarray]:
    """Return what a log has as it was read off the instrument, by photo and point."""
    found, photo = {}, None
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.split("!")[0].split()
        if words and words[0] in ("TEMPLATE", "PHOTO", "POINTS"):
            photo = words[2] if words[0] == "POINTS" else None
        elif words and photo is not None:
            found[photo, words[0]] = np.array([float(words[1]), float(words[2])])
    return found


def residuals_of(solution: Solution) -> dict[tuple[str, str], np.ndarray]:
    """Return the residuals of photo points, mm in the photo."""
    found: dict[tuple[str, str], list[float]] = {}
    rows = solution.residuals
    for kind, photo, point, residual in zip(rows.kind, rows.photo, rows.point, rows.residual, strict=True):
        if kind == "photo":
            found.setdefault((photo, point), []).append(float(residual))
    return {key: np.array(array) for key, array in found.items()}


def expected_positions(solution, table, log):
    """Return measured plate coordinates plus residuals, taken to the plate by the factors of the table alone."""
    residuals = residuals_of(solution)
    factors = {photo.name: np.array(photo.affine).reshape(2, 3)[:, 1:] for photo in table.photos}
    return {
        (photo, point): xy + factors[photo.upper()] @ residuals[photo, point]
        for (photo, point), xy in log.items()
        if photo.upper() in factors and (photo, point) in residuals
    }
