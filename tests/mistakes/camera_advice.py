"""Mistakes in cameras, angles and photos of a small drone block with stations: what is said first, and following it.

``PYTHONPATH=tests python -m mistakes.camera_advice [mistake ...]`` plants each mistake with each kind of positions and
prints its score: 3 where the first sentence names cause and mend, 2 for the cause alone, 1 where it speaks of something
else that is mended in vain, 0 where it is silent. Then a script does what it says, and the block is run again.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from cli.command_line import orip
from mistakes.advice import Followed, is_well, said_first
from msgspec import Struct, field
from scipy.spatial.transform import Rotation

from orip.geometry.rotation import (
    angles_from_rotation,
    navigation_from_rotation,
    rotation_from_angles,
    rotation_from_navigation,
)

COLUMNS, ROWS, PIXEL = 5472, 3648, 13.2 / 5472
C, POINT, A3 = 8.8, (0.062, -0.047), 1.1e-4
SENSOR = (13.2, 8.8)
ORIGIN = np.array([563000.0, 5933000.0, 0.0])
STRIPS, PHOTOS = 4, 6
HEIGHT = 90.0
OTHER_C = 9.05
OF_OTHER_LENS = tuple(f"DJI_{number:04d}" for number in range(19, 25))

Seen = dict[str, dict[str, tuple[float, float]]]


class Project(Struct):
    """What is written; `ending` is the file of the positions: STA, STA with angles, ELE, or none."""

    ending: str
    measured: Seen
    control: dict[str, np.ndarray]
    positions: dict[str, np.ndarray]
    angles: dict[str, np.ndarray]
    camera: dict[str, object]
    distortion: dict[str, float]
    sensor: tuple[float, float] = SENSOR
    second: tuple[str, ...] = ()
    order: tuple[str, ...] = field(default_factory=tuple)
    control_error: float = 0.02
    position_error: float = 0.03

    def write(self, folder: Path) -> Path:
        """Write the texts of the project."""
        folder.mkdir()
        given = "".join(f"{key} = {value}\n" for key, value in self.camera.items())
        given += "".join(f"distortion.{key} = {value}\n" for key, value in self.distortion.items())
        sensor = f"columns = {COLUMNS}, rows = {ROWS}, width = {self.sensor[0]}, height = {self.sensor[1]}"
        toml = '[project]\nname = "T"\n'
        for name in ("FC", "FC2") if self.second else ("FC",):
            toml += f'[[camera]]\nname = "{name}"\nsensor = {{ {sensor} }}\n{given}'
            toml += 'unknown = ["C"]\n' if self.second and "unknown" not in self.camera else ""
        for photo in self.measured:
            toml += f'[[photo]]\nname = "{photo}"\ncamera = "{"FC2" if photo in self.second else "FC"}"\n'
        (folder / "orip.toml").write_text(f'{toml}[[bundle]]\nname = "MAIN"\nmeasurement_precision = "0.3px"\n')
        log = []
        for photo, points in self.measured.items():
            log += [f"POINTS MAIN {photo}", *(f"{name} {x:.3f} {y:.3f}" for name, (x, y) in points.items())]
        _write(folder / "T.MEA", log)
        _write(folder / "T.PNT", [self._point(name) for name in self.control])
        if self.ending.startswith("STA"):
            _write(folder / "T.STA", [self._station(name) for name in self.positions])
        elif self.ending == "ELE":
            _write(folder / "T.ELE", [line for name in self.positions for line in self._elements(name)])
        return folder

    def _point(self, name: str) -> str:
        return f"{name} {_texts(self.control[name], 4)}{f' {self.control_error:g}' * 3}"

    def _station(self, name: str) -> str:
        angles = f" {_texts(self.angles[name], 5)} 0.05 0.05 0.1" if self.ending == "STA with angles" else ""
        return f"{name} {_texts(self.positions[name], 4)}{f' {self.position_error:g}' * 3}{angles}"

    def _elements(self, name: str) -> Iterator[str]:
        for kind, value in zip(("X0", "Y0", "Z0"), self.positions[name], strict=True):
            yield f"{name} PHOTO {kind} {value:.4f} {self.position_error:g}"


def _write(path: Path, lines: list[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines))


def _texts(values: np.ndarray, decimals: int) -> str:
    return " ".join(f"{value:.{decimals}f}" for value in values)


def pixels(centre: np.ndarray, angles: np.ndarray, points: np.ndarray, c: float = C) -> np.ndarray:
    """Return columns and rows (n, 2) of points (n, 3)."""
    u = (points - centre) @ Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()
    xy = -c * u[:, :2] / u[:, 2:]
    xy = xy * (1.0 + A3 * np.sum(xy**2, axis=1, keepdims=True)) + POINT
    return np.column_stack([xy[:, 0] / PIXEL + COLUMNS / 2, ROWS / 2 - xy[:, 1] / PIXEL])


def sound(ending: str, seed: int = 3, points_of_a_photo: int = 30) -> Project:
    """Return a block of 24 photos in four strips flown to and fro, without a mistake."""
    random = np.random.default_rng(seed)
    truth: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for strip in range(STRIPS):
        for number in range(PHOTOS):
            place = number if strip % 2 == 0 else PHOTOS - 1 - number
            centre = np.array([40.0 * place, 45.0 * strip, HEIGHT]) + random.uniform(-1.5, 1.5, 3)
            kappa = 0.0 if strip % 2 == 0 else 180.0
            angles = np.array([*random.uniform(-3.0, 3.0, 2), kappa + random.uniform(-4.0, 4.0)])
            truth[f"DJI_{len(truth) + 1:04d}"] = centre, angles
    ground = random.uniform([-40.0, -40.0, -6.0], [240.0, 175.0, 6.0], (200, 3))
    places = [[x, y, random.uniform(-6.0, 6.0)] for x in (0.0, 100.0, 200.0) for y in (0.0, 68.0, 135.0)]
    names = [f"K{number + 1}" for number in range(len(places))] + [f"{number + 101}" for number in range(len(ground))]
    points = np.vstack([places, ground])
    measured: Seen = {}
    for photo, (centre, angles) in truth.items():
        c = OTHER_C if photo in OF_OTHER_LENS and points_of_a_photo < 0 else C
        seen = pixels(centre, angles, points, c)
        inside = np.flatnonzero((seen > 0.0).all(axis=1) & (seen < [COLUMNS, ROWS]).all(axis=1))
        kept = inside[: abs(points_of_a_photo)]
        noise = 0.3 * random.normal(size=(len(kept), 2))
        measured[photo] = {names[k]: tuple((seen[k] + off).tolist()) for k, off in zip(kept, noise, strict=True)}
    rays = [name for of in measured.values() for name in of]
    measured = {photo: {name: xy for name, xy in of.items() if rays.count(name) > 1} for photo, of in measured.items()}
    return Project(
        ending,
        measured,
        {
            name: xyz + ORIGIN + random.normal(scale=0.01, size=3)
            for name, xyz in zip(names[: len(places)], points[: len(places)], strict=True)
        },
        {name: centre + ORIGIN + random.normal(scale=0.03, size=3) for name, (centre, _) in truth.items()},
        {name: angles + random.normal(scale=[0.05, 0.05, 0.1]) for name, (_, angles) in truth.items()},
        {"c": C, "principal_point": list(POINT)},
        {"A3": A3},
    )


# ------------------------------------------------------------------------------------------------------------ mistakes

Making = Callable[[Project], None]


def _camera(**values: object) -> Making:
    return lambda project: project.camera.update(values)


def _distortion(factor: float) -> Making:
    def make(project: Project) -> None:
        project.distortion = {key: factor * value for key, value in project.distortion.items() if factor}

    return make


def _sensor(width: float, height: float) -> Making:
    def make(project: Project) -> None:
        project.sensor = (width, height)

    return make


def _angles(change: Callable[[np.ndarray], np.ndarray]) -> Making:
    def make(project: Project) -> None:
        project.angles = {name: change(angles) for name, angles in project.angles.items()}

    return make


def _turned(degrees: float) -> Making:
    return _angles(lambda angles: angles + np.array([0.0, 0.0, degrees]))


def _as_navigation(angles: np.ndarray) -> np.ndarray:
    return np.degrees(navigation_from_rotation(rotation_from_angles(np.radians(angles)[None])))[0]


def _exchanged(one: str, other: str, rows: str) -> Making:
    def make(project: Project) -> None:
        of = getattr(project, rows)
        of[one], of[other] = of[other], of[one]

    return make


def _pixels(change: Callable[[float, float], tuple[float, float]], *photos: str) -> Making:
    def make(project: Project) -> None:
        for photo in photos or project.measured:
            project.measured[photo] = {name: change(*xy) for name, xy in project.measured[photo].items()}

    return make


def _lens(number: int) -> Making:
    def make(project: Project) -> None:
        project.measured = sound(project.ending, 3, number).measured

    return make


def _both(*makings: Making) -> Making:
    def make(project: Project) -> None:
        for making in makings:
            making(project)

    return make


STA, ANGLES, ELE, NONE = "STA", "STA with angles", "ELE", ""
WITH, ANY = (STA, ANGLES, ELE), (STA, ANGLES, ELE, NONE)
X, Y = POINT


class Planted(Struct, frozen=True):
    """A mistake; with which positions it can occur and show, how it is made, and words of cause and mend."""

    endings: tuple[str, ...]
    make: Making
    cause: str
    mend: str


MISTAKES: dict[str, Planted] = {
    "C as the equivalent for 35 mm film": Planted(
        ANY, _camera(c=24.0), "C = 24 mm .*equivalent for 35 mm", r"8\.8|correct"),
    "sensor of another camera": Planted(ANY, _sensor(23.5, 15.667), "size of the sensor", "correct"),
    "C of a longer lens": Planted(ANY, _camera(c=12.0), "C = 12 mm", r'correct|unknown = \["C"\]'),
    "C of another zoom": Planted(WITH, _camera(c=9.3), "C = 9.3 mm", r'correct|unknown = \["C"\]'),
    "C an old calibration": Planted(WITH, _camera(c=8.86), "C of camera FC|C = 8.86", r'unknown = \["C"\]'),
    "C far off, free": Planted(ANY, _camera(c=24.0, unknown=["C"]), "C .*24", r"(?i)correct|write|check"),
    "principal point: sign of x": Planted(
        WITH, _camera(principal_point=[-X, Y]), "principal point .*sign of x;|DX of camera", "reverse|unknown"),
    "principal point: sign of y": Planted(
        WITH, _camera(principal_point=[X, -Y]), "principal point .*sign of y;|DY of camera", "reverse|unknown"),
    "principal point: both signs": Planted(
        WITH, _camera(principal_point=[-X, -Y]), "principal point .*sign of x and y", "reverse"),
    "distortion: sign": Planted(ANY, _distortion(-1.0), "distortion .*opposite sign", "reverse"),
    "distortion left out": Planted(ANY, _distortion(0.0), "distortion that is not in", "unknown"),
    "omega and phi exchanged": Planted((ANGLES,), _angles(lambda a: a[[1, 0, 2]]), "OMEGA and PHI", "exchange"),
    "sign of kappa": Planted((ANGLES,), _angles(lambda a: a * [1, 1, -1]), "opposite sign of KAPPA", "reverse"),
    "sign of omega": Planted((ANGLES,), _angles(lambda a: a * [-1, 1, 1]), "opposite sign of OMEGA;", "reverse"),
    "sign of omega and phi": Planted(
        (ANGLES,), _angles(lambda a: a * [-1, -1, 1]), "opposite sign of OMEGA and PHI", "reverse"),
    "kappa turned by 180": Planted((ANGLES,), _turned(180.0), "KAPPA .*180", "180"),
    "kappa turned by 90": Planted((ANGLES,), _turned(90.0), "KAPPA .*90", "90"),
    "roll, pitch and heading": Planted((ANGLES,), _angles(_as_navigation), "roll, pitch and heading", "ANGLES ROLL"),
    "angles in gon": Planted((ANGLES,), _angles(lambda a: a / 0.9), "in gon", "degrees"),
    "angles in radians": Planted((ANGLES,), _angles(np.radians), "in radians", "degrees"),
    "measurements of two photos exchanged": Planted(
        ANY[:3], _exchanged("DJI_0003", "DJI_0015", "measured"), "DJI_0003 and DJI_0015 .*are exchanged", "exchange"),
    "measurements of neighbours exchanged": Planted(
        ANY[:3], _exchanged("DJI_0009", "DJI_0010", "measured"), "DJI_0009 and DJI_0010 .*are exchanged", "exchange"),
    "two lenses, few points": Planted(WITH, _lens(-12), "DJI_0019.*another lens", r"second \[\[camera\]\]"),
    "two lenses": Planted(WITH, _lens(-30), "DJI_0019.*another lens", r"second \[\[camera\]\]"),
    "rows counted upwards": Planted(
        ANY, _pixels(lambda x, y: (x, ROWS - y)), "rows .*upward|mirrored|mirror image", "rows|reverse it"),
    "rows counted upwards in one": Planted(
        ANY, _pixels(lambda x, y: (x, ROWS - y), "DJI_0008"), "DJI_0008: .*(mirror|upward)", "rows|mirror"),
    "half the resolution": Planted(ANY, _pixels(lambda x, y: (x / 2, y / 2)), "resolution", "multipl|scale"),
    "half the resolution in one": Planted(
        ANY, _pixels(lambda x, y: (x / 2, y / 2), "DJI_0008"), "DJI_0008: .*resolution", "multipl|scale"),
    "one picture turned by 180": Planted(
        WITH, _pixels(lambda x, y: (COLUMNS - x, ROWS - y), "DJI_0008"), "DJI_0008: .*(180|turned)", "turn|measure"),
}  # fmt: skip

# -------------------------------------------------------------------------------------------------------- following it

Doing = Callable[[Project, re.Match[str]], None]


def _set_free(project: Project, found: re.Match[str]) -> None:
    project.camera["unknown"] = re.findall(r'"(\w+)"', found["kinds"])


def _correct_c(project: Project, found: re.Match[str]) -> None:
    # who is told that either is wrong knows which of the two is another camera's
    if sizes := re.search(r"that is ([\d.]+) x ([\d.]+) mm", found.string) if project.sensor != SENSOR else None:
        project.sensor = (float(sizes[1]), float(sizes[2]))
        project.camera["unknown"] = ["C"]
        return
    project.camera["c"] = float(found["c"] or found["other"])
    # as the sentence has it, so that what the sensor has done to it is determined, too
    project.camera["unknown"] = ["C"]


def _reverse_point(project: Project, found: re.Match[str]) -> None:
    x, y = project.camera["principal_point"]
    axes = found["axes"]
    project.camera["principal_point"] = [-x if "x" in axes else x, -y if "y" in axes else y]


def _reverse_distortion(project: Project, _: re.Match[str]) -> None:
    _distortion(-1.0)(project)


def _exchange_measured(project: Project, found: re.Match[str]) -> None:
    _exchanged(found["one"], found["other"], "measured")(project)


def _reverse_angles(project: Project, found: re.Match[str]) -> None:
    signs = [-1.0 if kind in found["kinds"] else 1.0 for kind in ("OMEGA", "PHI", "KAPPA")]
    _angles(lambda angles: angles * signs)(project)


def _turn(project: Project, found: re.Match[str]) -> None:
    _turned(float(found["by"]))(project)


def _from_navigation(project: Project, _: re.Match[str]) -> None:
    def omega_phi_kappa(angles: np.ndarray) -> np.ndarray:
        return np.degrees(angles_from_rotation(rotation_from_navigation(np.radians(angles)[None])))[0]

    _angles(omega_phi_kappa)(project)


def _second(project: Project, _: re.Match[str]) -> None:
    project.second = OF_OTHER_LENS


def _scaled(factor: float) -> Doing:
    def do(project: Project, found: re.Match[str]) -> None:
        photos = re.findall(r"photo (\S+):", found.string)
        _pixels(lambda x, y: (x * factor, y * factor), *photos)(project)

    return do


def _upwards(project: Project, found: re.Match[str]) -> None:
    _pixels(lambda x, y: (x, ROWS - y), *re.findall(r"photo (\S+):", found.string))(project)


def _upside_down(project: Project, found: re.Match[str]) -> None:
    _pixels(lambda x, y: (COLUMNS - x, ROWS - y), *re.findall(r"photo (\S+):", found.string))(project)


ADVICE: tuple[tuple[str, Doing], ...] = (
    (r"roll, pitch and heading", _from_navigation),
    (r"OMEGA and PHI are exchanged", lambda project, _: _angles(lambda a: a[[1, 0, 2]])(project)),
    (r"reverse the sign of (?P<kinds>[A-Z, and]*(?:OMEGA|PHI|KAPPA))", _reverse_angles),
    (r"add (?P<by>-?\d+) to KAPPA", _turn),
    (r"in gon", lambda project, _: _angles(lambda a: a * 0.9)(project)),
    (r"in radians", lambda project, _: _angles(np.degrees)(project)),
    (r"(?P<one>DJI_\d+) and (?P<other>DJI_\d+) (?:fit when they )?are exchanged", _exchange_measured),
    (r"second \[\[camera\]\]", _second),
    (r"opposite sign of (?P<axes>x and y|x|y);", _reverse_point),
    (r"distortion fits with the opposite sign", _reverse_distortion),
    (r"size of the sensor.*c = (?P<c>[\d.]+\d)|write c = (?P<other>[\d.]+\d)", _correct_c),
    (r"unknown = \[(?P<kinds>[^]]*)\]", _set_free),
    (r"resolution|multiplied by 2", _scaled(2.0)),
    (r"rows .*upwards|as a mirror image|as mirror images", _upwards),
    (r"turned by 180", _upside_down),
)
"""What a line says, and what is then done."""


def followed(mistake: str, ending: str) -> tuple[Followed, int]:
    """Plant a mistake, do what is said first of it, and run again; also the score of what was said."""
    planted, project = MISTAKES[mistake], sound(ending)
    planted.make(project)
    with tempfile.TemporaryDirectory() as folder:
        said = orip(project.write(Path(folder) / "before"), "run", "--no-report")
        first = said_first(said)
        score = 0 if is_well(said) else 1
        if re.search(planted.cause, first):
            score = 3 if re.search(planted.mend, first) else 2
        complaints = len(re.findall("^(?:error|warning): ", said.told, re.MULTILINE))
        doing = next(((do, found) for words, do in ADVICE if (found := re.search(words, first))), None)
        after = said
        if doing is not None:
            doing[0](project, doing[1])
            after = orip(project.write(Path(folder) / "after"), "run", "--no-report")
    return Followed(
        first, complaints, doing is not None, doing is not None and is_well(after), said_first(after)
    ), score


def main() -> None:
    """Print what was said, the scores, and in how many cases following it helped."""
    scores, well = [], 0
    for mistake, planted in MISTAKES.items():
        for ending in planted.endings if not sys.argv[1:] or mistake in sys.argv[1:] else ():
            found, score = followed(mistake, ending)
            scores, well = [*scores, score], well + found.is_well
            mark = "well" if found.is_well else "NOT " if found.can_be_followed else "DUMB"
            sys.stdout.write(f"{score} {mark} {found.complaints} {mistake} / {ending}: {found.first[:400]}\n")
            if found.can_be_followed and not found.is_well:
                sys.stdout.write(f"     after: {found.after[:250]}\n")
            sys.stdout.flush()
    sys.stdout.write(f"mean {np.mean(scores):.2f}, {well} of {len(scores)} end well\n")


if __name__ == "__main__":
    main()
