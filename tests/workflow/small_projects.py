"""Projects that are adjusted in an instant: the one of the README, also on film and with two bundles."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]

_BLOCK = re.compile(r"^```(?:toml|text)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def first_project(folder: Path) -> Path:
    """Write the README's first project; its users copy it from there, so do the tests."""
    toml, control, measurements = _BLOCK.findall((REPOSITORY / "README.md").read_text(encoding="utf-8"))[:3]
    folder.mkdir(exist_ok=True)
    (folder / "orip.toml").write_text(toml, encoding="utf-8")
    (folder / "FIRST.PNT").write_text(control, encoding="utf-8")
    (folder / "FIRST.MEA").write_text(measurements, encoding="utf-8")
    return folder


def two_bundles(folder: Path) -> Path:
    """Write the first project with its measurements in two bundles, MAIN and AGAIN."""
    first_project(folder)
    replace_in(
        folder / "orip.toml", '[[bundle]]\nname = "MAIN"', '[[bundle]]\nname = "AGAIN"\n[[bundle]]\nname = "MAIN"'
    )
    log = (folder / "FIRST.MEA").read_text()
    (folder / "SECOND.MEA").write_text(log.replace("POINTS MAIN", "POINTS AGAIN"))
    return folder


def film_project(folder: Path) -> Path:
    """Write the first project as if taken on film: fiducial marks, measured on a plate 100 mm away."""
    first_project(folder)
    marks = {"1": (-18.0, -12.0), "2": (18.0, -12.0), "3": (18.0, 12.0), "4": (-18.0, 12.0)}
    fiducials = ", ".join(f'{{ name = "{name}", x = {x}, y = {y} }}' for name, (x, y) in marks.items())
    toml = (folder / "orip.toml").read_text()
    toml = re.sub(r"^sensor = .*$", f"fiducials = [{fiducials}]", toml, flags=re.MULTILINE)
    (folder / "orip.toml").write_text(toml.replace('"0.5px"', "0.003"))
    lines: list[str] = []
    for line in (folder / "FIRST.MEA").read_text().splitlines():
        fields = line.split()
        if fields[0] == "POINTS":
            lines += [f"PHOTO {fields[2]} A", *(f"{name} {x + 100} {y + 100}" for name, (x, y) in marks.items()), line]
        else:
            column, row = map(float, fields[1:])
            lines.append(f"{fields[0]} {(column - 3000) * 0.006 + 100:.4f} {100 - (row - 2000) * 0.006:.4f}")
    (folder / "FIRST.MEA").write_text("\n".join(lines) + "\n")
    return folder


def many_bundles(folder: Path, names: Sequence[str]) -> Path:
    """Give a project of this module, which has the bundle MAIN, bundles of these names instead, all measured alike."""
    toml, log = (folder / "orip.toml").read_text(), (folder / "FIRST.MEA").read_text()
    bundle = toml[toml.index("[[bundle]]") :]
    texts = [bundle.replace('"MAIN"', f'"{name}"') for name in names]
    (folder / "orip.toml").write_text(toml.replace(bundle, "\n".join(texts)))
    (folder / "FIRST.MEA").write_text("".join(log.replace("MAIN", name) for name in names))
    return folder


def replace_in(path: Path, old: str, new: str) -> None:
    """Change a text file; the old text has to be there."""
    text = path.read_text(encoding="utf-8")
    assert old in text, f"{old!r} is not in {path.name}"
    path.write_text(text.replace(old, new), encoding="utf-8")


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file, by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


Point = tuple[str, str, float, float]
"""Photo, name and coordinates as in the log."""


def without_points(folder: Path) -> list[Point]:
    """Take the photo points out of the log of a project, and return them."""
    found: list[Point] = []
    log = folder / "FIRST.MEA"
    kept, photo = [], ""
    for line in log.read_text(encoding="utf-8").splitlines():
        words = line.split("!")[0].split()
        if words[:1] == ["POINTS"]:
            photo = words[2]
        elif photo and words:
            found.append((photo, words[0], float(words[1]), float(words[2])))
        else:
            kept.append(line)
    log.write_text("\n".join([*kept, ""]), encoding="utf-8")
    return found
