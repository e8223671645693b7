"""Marks by matching in three photos of a telephone, against the tracks of a published reconstruction.

The tracks were found at a third of the photos' resolution, each at the scale of its feature: what is between them and
the marks grows with that scale, and says nothing of the marks. OpenCV's alignment of patches (Evangelidis and Psarakis
2008) is the referee. It begins at the places of the tracks, and ends at the marks.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip
from exchange.imported import sample
from reference.published_data import data_set

cv2: Any = pytest.importorskip("cv2")
pytest.importorskip("PIL")

from orip.annexes import MEASURING_ONLINE, annex  # noqa: E402  # after what it needs
from orip.arrays import FloatArray  # noqa: E402
from orip.images.tiles import TileStore  # noqa: E402
from orip.screen.plates import plates_of  # noqa: E402
from orip.screen.proposals import propose  # noqa: E402
from orip.workflow.project.state import read_project  # noqa: E402

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]

CLICKED = "02"
HALF, AROUND = 14, 20
COLUMNS = 3264
"""Of the longer side of the photos, the unit of the file of tracks."""


def patch(grey: FloatArray, place: FloatArray, affine: FloatArray, half: int) -> FloatArray:
    """Return grey values around a place, in the geometry of the photo that was clicked."""
    steps = np.arange(-half, half + 1.0)
    columns, rows = affine @ np.stack(np.meshgrid(steps, steps)).reshape(2, -1) + (place - 0.5)[:, None]
    shape = (len(steps), len(steps))
    maps = [one.reshape(shape).astype(np.float32) for one in (columns, rows)]
    return np.asarray(cv2.remap(grey, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def aligned(clicked: FloatArray, other: FloatArray, begin: FloatArray, affine: FloatArray) -> FloatArray:
    """Return where another photo shows the middle of a patch; NaN where the alignment fails."""
    edge = AROUND - HALF
    warp = np.array([[1.0, 0.0, edge], [0.0, 1.0, edge]], dtype=np.float32)
    try:
        _, warp = cv2.findTransformECC(
            clicked, patch(other, begin, affine, AROUND), warp, cv2.MOTION_AFFINE, (3, 100, 1e-5), None, 1
        )
    except cv2.error:
        return np.full(2, np.nan)
    return begin + affine @ (warp @ [HALF, HALF, 1.0] - AROUND)


def scales_of_features(tracks: Path) -> dict[tuple[str, str], float]:
    """Return the scales of the features in a file of tracks by photo and track, pixels."""
    rows = (line.split("\t") for line in tracks.read_text().splitlines()[1:])
    return {(image.partition(".")[0], track): float(scale) * COLUMNS for image, track, _, _, _, scale, *_ in rows}


def test_marks_are_where_patches_align_more_closely_than_tracks_are(tmp_path: Path) -> None:
    images, folder, given = data_set("pictures") / "berlin", tmp_path / "berlin", tmp_path / "given"
    given.mkdir()
    shutil.copy(sample("opensfm", "berlin", "reconstruction_example.json"), given / "reconstruction.json")
    shutil.copy(sample("opensfm", "berlin", "tracks_example.csv"), given / "tracks.csv")
    for where, *words in ((tmp_path, "import", "given", "berlin"), (folder, "init"), (folder, "measure")):
        said = orip(where, *words)
        assert said.code == 0, said.err
    plates = plates_of(read_project(folder, "definitions"), images)
    session, store = annex(MEASURING_ONLINE).session_to_measure(folder, None), TileStore(folder)
    as_stored = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    grey = {photo: cv2.imread(str(images / f"{photo}.jpg"), as_stored).astype(np.float32) for photo in plates}
    points = session.points(plates)
    tracks = {
        photo: {name: np.array([x, y]) for name, x, y, _ in points[photo]["points"]} for photo in plates
    }  # fmt: skip
    in_all = set.intersection(*(set(of_photo) for of_photo in tracks.values()))
    scale = scales_of_features(given / "tracks.csv")
    away, off_referee, apart, stays, size, count = [], [], [], [], [], 0
    for name in sorted(in_all):
        place = tracks[CLICKED][name]
        clicked = patch(grey[CLICKED], place, np.eye(2), HALF)
        transfers = {one.photo: one for one in session.transferred(CLICKED, tuple(place), name)}
        proposals, _ = propose(store, plates, CLICKED, tuple(place), list(transfers.values()))
        count += len(proposals)
        for one in (one for one in proposals if not one.reason):
            affine, track = transfers[one.photo].affine, tracks[one.photo][name]
            ends = aligned(clicked, grey[one.photo], track, affine)
            away.append(one.place - track)
            off_referee.append(np.hypot(*(one.place - ends)))
            apart.append(np.hypot(*(track - ends)))
            stays.append(np.hypot(*(one.place - aligned(clicked, grey[one.photo], np.array(one.place), affine))))
            size.append(max(scale[photo, name.removeprefix("T")] for photo in (CLICKED, one.photo)))
    off_track = np.hypot(*np.transpose(away))
    assert len(off_track) > 300
    assert len(off_track) > 0.7 * count
    assert np.median(off_track) < 0.55
    assert np.nanmedian(off_referee) < 0.15 < 0.4 < np.nanmedian(apart)
    # from small features to large ones the tracks are off by the same part of the feature, and not to one side
    fifths = np.array_split(np.argsort(size), 5)
    medians = np.array([np.median(off_track[fifth]) for fifth in fifths])
    assert medians[0] < 0.3 < 0.8 < medians[-1]
    parts = medians / [np.median(np.array(size)[fifth]) for fifth in fifths]
    assert 0.04 < parts.min() < parts.max() < 0.12
    assert np.abs(np.median(away, axis=0)).max() < 0.06
    # where they are far from the tracks, alignment from there leads to the marks, or from the marks stays at them
    assert (off_track > 3.0).sum() <= 0.05 * count
    assert not ((off_track > 3.0) & ~(np.fmin(off_referee, stays) < 3.0)).any()
