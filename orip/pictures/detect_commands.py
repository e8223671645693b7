"""`orip detect`: targets in pictures."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, cast, get_args

import typer

from orip.cli.options import DryRunOption, ForceOption, Invocation, add_group, command
from orip.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from orip.cli.terminal import Terminal
    from orip.pictures.detection import Detected, DetectedPhoto, Detection
    from orip.pictures.targets.boards import Board
    from orip.pictures.targets.marks import FoundTargets
    from orip.records.control import ControlDistance, ControlPoint
    from orip.workflow.project.state import ProjectState

Images = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[IMAGES]...", help="Files named as their photos, or folders; else those of 'image'."),
]

Kind = Literal["charuco", "chess", "circles", "tags", "rings"]
Control = Literal["points", "distances", "none"]


class MarkOptions(NamedTuple):
    """Options of what is written of the marks."""

    bundle: Annotated[
        str | None, typer.Option("--bundle", metavar="NAME", help="Bundle of the points; else the only one.")
    ] = None
    output: Annotated[
        Path, typer.Option("--output", metavar="FILE", help="Measurement file; an earlier one of detect is replaced.")
    ] = Path("DETECTED.MEA")
    least_error: Annotated[
        float, typer.Option("--least-error", metavar="PIXELS", help="Added in quadrature to the errors of marks.")
    ] = 0.05
    replace: Annotated[bool, typer.Option("--replace", help="Replace a measurement file of other origin.")] = False
    dry_run: DryRunOption = False


class BoardOptions(NamedTuple):
    """Options that describe a board."""

    kind: Annotated[
        str, typer.Option("--kind", metavar="KIND", help=f"What is on the board: {', '.join(get_args(Kind))}.")
    ] = "charuco"
    size: Annotated[
        str, typer.Option("--size", metavar="COLUMNSxROWS", help="Squares, circles, tags or coded dots.")
    ] = "9x6"
    square: Annotated[
        float, typer.Option("--square", metavar="MM", help="Side of a square; from tag to tag; from row to row.")
    ] = 30.0
    tag: Annotated[
        float | None,
        typer.Option("--tag", metavar="MM", help="Side of a tag, diameter of a circle or ring; else 0.7 squares."),
    ] = None
    dictionary: Annotated[
        str | None,
        typer.Option(
            "--dictionary", metavar="NAME", help="Of the tags, as OpenCV calls it; of rings RINGS_16, RINGS_20."
        ),
    ] = None
    first_tag: Annotated[
        int, typer.Option("--first-tag", metavar="NUMBER", help="Number of the first tag of the board.")
    ] = 0
    prefix: Annotated[str, typer.Option("--prefix", metavar="TEXT", help="Of the names of points.")] = ""


class ScaleOptions(NamedTuple):
    """Options of what becomes of the size of a board."""

    control: Annotated[
        str,
        typer.Option("--control", metavar="WHAT", help=f"Its size into the control: {', '.join(get_args(Control))}."),
    ] = "points"
    board_error: Annotated[
        float, typer.Option("--board-error", metavar="MM", help="A-priori error of its coordinates or distances.")
    ] = 0.1
    print_to: Annotated[
        Path | None, typer.Option("--print", metavar="FILE", help="Draw the board to scale instead: .svg or .pdf.")
    ] = None
    force: ForceOption = False


def register(app: typer.Typer) -> None:
    """Add the group of commands."""
    text = "Targets in pictures: boards, tags, sheets of coded dots.\n\nExample: orip detect board PICTURES"
    add_group(app, "detect", text, _register)


def _register(group: typer.Typer) -> None:
    _register_board(group)
    _register_tags(group)
    _register_sheet(group)


def _register_board(group: typer.Typer) -> None:
    @command(group, "board")
    def board_command(
        invocation: Invocation, board: BoardOptions, scale: ScaleOptions, marks: MarkOptions, images: Images = None
    ) -> None:
        """Find a printed board: chequers with or without tags, rows of tags, circles or coded dots; or print one.

        Points are called by row and column (R2C5), corners of tags by tag (TAG7-1), coded dots by code (CODE7).

        Example: orip detect board PICTURES --kind charuco --size 9x6 --square 30 --tag 21
        """
        described = _board(board)
        if scale.print_to is not None:
            _print_board(invocation, described, scale.print_to, force=scale.force)
            return
        from orip.pictures.detection import control_of_board
        from orip.pictures.targets.found_boards import find_board
        from orip.pictures.targets.printing import describe_board

        control = _one_of("--control", scale.control, get_args(Control))
        if not scale.board_error > 0.0:
            message = f"--board-error {scale.board_error:g}: write millimetres above 0"
            raise UsageError(message)

        def lines(unit: str) -> tuple[ControlPoint, ...] | tuple[ControlDistance, ...]:
            return control_of_board(described, cast("Control", control), scale.board_error, unit)

        find = partial(find_board, board=described)
        _detect(invocation, describe_board(described), find, images, marks, lines)


def _register_tags(group: typer.Typer) -> None:
    @command(group, "tags")
    def tags_command(
        invocation: Invocation,
        marks: MarkOptions,
        images: Images = None,
        dictionary: Annotated[
            str,
            typer.Option("--dictionary", metavar="NAME", help="As OpenCV calls it; of coded dots RINGS_16, RINGS_20."),
        ] = "APRILTAG_36H11",
        prefix: Annotated[str, typer.Option("--prefix", metavar="TEXT", help="Of the names of points.")] = "",
    ) -> None:
        """Find all tags of a dictionary, wherever they are: corners TAG7-1 to TAG7-4; coded dots of rings CODE7.

        Example: orip detect tags PICTURES --dictionary APRILTAG_36H11
        """
        from orip.pictures.targets.boards import dictionaries
        from orip.pictures.targets.coded_dots import FAMILIES
        from orip.pictures.targets.found_boards import find_tags

        name = _one_of("--dictionary", dictionary.upper(), (*dictionaries(), *FAMILIES))
        find = partial(find_tags, dictionary=name, prefix=prefix)
        _detect(invocation, f"tags {name}", find, images, marks)


def _register_sheet(group: typer.Typer) -> None:
    @command(group, "sheet")
    def sheet_command(
        invocation: Invocation,
        points: Annotated[Path, typer.Argument(metavar="POINTS", help="Coordinates of the dots, a .PNT file.")],
        marks: MarkOptions,
        images: Images = None,
        rings: Annotated[
            str, typer.Option("--rings", metavar="NAMES", help="Dots with rings of 1, 2, 3 ... parts; or NAME=PARTS.")
        ] = "",
        radius: Annotated[
            float | None, typer.Option("--radius", metavar="LENGTH", help="Of the dots; corrects their eccentricity.")
        ] = None,
    ) -> None:
        """Find the dots of a sheet on which some have rings.

        Example: orip detect sheet SHEET.PNT PICTURES --rings 1001,1002,1003,1004
        """
        from orip.pictures.detection import read_sheet
        from orip.pictures.targets.sheets import find_sheet

        if radius is not None and not radius > 0.0:
            message = f"--radius {radius:g}: write a length above 0, in ground units"
            raise UsageError(message)
        sheet = read_sheet(invocation.folder / points, str(points), _rings(rings), radius)
        find = partial(find_sheet, sheet=sheet)
        _detect(invocation, f"sheet of {len(sheet.names)} dots, {points.name}", find, images, marks)


def _board(options: BoardOptions) -> Board:
    from orip.pictures.targets.boards import Board, check_board

    kind = _one_of("--kind", options.kind, get_args(Kind))
    columns, x, rows = options.size.lower().partition("x")
    if not (x and columns.isdecimal() and rows.isdecimal() and len(options.size) < 10):
        message = f"--size {options.size}: write columns and rows such as 9x6"
        raise UsageError(message)
    has_tags = kind in {"charuco", "tags", "rings"}
    usual = "RINGS_16" if kind == "rings" else "5X5_100"
    tag = 0.0 if kind == "chess" else 0.7 * options.square if options.tag is None else options.tag
    board = Board(
        cast("Kind", kind), int(columns), int(rows), options.square, tag,
        (options.dictionary or usual).upper() if has_tags else "", options.first_tag if has_tags else 0, options.prefix,
    )  # fmt: skip
    check_board(board)
    return board


def _one_of(option: str, word: str, known: tuple[str, ...]) -> str:
    if word not in known:
        message = f"{option} {word}: write one of {', '.join(known)}"
        raise UsageError(message)
    return word


def _rings(text: str) -> list[tuple[str, int]]:
    rings = []
    for number, word in enumerate(text.split(","), start=1):
        name, equals, parts = word.strip().partition("=")
        if not name or (equals and not (parts.isdecimal() and 0 < int(parts[:3]) <= 12)):
            message = f"--rings {text}: write names of dots, or NAME=PARTS with 1 to 12 parts, with commas between them"
            raise UsageError(message)
        rings.append((name, int(parts) if equals else number))
    return rings


def _print_board(invocation: Invocation, board: Board, path: Path, *, force: bool) -> None:
    from orip.files.text.atomic import write_output
    from orip.pictures.targets.printing import describe_board, pdf_bytes, svg_text

    ending = path.suffix.lower()
    if ending not in {".svg", ".pdf"}:
        message = f"--print {path}: write a name that ends in .svg or .pdf"
        raise UsageError(message)
    target = invocation.folder / path
    if target.exists() and not force:
        message = f"{path} already exists; name another file, or replace it with --force"
        raise UsageError(message)
    write_output(target, svg_text(board) if ending == ".svg" else pdf_bytes(board))
    if invocation.terminal.json:
        content = {"file": str(path), "photos": [], "files": [str(path)], "dry_run": False}
        invocation.terminal.document("detect", {"command": "detect", **content})
    invocation.terminal.say(f"detect   {describe_board(board)} drawn to scale: {path}")
    invocation.terminal.say("         print it at 100 %, and measure the line of 100 mm below it")


def _detect(
    invocation: Invocation,
    what: str,
    find: Callable[[Any], FoundTargets],
    images: list[Path] | None,
    marks: MarkOptions,
    control: Callable[[str], tuple[ControlPoint, ...] | tuple[ControlDistance, ...]] | None = None,
) -> None:
    from orip.pictures.detection import Detection, detect
    from orip.workflow.project.commit import carry_out
    from orip.workflow.records.commands import read_records

    if not 0.0 <= marks.least_error < 1e6:
        message = f"--least-error {marks.least_error:g}: write pixels, 0 or above"
        raise UsageError(message)
    state: ProjectState = read_records(invocation.folder)
    lines = () if control is None else control(state.project.definition.ground_unit)
    detection: Detection = Detection(
        what, find, tuple(images or ()), marks.bundle, marks.output, marks.least_error, lines, marks.replace
    )
    edit = partial(detect, detection=detection, dry_run=marks.dry_run)
    tell(invocation.terminal, carry_out(state, edit).outcome)


def tell(terminal: Terminal, outcome: Detected) -> None:
    """Print what was detected, and what was rejected in each photo."""
    if terminal.json:
        photos = [_row(one) for one in outcome.photos]
        files = {"files": list(outcome.files), "dry_run": outcome.dry_run}
        terminal.document("detect", {"command": "detect", "file": outcome.files[0], "photos": photos, **files})
        return
    for one in outcome.photos:
        terminal.say(f"         {one.photo}: {one.found.fault or _counted(one)}")
    count = sum(len(one.found.marks) for one in outcome.photos)
    seen = sum(bool(one.found.marks) for one in outcome.photos)
    would = "would be " if outcome.dry_run else ""
    terminal.say(
        f"detect   {count} marks in {seen} of {len(outcome.photos)} photos {would}written to {outcome.files[0]}"
    )
    for further in outcome.files[1:]:
        terminal.say(f"         size of the board {would}added to {further}")


def _counted(one: DetectedPhoto) -> str:
    reasons: dict[str, list[str]] = {}
    for item in one.found.rejected:
        reasons.setdefault(item.reason, []).append(item.name or f"({item.column:.0f}, {item.row:.0f})")
    parts = [f"{len(one.found.marks)} marks"]
    for reason, names in reasons.items():
        more = f" and {len(names) - 8} more" if len(names) > 8 else ""
        parts.append(f"{reason}: {' '.join(names[:8])}{more}")
    return "; ".join(parts)


def _row(one: DetectedPhoto) -> dict[str, Any]:
    rejected = [
        {"name": item.name, "column": item.column, "row": item.row, "reason": item.reason}
        for item in one.found.rejected
    ]
    return {
        "photo": one.photo, "image": one.image, "marks": len(one.found.marks), "fault": one.found.fault,
        "rejected": rejected,
    }  # fmt: skip
