"""What is said of cameras, angles and photos beside stations names the mistake and its mend; see `camera_advice`."""

from __future__ import annotations

import pytest
from mistakes.camera_advice import MISTAKES, followed
from support.long_cases import every

from orip.errors import ProjectWarning
from orip.solving.consequences import follows, groups_that_follow

CASES = [
    ("C an old calibration", "STA"), ("C far off, free", ""),
    ("principal point: both signs", "STA"), ("sensor of another camera", "STA"),
    ("roll, pitch and heading", "STA with angles"), ("kappa turned by 90", "STA with angles"),
    ("angles in gon", "STA with angles"), ("measurements of two photos exchanged", "ELE"),
    ("omega and phi exchanged", "STA with angles"),
]  # fmt: skip


@pytest.mark.parametrize(("mistake", "ending"), every(2, CASES))
def test_the_advice_names_the_mistake_and_mends_the_block(mistake: str, ending: str) -> None:
    assert ending in MISTAKES[mistake].endings
    found, score = followed(mistake, ending)
    assert score == 3, found.first
    assert found.is_well, found.after


def test_a_photo_that_is_elsewhere_follows_from_its_own_position_alone() -> None:
    wrong = ProjectWarning("contradicting-position", "exposure station P6", "its position contradicts the block; check")
    own, other = (
        ProjectWarning("given-orientation", f"photo {name}", "its position is wrong") for name in ("P6", "P7")
    )
    assert follows(own, wrong)
    assert not follows(other, wrong)
    assert not follows(wrong, wrong)


def test_groups_of_stations_follow_from_a_camera() -> None:
    wrong = ProjectWarning("principal-point-sign", "camera C", "fits with the opposite sign of x; reverse it")
    assert "exposure station" in groups_that_follow([wrong])
    assert "distance" not in groups_that_follow([wrong])
