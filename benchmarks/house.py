"""The size of the program and how far what belongs together is apart: one row a figure, beside what it may be.

    python benchmarks/house.py

Counts what there is, how many files a reader of README.md opens to find a formula, and how many modules lie between a
command and that formula.
"""

from __future__ import annotations

import ast
import re
import tomllib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median

from msgspec import Struct

REPOSITORY = Path(__file__).resolve().parents[1]

ANNEXES = {"archive", "exchange", "multimodel", "online", "pictures", "planning", "restitution", "screen", "stations"}

WAYS: Mapping[str, tuple[str, str, int]] = {
    "collinearity": ("orip.cli.solve", "orip.geometry.perspective:perspective_with_partials", 3),
    "resection": ("orip.cli.prelim", "orip.prelim.resection.start:starting_orientations", 3),
    "weights": ("orip.cli.solve", "orip.adjustment.weights:danish_weights", 2),
    "covariance": ("orip.cli.results", "orip.bundle.results.covariance:cofactors_times", 2),
    "COLMAP camera": ("orip.exchange.commands", "orip.exchange.conversion.lens_table:LENSES", 3),
}
"""From a command to a formula, and the most files that a reader may open to find it, that of the formula included."""

LINK = re.compile(r"\]\(([^)#\s:]+)(?:#[^)]*)?\)")


class Row(Struct, frozen=True):
    """A figure, and what it may be; empty: it is only told."""

    what: str
    found: object
    may_be: str


def python_files(folder: str) -> list[Path]:
    """Return the modules below a folder of the repository."""
    return sorted((REPOSITORY / folder).rglob("*.py"))


def lines_of(files: Sequence[Path]) -> list[int]:
    """Return the numbers of lines of files."""
    return [len(path.read_text(encoding="utf-8").splitlines()) for path in files]


def name_of(path: Path) -> str:
    """Return the name of a module."""
    parts = path.relative_to(REPOSITORY).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports() -> dict[str, set[str]]:
    """Return the modules of the program with those that they import, inside functions too."""
    files = {name_of(path): path for path in python_files("orip")}
    found: dict[str, set[str]] = {}
    for name, path in files.items():
        found[name] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module in files:
                wholes = {f"{node.module}.{one.name}" for one in node.names}
                found[name] |= (wholes & files.keys()) or {node.module}
    return found


def part_of(module: str) -> str:
    """Return the annex that a module belongs to, else "kernel"."""
    part = module.split(".")[1] if "." in module else ""
    return part if part in ANNEXES else "kernel"


def arrows(graph: Mapping[str, set[str]]) -> tuple[int, int]:
    """Return how many imports there are from the kernel to annexes, and from one annex to another."""
    pairs = [(part_of(one), part_of(other)) for one, others in graph.items() for other in others]
    up = sum(one == "kernel" != other for one, other in pairs)
    return up, sum("kernel" not in (one, other) and one != other for one, other in pairs)


def links() -> dict[str, set[str]]:
    """Return README.md and the pages of docs with the files that they link to, by their paths in the repository."""
    found: dict[str, set[str]] = {}
    for page in (REPOSITORY / "README.md", *(REPOSITORY / "docs").rglob("*.md")):
        targets = {(page.parent / target).resolve() for target in LINK.findall(page.read_text(encoding="utf-8"))}
        inside = {one for one in targets if one.is_file() and one.is_relative_to(REPOSITORY)}
        found[page.relative_to(REPOSITORY).as_posix()] = {one.relative_to(REPOSITORY).as_posix() for one in inside}
    return found


def shortest_way(graph: Mapping[str, set[str]], start: str, end: str) -> list[str]:
    """Return the nodes on the shortest way along imports or links; empty if there is none."""
    before: dict[str, str | None] = {start: None}
    waiting = deque([start])
    while waiting and end not in before:
        name = waiting.popleft()
        for further in sorted(graph.get(name, ())):
            if further not in before:
                before[further] = name
                waiting.append(further)
    way: list[str] = []
    last = end if end in before else None
    while last is not None:
        way.insert(0, last)
        last = before[last]
    return way


def containers() -> list[str]:
    """Return the containers of a photo point that the architecture lists, all of which the program has to define."""
    page = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = page.partition("The way of a photo point")[2].partition("\n\n`")[0]
    named = re.findall(r"^\| `(\w+)` \|", table, flags=re.MULTILINE)
    source = "\n".join(path.read_text(encoding="utf-8") for path in python_files("orip"))
    return [name for name in named if re.search(rf"^class {name}\b", source, flags=re.MULTILINE)]


def entries() -> list[str]:
    """Return the functions with which commands and annexes read the state of a project."""
    found: set[str] = set()
    for path in python_files("orip"):
        if "workflow" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("orip.workflow.project"):
                found |= {one.name for one in node.names if one.name.startswith(("read_", "open_"))}
    return sorted(found)


def counts() -> Iterator[Row]:
    """Yield what is counted in the files."""
    program = lines_of(python_files("orip"))
    yield Row("Python lines", sum(program), "100 000")
    yield Row("modules", len(program), "520")
    yield Row("lines of the median module, of the longest", f"{median(program):.0f}, {max(program)}", "150 to 220, 400")
    c_files = [path for path in (REPOSITORY / "orip").rglob("*") if path.suffix in (".c", ".h")]
    yield Row("C lines", sum(lines_of(c_files)), "9605")
    yield Row("test lines", sum(lines_of(python_files("tests"))), "61 000")
    up, across = arrows(imports())
    yield Row("imports from the kernel to annexes, among annexes", f"{up}, {across}", "0, 0")
    text = (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")
    yield Row("import contracts", len(tomllib.loads(text)["tool"]["importlinter"]["contracts"]), "12")
    yield Row("lines of pyproject.toml", len(text.splitlines()), "400")
    yield Row("containers of a photo point", len(containers()), "9")
    yield Row("functions that read a project", ", ".join(entries()), "2")
    pages = [path.read_text(encoding="utf-8") for path in (REPOSITORY / "docs").rglob("*.md")]
    yield Row("words of docs", sum(len(page.split()) for page in pages), "55 000")


def ways() -> Iterator[Row]:
    """Yield what a reader opens to find a formula, and what lies between a command and it along imports.

    Raises
    ------
    ValueError
        If a formula is not where `WAYS` has it, or nothing leads there.
    """
    graph, pages = imports(), links()
    for what, (start, place, most) in WAYS.items():
        module, _, name = place.partition(":")
        path = f"{module.replace('.', '/')}.py"
        text = (REPOSITORY / path).read_text(encoding="utf-8")
        read, run = shortest_way(pages, "README.md", path), shortest_way(graph, start, module)
        if not read or not run or not re.search(rf"^(def |class )?{name}\b", text, flags=re.MULTILINE):
            message = f"{what}: no way from README.md and {start} to {place}"
            raise ValueError(message)
        names = " > ".join(one.removeprefix("orip.") for one in run)
        yield Row(f"files opened to find: {what}", f"{len(read)} ({' > '.join(read)})", str(most))
        yield Row(f"modules from a command to: {what}", f"{len(run)} ({names})", "")


def main() -> None:
    """Print the table."""
    rows = [*counts(), *ways()]
    width = max(len(row.what) for row in rows)
    for row in rows:
        print(f"{row.what:{width}}  {row.found}" + (f"  (at most {row.may_be})" if row.may_be else ""))


if __name__ == "__main__":
    main()
