"""Mistakes in positions of photos and in control, advice that is followed by a script, and whether the block fits then.

``PYTHONPATH=tests python -m mistakes.advice [SEEDS] [mistake ...]`` plants each mistake where it can occur and prints
what was said where following it did not lead to a block that converges and fits.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from cli.command_line import Said, orip
from mistakes.small_folders import Folder, images, terrain
from msgspec import Struct, field

ORIGIN = np.array([563000.0, 5933000.0, 0.0])
CONTROL = ("10", "14", "40", "44", "70", "74", "42")
FOOT = 0.3048
OWN_DEGREES = np.array([66000.0, 111000.0, 1.0])
"""Metres of a degree where the positions in degrees are meant to be."""

Rows = dict[str, np.ndarray]


class Project(Struct):
    """What is written: control, positions of photos, and their errors; `ending` is the file of the positions.

    `unknown` are points without a height, `rejected` those with an x.
    """

    ending: str
    measured: dict[str, dict[str, tuple[float, float]]]
    control: Rows
    control_errors: Rows
    positions: Rows
    position_errors: Rows
    antenna: str = ""
    unknown: set[str] = field(default_factory=set)
    rejected: set[str] = field(default_factory=set)

    def write(self, folder: Path) -> Path:
        """Write the texts of the project."""
        control = []
        for name, xyz in self.control.items():
            values, errors = [f"{value:.4f}" for value in xyz], [f"{error:g}" for error in self.control_errors[name]]
            if name in self.unknown:
                values[2] = errors[2] = "-"
            control.append(" ".join([name, *values, *errors, *(["x"] if name in self.rejected else [])]))
        Folder({}, self.measured, control).write(folder)
        lines = []
        for name, xyz in self.positions.items():
            errors = self.position_errors[name]
            if self.ending == "STA":
                lines.append(" ".join([name, *(f"{value:.8f}" for value in xyz), *(f"{error:g}" for error in errors)]))
            elif self.ending == "ELE":
                lines += [
                    f"{name} PHOTO {kind} {value:.8f} {error:g}"
                    for kind, value, error in zip(("X0", "Y0", "Z0"), xyz, errors, strict=True)
                ]
        if lines:
            (folder / f"T.{self.ending}").write_text("".join(f"{line}\n" for line in lines))
        with (folder / "orip.toml").open("a") as text:
            text.write(self.antenna)
        return folder


def sound(ending: str, seed: int) -> Project:
    """Return a block of twelve photos in three strips, without a mistake; `ending` "" has no positions."""
    random = np.random.default_rng(seed)
    centres = {
        f"P{4 * row + column + 1}": (
            *(np.array([1000.0 + 900.0 * column, 1500.0 + 500.0 * row, 1600.0]) + random.uniform(-40.0, 40.0, 3)),
            *random.uniform(-2.0, 2.0, 3),
        )
        for row in range(3)
        for column in range(4)
    }
    points = terrain(60.0, seed)
    measured = images(centres, points, 150.0, 115.0, 0.003)
    rays = [name for seen in measured.values() for name in seen]
    measured = {
        photo: {name: xy for name, xy in seen.items() if rays.count(name) > 1} for photo, seen in measured.items()
    }
    control = {name: points[name] + ORIGIN + random.normal(scale=0.01, size=3) for name in CONTROL}
    positions = {
        name: np.array(values[:3]) + ORIGIN + random.normal(scale=0.03, size=3) for name, values in centres.items()
    }
    return Project(
        ending, measured, control, {name: np.full(3, 0.02) for name in control},
        positions if ending else {}, {name: np.full(3, 0.03) for name in positions},
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------------ mistakes

Making = Callable[[Project, np.random.Generator], None]


def _all(rows: str, change: Callable[[np.ndarray], np.ndarray]) -> Making:
    def make(project: Project, _: np.random.Generator) -> None:
        of = getattr(project, rows)
        for name, xyz in of.items():
            of[name] = change(xyz)

    return make


def _one(rows: str, change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Making:
    def make(project: Project, random: np.random.Generator) -> None:
        of = getattr(project, rows)
        name = str(random.choice(list(of)))
        of[name] = change(of[name].copy(), random)

    return make


def _digit(xyz: np.ndarray, random: np.random.Generator) -> np.ndarray:
    axis = int(random.integers(2))
    text = list(f"{xyz[axis]:.4f}")
    place = len(text) - 5 - int(random.integers(1, 4))
    text[place] = str((int(text[place]) + int(random.integers(1, 9))) % 10)
    xyz[axis] = float("".join(text))
    return xyz


def _two_digits(xyz: np.ndarray, random: np.random.Generator) -> np.ndarray:
    axis = int(random.integers(2))
    text = list(f"{xyz[axis]:.4f}")
    for place in (len(text) - 7, len(text) - 8, len(text) - 6):
        if text[place] != text[place - 1] and text[place].isdigit() and text[place - 1].isdigit():
            text[place], text[place - 1] = text[place - 1], text[place]
            break
    xyz[axis] = float("".join(text))
    return xyz


def _off(*by: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    return lambda xyz, _: xyz + np.array(by)


def _exchanged(rows: str) -> Making:
    def make(project: Project, random: np.random.Generator) -> None:
        of = getattr(project, rows)
        one, other = (str(name) for name in random.choice(list(of), 2, replace=False))
        of[one], of[other] = of[other], of[one]

    return make


def _reordered(order: Callable[[list[str]], list[str]]) -> Making:
    def make(project: Project, _: np.random.Generator) -> None:
        names = list(project.positions)
        project.positions = {name: project.positions[other] for name, other in zip(names, order(names), strict=False)}

    return make


def _strip(project: Project, _: np.random.Generator) -> None:
    for name in ("P5", "P6", "P7", "P8"):
        project.positions[name] = project.positions[name] + np.array([0.0, 1.83, 0.0])


def _zero_height(project: Project, random: np.random.Generator) -> None:
    name = str(random.choice(list(project.control)))
    project.control[name] = project.control[name] * [1.0, 1.0, 0.0]


def _hyphens(project: Project, _: np.random.Generator) -> None:
    for rows in ("control", "control_errors"):
        setattr(project, rows, {f"{name[0]}-{name[1]}": xyz for name, xyz in getattr(project, rows).items()})


def _errors_times(rows: str, factor: float) -> Making:
    return _all(rows, lambda errors: errors * factor)


FEET, ZONE = np.array([FOOT] * 3), np.array([32e6, 0.0, 0.0])
ANY, WITH, OF_POSITIONS = ("", "STA", "ELE"), ("STA", "ELE"), ("STA", "ELE")

MISTAKES: dict[str, tuple[tuple[str, ...], Making]] = {
    "position: digit": (OF_POSITIONS, _one("positions", _digit)),
    "position: two digits exchanged": (OF_POSITIONS, _one("positions", _two_digits)),
    "position: no fix": (OF_POSITIONS, _one("positions", _off(0.4, -1.83, 0.9))),
    "position: axes of one": (OF_POSITIONS, _one("positions", lambda xyz, _: xyz[[1, 0, 2]])),
    "positions: two exchanged": (OF_POSITIONS, _exchanged("positions")),
    "positions: a strip": (OF_POSITIONS, _strip),
    "positions: sorted as text": (OF_POSITIONS, _reordered(sorted)),
    "positions: moved by one": (OF_POSITIONS, _reordered(lambda names: names[1:])),
    "positions: height system": (OF_POSITIONS, _all("positions", lambda xyz: xyz + np.array([0.0, 0.0, 42.7]))),
    "positions: zone": (OF_POSITIONS, _all("positions", lambda xyz: xyz + ZONE)),
    "positions: north east": (OF_POSITIONS, _all("positions", lambda xyz: xyz[[1, 0, 2]])),
    "positions: feet": (OF_POSITIONS, _all("positions", lambda xyz: xyz / FEET)),
    "positions: heights in feet": (OF_POSITIONS, _all("positions", lambda xyz: xyz / [1.0, 1.0, FOOT])),
    "positions: heights downwards": (OF_POSITIONS, _all("positions", lambda xyz: xyz * [1.0, 1.0, -1.0])),
    "positions: degrees": (OF_POSITIONS, _all("positions", lambda xyz: xyz / OWN_DEGREES)),
    "positions: errors in mm": (OF_POSITIONS, _errors_times("position_errors", 1000.0)),
    "positions: shifted": (("STA",), _all("positions", lambda xyz: xyz + np.array([3.0, -1.5, 2.0]))),
    "positions: errors in cm": (OF_POSITIONS, _errors_times("position_errors", 100.0)),
    "control: digit": (ANY, _one("control", _digit)),
    "control: two digits exchanged": (ANY, _one("control", _two_digits)),
    "control: wrong stone": (ANY, _one("control", _off(0.9, -0.6, 0.0))),
    "control: height off": (ANY, _one("control", _off(0.0, 0.0, 0.8))),
    "control: axes of one": (ANY, _one("control", lambda xyz, _: xyz[[1, 0, 2]])),
    "control: two exchanged": (ANY, _exchanged("control")),
    "control: zero height": (ANY, _zero_height),
    "control: hyphens": (ANY, _hyphens),
    "control: north east": (ANY, _all("control", lambda xyz: xyz[[1, 0, 2]])),
    "control: height system": (WITH, _all("control", lambda xyz: xyz + np.array([0.0, 0.0, 42.7]))),
    "control: zone": (WITH, _all("control", lambda xyz: xyz + ZONE)),
    "control: feet": (WITH, _all("control", lambda xyz: xyz / FEET)),
    "control: heights in feet": (ANY, _all("control", lambda xyz: xyz / [1.0, 1.0, FOOT])),
    "control: heights downwards": (ANY, _all("control", lambda xyz: xyz * [1.0, 1.0, -1.0])),
    "control: errors in mm": (ANY, _errors_times("control_errors", 1000.0)),
}
"""Files of positions with which a mistake can occur, and what makes it."""

# -------------------------------------------------------------------------------------------------------- following it

Doing = Callable[[Project, Project, re.Match[str]], None]

POINT = r"(?:control point|exposure station) (?P<name>\S+): "


def _rows(project: Project, found: re.Match[str]) -> Rows:
    """Return the rows that a line is about."""
    subject = re.split("[:;]", re.sub(r"^(warning|error): ", "", found.string))[0]
    return project.positions if re.search("station|position|photo", subject) else project.control


def _each(rows: Rows, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for name, xyz in rows.items():
        rows[name] = change(xyz)


def _correct_slips(project: Project, _: Project, found: re.Match[str]) -> None:
    for axis, value in re.findall(r"\b([XYZ])0? = \S+ is probably (-?[\d.]+): ", found.string):
        _rows(project, found)[found["name"]]["XYZ".index(axis)] = float(value)


def _exchange_two(project: Project, _: Project, found: re.Match[str]) -> None:
    rows, one, other = _rows(project, found), found["one"], found["other"]
    rows[one], rows[other] = rows[other], rows[one]


def _leave_height_out(project: Project, _: Project, found: re.Match[str]) -> None:
    project.unknown.add(found["name"])


def _exchange_axes_of_one(project: Project, _: Project, found: re.Match[str]) -> None:
    rows = _rows(project, found)
    rows[found["name"]] = rows[found["name"]][[1, 0, 2]]


def _exchange_axes(project: Project, _: Project, found: re.Match[str]) -> None:
    of_positions = re.search(r"\.(STA|ELE) file", found.string) is not None
    _each(project.positions if of_positions else project.control, lambda xyz: xyz[[1, 0, 2]])


def _without_zone(project: Project, _: Project, __: re.Match[str]) -> None:
    for rows in (project.control, project.positions):
        _each(rows, lambda xyz: xyz - ZONE * (xyz[0] > 1e7))


def _shift_heights(project: Project, _: Project, found: re.Match[str]) -> None:
    by = float(found["by"]) * (-1.0 if found["side"] == "high" else 1.0)
    _each(_rows(project, found), lambda xyz: xyz + np.array([0.0, 0.0, by]))


def _take_again(project: Project, truth: Project, _: re.Match[str]) -> None:
    project.positions = dict(truth.positions)


def _multiply(project: Project, _: Project, found: re.Match[str]) -> None:
    # five digits stand for feet or metres
    factor = {"0.3048": FOOT, "3.2808": 1.0 / FOOT}.get(found["factor"], float(found["factor"]))
    of_heights = re.search(r"\bZ (is multiplied|fits)", found.string) is not None
    factors = np.array([1.0, 1.0, factor]) if of_heights else np.full(3, factor)
    _each(_rows(project, found), lambda xyz: xyz * factors)


def _reverse(project: Project, _: Project, found: re.Match[str]) -> None:
    signs = np.where(np.arange(3) == "XYZ".index(found["axis"]), -1.0, 1.0)
    _each(_rows(project, found), lambda xyz: xyz * signs)


def _divide_errors(project: Project, _: Project, found: re.Match[str]) -> None:
    factor = {"mm": 1000.0, "cm": 100.0}[found["unit"]]
    of_positions = _rows(project, found) is project.positions
    _each(project.position_errors if of_positions else project.control_errors, lambda errors: errors / factor)


def _without_hyphens(project: Project, _: Project, __: re.Match[str]) -> None:
    project.control = {name.replace("-", ""): xyz for name, xyz in project.control.items()}
    project.control_errors = {name.replace("-", ""): errors for name, errors in project.control_errors.items()}


def _compare_only(project: Project, truth: Project, found: re.Match[str]) -> None:
    listed = [name for name in re.split(r", | and ", found["names"]) if name in project.positions]
    off = {name: float(np.abs(xyz - project.positions[name]).max()) for name, xyz in truth.positions.items()}
    for name in [name for name in off if off[name] > 0.1] if "more" in found["names"] else listed:
        project.position_errors[name] = -project.position_errors[name]


def _set_antenna(project: Project, _: Project, found: re.Match[str]) -> None:
    project.antenna = f'[[antenna]]\nname = "GNSS"\n{found["setting"]}\n'


def _reject(project: Project, _: Project, found: re.Match[str]) -> None:
    project.rejected.add(found["name"])


ADVICE: tuple[tuple[str, Doing], ...] = (
    (rf"{POINT}.*\b[XYZ]0? = \S+ is probably ", _correct_slips),
    (r"(?P<one>\S+) and (?P<other>\S+) fit when they are exchanged", _exchange_two),
    (rf"{POINT}Z = 0 was probably", _leave_height_out),
    (r"control point (?P<one>\S+): the photos see it where control point (?P<other>\S+) is given", _exchange_two),
    (rf"{POINT}.*(?:X0? and Y0? are exchanged|with X and Y exchanged)", _exchange_axes_of_one),
    (r"columns X and Y", _exchange_axes),
    (r"number of a zone", _without_zone),
    (r"given (?P<by>[\d.]+) m too (?P<side>high|low) in Z", _shift_heights),
    # who matches or converts again has the origin of the data
    (r"in degrees|those of other photos|moved by one photo", _take_again),
    (r"multiplied by (?P<factor>[\d.]+)", _multiply),
    (r"(?P<axis>[XYZ])(?: of \S+)* (?:has|have) the opposite sign|reverse the sign of (?P<other>[XYZ])", _reverse),
    (r"these seem to be in (?P<unit>mm|cm)", _divide_errors),
    (r"differ by a hyphen alone", _without_hyphens),
    (r"exposure stations? (?P<names>.*?): .*make (?:its|their) errors negative", _compare_only),
    (r"set (?P<setting>(?:lever_arm|shift) = .*?) in \[\[antenna\]\]", _set_antenna),
    (rf"{POINT}its coordinates contradict the photos", _reject),
)
"""What a line says, and what is then done."""


def follow(project: Project, truth: Project, line: str) -> bool:
    """Do what a line says, and tell whether it says anything that can be done."""
    for words, do in ADVICE:
        if found := re.search(words, line):
            do(project, truth, found)
            return True
    return False


def said_first(said: Said) -> str:
    """Return the first complaint; else the status with what is to be done."""
    lines = said.told.splitlines()
    for place, line in enumerate(lines):
        if re.match("error: |warning: ", line):
            return line
        if line.startswith("status "):
            more = lines[place + 1].strip() if not lines[place + 1].startswith("sigma0") else ""
            return f"{line} {more}"
    return ""


def is_well(said: Said) -> bool:
    """Tell whether a block converges, and nothing does not fit."""
    lines = said.told.splitlines()
    status = next((line for line in lines if line.startswith("status ")), "")
    return status.startswith("status   converged") and not [
        line for line in lines if re.match("error: |warning: |misfit ", line)
    ]


class Followed(Struct, frozen=True):
    """What was said first of a mistake, and how many complaints; whether it could be followed, and what came of it.

    A mistake of which nothing is said cannot be followed.
    """

    first: str
    complaints: int
    can_be_followed: bool
    is_well: bool
    after: str


def followed(mistake: str, ending: str, seed: int) -> Followed:
    """Plant a mistake, do what is said first of it, and run again."""
    project, truth = sound(ending, seed), sound(ending, seed)
    MISTAKES[mistake][1](project, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        said = orip(project.write(Path(folder) / "before"), "run", "--no-report")
        first = said_first(said)
        if is_well(said):
            return Followed(first, 0, False, False, "")
        complaints = len(re.findall("^(?:error|warning): ", said.told, re.MULTILINE))
        can = follow(project, truth, first)
        after = orip(project.write(Path(folder) / "after"), "run", "--no-report") if can else said
    return Followed(first, complaints, can, can and is_well(after), said_first(after))


def cases(seeds: int, chosen: list[str]) -> Iterator[tuple[str, str, int]]:
    """Yield all cases, or those of some mistakes; with seed 1 one observation of the sound block misfits by chance."""
    for mistake, (endings, _) in MISTAKES.items():
        if not chosen or mistake in chosen:
            for ending in endings:
                yield from ((mistake, ending, seed) for seed in range(2, seeds + 2))


def main() -> None:
    """Print the cases in which following the advice does not help, and the score."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    number = well = several = 0
    for mistake, ending, seed in cases(seeds, sys.argv[2:]):
        found = followed(mistake, ending, seed)
        number, well, several = number + 1, well + found.is_well, several + (found.complaints > 1)
        mark = "well" if found.is_well else "NOT " if found.can_be_followed else "DUMB"
        sys.stdout.write(f"{mark} {found.complaints} {mistake} {ending} {seed}: {found.first[:330]}\n")
        if found.can_be_followed and not found.is_well:
            sys.stdout.write(f"     after: {found.after[:300]}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{well} of {number} end well; {several} with more than one complaint\n")


if __name__ == "__main__":
    main()
