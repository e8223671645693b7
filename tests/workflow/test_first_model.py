"""The first model of an on-line triangulation, as text: nothing is known but seven elements of exterior orientation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from bundle.blocks_without_control import first_model, off_truth
from workflow.quiet import run_quietly

from orip.records.photo import PHOTO_PARAMETERS

PROJECT = """
[project]
name = "MODEL"

[[camera]]
name = "CAM"
c = {c}
principal_point = [{dx}, {dy}]
frame = [230.0, 230.0]

[[photo]]
name = "P1"
camera = "CAM"

[[photo]]
name = "P2"
camera = "CAM"

[[bundle]]
name = "MAIN"
measurement_precision = {error}
"""


def test_seven_elements_in_ele_and_twelve_photo_points_make_the_first_model(tmp_path: Path) -> None:
    """31 observations, 30 unknowns, redundancy 1: the Simplon block of OLTRIS (Gruen 1991), section 5."""
    made, block = first_model()
    points, camera = block.photo_points, made.cameras[0]
    error = float(points.error.max())
    toml = PROJECT.format(c=camera[0], dx=camera[1], dy=camera[2], error=error)
    (tmp_path / "orip.toml").write_text(toml)
    lines = []
    for photo in (0, 1):
        lines.append(f"POINTS MAIN P{photo + 1}")
        for row in np.flatnonzero(points.photo == photo):
            x, y = points.xy[row]
            lines.append(f"  {block.point_names[points.point[row]]} {x:.5f} {y:.5f}")
    (tmp_path / "MODEL.MEA").write_text("\n".join(lines) + "\n")
    one, other = made.orientations[:2]
    elements = [
        *zip(("P1",) * 6, PHOTO_PARAMETERS, [*one[:3], *np.degrees(one[3:])], strict=True),
        ("P2", "X0", other[0]),
    ]
    (tmp_path / "MODEL.ELE").write_text(
        "".join(
            f"{photo} PHOTO {kind} {value:.5f} {0.05 if kind.endswith('0') else 0.005}\n"
            for photo, kind, value in elements
        )
    )
    (tmp_path / "MODEL.PNT").write_text("! nothing\n")
    (outcome,) = run_quietly(tmp_path)
    found = outcome.solution
    assert (found.observations, found.unknowns, found.redundancy) == (31, 30, 1)
    assert (found.status, found.singular) == ("converged", ())
    # five standard deviations: 18 coordinates exceed them by chance once in 100 000 blocks
    assert off_truth(made, found) < 5.0
