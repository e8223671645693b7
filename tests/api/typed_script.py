"""A script of a user, for the type checker alone: `make check` runs mypy --strict on it.

Lines that say `type: ignore` are mistakes that it must find: one that it does not find is an error, too.
"""

from __future__ import annotations

import numpy as np

import orip

camera = orip.Camera("C35", c=35.0, unknown=["C"])
photos = orip.Photos(["1", "2"], "C35", orientation=np.zeros((2, 6)))
points = orip.PhotoPoints(["1", "2"], ["a", "a"], [[0.0, 0.0], [1.0, 0.0]])
block = orip.Block([camera], photos, points, datum="free")
solution = block.adjust(snoop=True, alpha=0.01)
solution = orip.open_project("cliff").solve("MAIN", prune=True)
value: float = solution.cameras["C35"]["C"] + float(solution.points["a"].covariance[0, 0])
names: list[str] = [name.upper() for name, photo in solution.photos.items() if photo.orientation[2] > 100.0]
joint = solution.covariance(["a", "photo 1"]) @ np.ones(9)
try:
    solution.save()
except orip.InputError as error:
    messages = [f"{complaint.path}: {complaint.message}" for complaint in error.complaints]

orip.Camera("C35", c="35")  # type: ignore[arg-type]
orip.open_projct("cliff")  # type: ignore[attr-defined]
block.adjust(sigma0="estimated")  # type: ignore[arg-type]
solution.to_dataframe("point")  # type: ignore[arg-type]
sigma = solution.sigma  # type: ignore[attr-defined]
