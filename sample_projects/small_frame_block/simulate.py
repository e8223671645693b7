"""Makes the measurements, the ground control and the truth of this sample project.

    python simulate.py [FOLDER]

What there is (camera, marks, templates, photos, models) is read from the orip.toml beside this program, where it is and
what chance does to it comes from scene.py. The same files come out every time.
"""

from __future__ import annotations

import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from scene import (
    CAMERA,
    FILM_SCALE,
    TARGETS,
    Array,
    Project,
    Truth,
    draw_truth,
    on_film,
    on_plate,
    on_sheet,
    photo_coordinates,
)

HERE = Path(__file__).parent
SEED = 1992

POINTING_MM = 0.002
MARK_POINTINGS = 4
"""So often the operator points to each tick and fiducial mark, and takes the mean."""
SURVEY_M = 0.02
"""Standard deviation of a surveyed coordinate and of a measured distance."""

FRAME_MM = (36.0, 24.0)
EDGE_MM = 0.8
"""The outermost part of a frame, in which no point is measured."""

PAIRS_TAKEN = 2
"""The operator takes all that are in three photos or more, and one in so many of those that are in two only."""
DISTANCES = {
    "T1": ("XYZ", (75.0, 8.0), (120.0, 8.0)), "T2": ("XYZ", (90.0, 80.0), (140.0, 80.0)),
    "T3": ("Z", (165.0, 20.0), (165.0, 82.0)),
}  # fmt: skip
"""Measured distances: code, and X and Z near which the tie points at both ends are."""
MOUNTINGS = {
    ("DAY1", "LEFT"): (3.1, -2.4, 0.6), ("DAY1", "RIGHT"): (-1.7, 4.2, -0.9), ("DAY2", "LEFT"): (-0.8, -5.3, 3.6),
}  # fmt: skip
"""Shift (mm) and turn (degrees) of a sheet on its stage."""

MISPOINTED_PHOTO, MISPOINTED_BY = "104", (0.045, -0.070)
"""One pointing in this photo is so far off, plate mm."""
MISNUMBERED_PHOTO = "203"
"""In this photo a point is measured under the name of its neighbour, which is not measured there."""

Images = Mapping[str, Mapping[str, Array]]
"""Photo coordinates (2,), mm, by photo and point."""


# ----------------------------------------------------------------------------- what the operator measures, and calls it


def images_in_models(project: Project, truth: Truth) -> Images:
    """Return the images of points that are well inside both photos of a model."""
    names, ground = list(truth.points), np.array(list(truth.points.values()))
    inside = {}
    for photo, orientation in truth.orientations.items():
        xy = photo_coordinates(orientation, ground)
        well = np.all(np.abs(xy) < np.array(FRAME_MM) / 2 - EDGE_MM, axis=1)
        inside[photo] = {names[row]: xy[row] for row in np.flatnonzero(well)}
    images: dict[str, dict[str, Array]] = {photo: {} for photo in inside}
    for model in project["bundle"][0]["model"]:
        for photo in (model["left"], model["right"]):
            images[photo].update({name: inside[photo][name] for name in in_both(inside, model)})
    return images


def count_rays(images: Images) -> Counter[str]:
    """Return the number of photos that each point is in."""
    return Counter(name for points in images.values() for name in points)


def in_both(images: Images, model: Mapping[str, Any]) -> list[str]:
    """Return the points that are in both photos of a model."""
    return [name for name in images[model["left"]] if name in images[model["right"]]]


def with_operators_names(project: Project, truth: Truth) -> Truth:
    """Take tie points and number them from model to model: 1203 is the third new one of model 1-2."""
    images = images_in_models(project, truth)
    rays = count_rays(images)
    names = {name: name for name in TARGETS}
    for model in project["bundle"][0]["model"]:
        unnamed = [name for name in in_both(images, model) if name not in names]
        pairs = [name for name in unnamed if rays[name] == 2]
        new = [name for name in unnamed if rays[name] > 2 or name in pairs[::PAIRS_TAKEN]]
        names.update({name: f"{model['row']}{model['column']}{number:02d}" for number, name in enumerate(new, 1)})
    return replace(truth, points={given: truth.points[name] for name, given in names.items()})


@dataclass(frozen=True)
class Blunders:
    """The point that is mispointed, and the one that a neighbour is measured for."""

    mispointed: str
    misnumbered: str
    measured_instead: str


def choose_blunders(images: Images) -> Blunders:
    """Choose tie points with so many rays that the others can tell which one is wrong."""
    rays = count_rays(images)

    def tie_points(photo: str, least: int) -> dict[str, Array]:
        return {name: xy for name, xy in images[photo].items() if rays[name] >= least and name not in TARGETS}

    there = tie_points(MISNUMBERED_PHOTO, 6)
    closest = min(permutations(there, 2), key=lambda pair: float(np.hypot(*(there[pair[0]] - there[pair[1]]))))
    middle = tie_points(MISPOINTED_PHOTO, 5)
    mispointed = min(middle.keys() - closest, key=lambda name: float(np.hypot(*middle[name])))
    return Blunders(mispointed, *closest)


def with_misnumbered_point(images: Images, blunders: Blunders) -> Images:
    """Return the images under the names that the operator gives them."""
    points = dict(images[MISNUMBERED_PHOTO])
    points[blunders.misnumbered] = points.pop(blunders.measured_instead)
    return {**images, MISNUMBERED_PHOTO: points}


# ------------------------------------------------------------------------------------------------------------- the logs


class Operator:
    """One who mounts and measures, and writes down what the plotter reads."""

    def __init__(self, random: np.random.RandomState, project: Project, truth: Truth) -> None:
        self.random, self.project, self.truth = random, project, truth
        self.template_of = {photo: template["name"] for template in project["template"] for photo in template["photos"]}
        self.mounting: dict[str, tuple[float, float, float]] = {}
        self.log: list[str] = []

    def mount(self, template: Mapping[str, Any], mounting: tuple[float, float, float]) -> None:
        """Lay a template on its stage and measure its tick marks."""
        self.mounting[template["name"]] = mounting
        title = f"TEMPLATE {template['name']} A {template['stage']}"
        self._write(title, self._plate(template["name"], marks(self.project["temtick"][0]["ticks"]), MARK_POINTINGS))

    def orient(self, photo: str) -> None:
        """Measure the fiducial marks of a photo."""
        fiducials = marks(self.project["camera"][0]["fiducials"])
        self._write(f"PHOTO {photo} A", self._photo(photo, fiducials, MARK_POINTINGS))

    def measure(self, photo: str, points: Mapping[str, Array], mispointed: str) -> None:
        """Measure points of a photo."""
        plate = self._photo(photo, points, 1)
        if photo == MISPOINTED_PHOTO and mispointed in plate:
            plate[mispointed] = plate[mispointed] + MISPOINTED_BY
        self._write(f"POINTS {self.project['bundle'][0]['name']} {photo}", plate)

    def _photo(self, photo: str, points: Mapping[str, Array], pointings: int) -> dict[str, Array]:
        place = self.truth.prints[photo]
        sheet = {name: on_sheet(place, xy) for name, xy in points.items()}
        return self._plate(self.template_of[photo], sheet, pointings)

    def _plate(self, template: str, points: Mapping[str, Array], pointings: int) -> dict[str, Array]:
        film = on_film(FILM_SCALE[template], self.truth.ripples[template], np.array(list(points.values())))
        plate = on_plate(self.mounting[template], film)
        error = POINTING_MM * self.random.normal(size=(pointings, *plate.shape))
        return dict(zip(points, plate + error.mean(axis=0), strict=True))

    def _write(self, title: str, plate: Mapping[str, Array]) -> None:
        self.log += ["", title, *(f"  {name:<5}{x:10.3f}{y:10.3f}" for name, (x, y) in plate.items())]


def marks(table: Iterable[Mapping[str, Any]]) -> dict[str, Array]:
    """Return given coordinates of fiducial or tick marks by name."""
    return {mark["name"]: np.array([mark["x"], mark["y"]]) for mark in table}


def first_day(operator: Operator, images: Images, blunders: Blunders) -> str:
    """Mount both templates, orient all photos, measure strip 1; return the log."""
    operator.log = ["! First day: both templates, the fiducial marks of all photos, the points of strip 1. Plate mm."]
    for template in operator.project["template"]:
        operator.mount(template, MOUNTINGS["DAY1", template["name"]])
    for photo in images:
        operator.orient(photo)
    measure_strip(operator, 1, images, blunders)
    return text(operator.log)


def second_day(operator: Operator, images: Images, blunders: Blunders) -> str:
    """Mount template LEFT again, measure strip 2; return the log."""
    operator.log = [
        "! Second day. Template LEFT had been off the stage over night; its tick marks are measured again, and that",
        "! is all: the photos on it keep their orientations. Then the points of strip 2.",
    ]
    operator.mount(operator.project["template"][0], MOUNTINGS["DAY2", "LEFT"])
    measure_strip(operator, 2, images, blunders)
    return text(operator.log)


def measure_strip(operator: Operator, row: int, images: Images, blunders: Blunders) -> None:
    """Measure model by model; in the left photo there is left to do what the model before did not have."""
    named = with_misnumbered_point(images, blunders)
    done: dict[str, set[str]] = {photo: set() for photo in images}
    for model in (model for model in operator.project["bundle"][0]["model"] if model["row"] == row):
        operator.log += ["", f"! Model {model['name']}"]
        for photo in (model["left"], model["right"]):
            todo = [name for name in in_both(images, model) if name in named[photo] and name not in done[photo]]
            done[photo].update(todo)
            operator.measure(photo, {name: named[photo][name] for name in sorted(todo)}, blunders.mispointed)


# ----------------------------------------------------------------------------------------------------- ground and truth


def control_points(random: np.random.RandomState, truth: Truth) -> str:
    """Return the text of the .PNT file: surveyed coordinates of the targets."""
    lines = ["! Surveyed targets, m; check points (CK) have negative a-priori errors.",
             "! name       X         Y         Z      aX     aY     aZ"]  # fmt: skip
    for name in TARGETS:
        X, Y, Z = truth.points[name] + SURVEY_M * random.normal(size=3)
        error = SURVEY_M if name.startswith("CP") else -SURVEY_M
        lines.append(f"  {name}{X:10.3f}{Y:10.3f}{Z:10.3f}" + f"{error:7.2f}" * 3)
    return text(lines)


def distances(random: np.random.RandomState, truth: Truth, images: Images) -> str:
    """Return the text of the .LEN file: distances between tie points with three rays or more."""
    rays = count_rays(images)
    ties = {name: at for name, at in truth.points.items() if name not in TARGETS and rays[name] >= 3}

    def nearest(place: tuple[float, float]) -> str:
        return min(ties, key=lambda name: float(np.hypot(*(ties[name][[0, 2]] - place))))

    lines = ["! Distances between tie points, m: along the foot and the top of the cliff, and a difference of height."]
    for name, (code, start, end) in DISTANCES.items():
        one, other = nearest(start), nearest(end)
        difference = ties[other] - ties[one]
        length = difference[2] if code == "Z" else np.linalg.norm(difference)
        lines.append(f"  {name} {one} {other} {code:<3}{length + SURVEY_M * random.normal():9.3f}{SURVEY_M:6.2f}")
    return text(lines)


def truth_json(truth: Truth, blunders: Blunders) -> str:
    """Return the text of truth.json; README.md explains its parts."""
    parts = {
        "seed": SEED,
        "camera": CAMERA,
        "photos": {name: list(orientation) for name, orientation in truth.orientations.items()},
        "points": {name: list(point) for name, point in truth.points.items()},
        "prints": {name: list(places) for name, places in truth.prints.items()},
        "film_scale": FILM_SCALE,
        "ripples": {name: [asdict(ripple) for ripple in ripples] for name, ripples in truth.ripples.items()},
        "mountings": [{"log": f"{day}.MEA", "template": name, "place": at} for (day, name), at in MOUNTINGS.items()],
        "blunders": [
            {"photo": MISPOINTED_PHOTO, "point": blunders.mispointed, "mispointed_by": MISPOINTED_BY},
            {"photo": MISNUMBERED_PHOTO, "point": blunders.misnumbered, "measured_instead": blunders.measured_instead},
        ],
    }
    return "{\n" + ",\n".join(f' "{name}": {_part(part)}' for name, part in parts.items()) + "\n}\n"


def _part(part: Any) -> str:
    """Return JSON with one item a line."""
    if isinstance(part, dict) and part is not CAMERA:
        return "{\n" + ",\n".join(f"  {json.dumps(name)}: {json.dumps(item)}" for name, item in part.items()) + "\n }"
    if isinstance(part, list):
        return "[\n" + ",\n".join(f"  {json.dumps(item)}" for item in part) + "\n ]"
    return json.dumps(part)


def text(lines: Iterable[str]) -> str:
    """Return the lines as the text of a file."""
    return "\n".join(lines) + "\n"


def simulate() -> dict[str, str]:
    """Return the texts of the files by name."""
    project = tomllib.loads((HERE / "orip.toml").read_text(encoding="utf-8"))
    # the numbers of RandomState are the same in every version of NumPy (NEP 19), those of a Generator are not
    random = np.random.RandomState(SEED)
    truth = with_operators_names(project, draw_truth(random, project))
    images = images_in_models(project, truth)
    blunders = choose_blunders(images)
    operator = Operator(random, project, truth)
    return {
        "DAY1.MEA": first_day(operator, images, blunders),
        "DAY2.MEA": second_day(operator, images, blunders),
        "CLIFF.PNT": control_points(random, truth),
        "CLIFF.LEN": distances(random, truth, images),
        "truth.json": truth_json(truth, blunders),
    }


def main() -> None:
    """Write the files into the folder named on the command line, else beside this program."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
    for name, content in simulate().items():
        (folder / name).write_text(content, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
