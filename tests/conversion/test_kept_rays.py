"""Measurements that a project has several times."""

from __future__ import annotations

import numpy as np
import pytest
from conversion.exchanged_blocks import block

from orip.exchange.project.block import ExchangeSettings, imported_block
from orip.exchange.project.texts import ImportSource, imported_texts
from orip.records.exchanged import ExchangedProject, ExchangedRays, PoseReading
from orip.structs import replace

GIVEN = block(PoseReading("y_up", "to_ground", "matrix", "radian", "centre"))


def texts_of(project: ExchangedProject) -> tuple[dict[str, str], tuple[str, ...]]:
    found = imported_texts(imported_block(project, "P", ExchangeSettings()), ImportSource("csv", "P", "P"), None)
    return found.texts, found.notes


def with_rows(rows: np.ndarray, moved: float = 0.0) -> ExchangedProject:
    """Return the block with some of its rays once more, in other columns."""
    rays = GIVEN.rays
    image = np.concatenate([rays.image, rays.image[rows] + [moved, 0.0]])
    places = [np.concatenate([of, of[rows]]) for of in (rays.photo, rays.point, rays.deviation, rays.is_active)]
    return replace(GIVEN, rays=ExchangedRays(places[0], places[1], image, places[2], places[3]))


@pytest.mark.parametrize(("moved", "said"), [(0.5, ""), (0.0, ", 3 of them with the same coordinates")])
def test_points_that_are_measured_again_count_with_all_their_rays(moved: float, said: str) -> None:
    texts, notes = texts_of(GIVEN)
    assert not any("shows already" in note for note in notes)
    assert 'repeated_points = "replace"' in texts["orip.toml"]
    found, notes = texts_of(with_rows(np.array([3, 70, 71]), moved))
    measured = [sum(line.startswith("  ") for line in of["MAIN.MEA"].splitlines()) for of in (texts, found)]
    assert measured[1] == measured[0] + 3
    assert 'repeated_points = "both"' in found["orip.toml"]
    assert f"3 rays of a point that its photo shows already{said}: all of them count." in notes
