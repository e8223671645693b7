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
    """What is written: control, positions of photos, and their errors; `ending` is the file of the positions."""

    ending: str
    measured: dict[str, dict[str, tuple[float, float]]]
    control: Rows
    control_errors: Rows
    positions: Rows
    position_errors: Rows
    antenna: str = ""
    unknown: set[str] = field(default_factory=set)

    def write(self, folder: Path) -> Path:
        """Write the texts of the project."""
        control = []
        for name, xyz in self.control.items():
            values, errors = [f"{value:.4f}" for value in xyz], [f"{error:g}" for error in self.control_errors[name]]
            if name in self.unknown:
                values[2] = errors[2] = "-"
            control.append(" ".join([name, *values, *errors]))
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
    measured = images(centres, points, 150.0, 115.0, 0.005)
    rays = [name for seen in measured.values() for name in seen]
    measured = {
        photo: {name: xy for name, xy in seen.items() if rays.count(name) > 1} for photo, seen in measured.items()
    }
    control = {name: points[name] + ORIGIN + random.normal(scale=0.02, size=3) for name in CONTROL}
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


def _rows_of(project: Project, line: str) -> str:
    """Return what a line is about."""
    subject = re.sub(r"^(warning|error): ", "", line).split(":")[0]
    return "positions" if "station" in subject or "position" in subject else "control"


def follow(project: Project, truth: Project, line: str) -> bool:
    """Do what a line says, and tell whether it says anything that can be done.

    Matching positions and names again, and converting coordinates, needs the origin of the data, which `truth` stands for.
    """
    rows = _rows_of(project, line)
    of: Rows = getattr(project, rows)
    if slips := re.findall(r"\b([XYZ])0? = \S+ is probably (-?[\d.]+): ", line):
        name = re.search(r"(?:control point|exposure station) (\S+): ", line)
        if name is None:
            return False
        for axis, value in slips:
            of[name[1]]["XYZ".index(axis)] = float(value)
        return True
    if found := re.search(r"control points? (\S+) and (\S+) fit when they are exchanged", line):
        of[found[1]], of[found[2]] = of[found[2]], of[found[1]]
        return True
    if re.search(r"control point (\S+): Z = 0 was probably", line):
        project.unknown.add(re.search(r"control point (\S+): ", line)[1])  # type: ignore[index]
        return True
    if (name := re.search(r"(?:control point|exposure station) (\S+): (?:its )?X0? and Y0? .*exchang", line)) or (
        name := re.search(r"photo (\S+): .*X0 and Y0 are exchanged", line)
    ):
        of = project.positions if "photo" in line.split(":")[1] else of
        of[name[1]] = of[name[1]][[1, 0, 2]]
        return True
    if found := re.search(
        r"photo (\S+): its given position is wrong: .*?([XYZ])0 = (\S+), where the block has ([\d.]+)", line
    ):
        project.position_errors[found[1]] = -project.position_errors[found[1]]
        return True
    if re.search(r"columns X and Y", line):
        _all(
            "positions" if re.search(r"\.(STA|ELE) file|position|station", line) else "control",
            lambda xyz: xyz[[1, 0, 2]],
        )(project, np.random.default_rng())
        return True
    if re.search(r"number of a zone", line):
        for each in ("control", "positions"):
            _all(each, lambda xyz: xyz - ZONE * (xyz[0] > 1e7))(project, np.random.default_rng())
        return True
    if found := re.search(r"given ([\d.]+) m too (high|low) in Z", line):
        by = float(found[1]) * (-1.0 if found[2] == "high" else 1.0)
        _all(rows, lambda xyz: xyz + np.array([0.0, 0.0, by]))(project, np.random.default_rng())
        return True
    if "in degrees" in line or "those of other photos" in line or "moved by one photo" in line:
        project.positions = dict(truth.positions)
        return True
    if found := re.search(r"photos (\S+) and (\S+) are exchanged", line):
        project.positions[found[1]], project.positions[found[2]] = (
            project.positions[found[2]],
            project.positions[found[1]],
        )
        return True
    if found := re.search(r"exposure stations (\S+) and (\S+) fit when they are exchanged", line):
        project.positions[found[1]], project.positions[found[2]] = (
            project.positions[found[2]],
            project.positions[found[1]],
        )
        return True
    if found := re.search(r"(Z )?(?:fits?|are near|fits when|is|.*?) ?(?:when )?(Z is )?multiplied by ([\d.]+)", line):
        factor = float(found[3])
        of_z = bool(re.search(r"\bZ (is multiplied|fits)", line))
        factors = np.array([1.0, 1.0, factor]) if of_z else np.full(3, factor)
        exact = {0.3048: FOOT}.get(factor, factor)
        factors[factors == factor] = exact
        _all(rows, lambda xyz: xyz * factors)(project, np.random.default_rng())
        return True
    if found := re.search(r"(?:reverse the sign of|with) ([XYZ])\b|([XYZ]) has the opposite sign", line):
        axis = "XYZ".index(found[1] or found[2])
        signs = np.where(np.arange(3) == axis, -1.0, 1.0)
        _all(rows, lambda xyz: xyz * signs)(project, np.random.default_rng())
        return True
    if re.search(r"these seem to be in mm", line):
        which = "position_errors" if rows == "positions" else "control_errors"
        _all(which, lambda errors: errors / 1000.0)(project, np.random.default_rng())
        return True
    if re.search(r"these seem to be in cm", line):
        which = "position_errors" if rows == "positions" else "control_errors"
        _all(which, lambda errors: errors / 100.0)(project, np.random.default_rng())
        return True
    if "differ by a hyphen alone" in line:
        for which in ("control", "control_errors"):
            setattr(project, which, {name.replace("-", ""): xyz for name, xyz in getattr(project, which).items()})
        return True
    if "make their errors negative" in line or "make its errors negative" in line:
        names = re.search(r"exposure stations? (.*?):", line)[1]  # type: ignore[index]
        wrong = [
            name for name in truth.positions if np.abs(project.positions[name] - truth.positions[name]).max() > 0.1
        ]
        listed = [name for name in re.split(r", | and ", names) if name in project.positions]
        for name in wrong if "more" in names else listed:
            project.position_errors[name] = -project.position_errors[name]
        return True
    if found := re.search(r"set (lever_arm|shift) = (.*?) in \[\[antenna\]\]", line):
        project.antenna = f'[[antenna]]\nname = "GNSS"\n{found[1]} = {found[2]}\n'
        return True
    if found := re.search(r"control point (\S+): its coordinates contradict the photos", line):
        project.control_errors[found[1]] = -project.control_errors[found[1]]
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
    """What was said first of a mistake, and how many complaints; whether it could be followed, and what came of it."""

    first: str
    complaints: int
    can_be_followed: bool
    is_well: bool
    after: str


def followed(mistake: str, ending: str, seed: int) -> Followed | None:
    """Plant a mistake, do what is said first of it, and run again; None where nothing was said."""
    project, truth = sound(ending, seed), sound(ending, seed)
    MISTAKES[mistake][1](project, np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as folder:
        said = orip(project.write(Path(folder) / "before"), "run", "--no-report")
        first = said_first(said)
        if is_well(said):
            return Followed(first, 0, True, True, "")
        complaints = len(re.findall("^(?:error|warning): ", said.told, re.MULTILINE))
        can = follow(project, truth, first)
        after = orip(project.write(Path(folder) / "after"), "run", "--no-report") if can else said
    return Followed(first, complaints, can, can and is_well(after), said_first(after))


def cases(seeds: int, chosen: list[str]) -> Iterator[tuple[str, str, int]]:
    """Yield all cases, or those of some mistakes."""
    for mistake, (endings, _) in MISTAKES.items():
        if not chosen or mistake in chosen:
            for ending in endings:
                yield from ((mistake, ending, seed) for seed in range(1, seeds + 1))


def main() -> None:
    """Print the cases in which following the advice does not help, and the score."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 1
    number = well = several = 0
    for mistake, ending, seed in cases(seeds, sys.argv[2:]):
        found = followed(mistake, ending, seed)
        number, well, several = number + 1, well + found.is_well, several + (found.complaints > 1)
        mark = "well" if found.is_well else "NOT " if found.can_be_followed else "DUMB"
        print(f"{mark} {found.complaints} {mistake} {ending} {seed}: {found.first[:330]}", flush=True)
        if found.can_be_followed and not found.is_well:
            print(f"     after: {found.after[:300]}", flush=True)
    print(f"{well} of {number} end well; {several} with more than one complaint")


if __name__ == "__main__":
    main()
