"""`orip report`: the report of the last adjustment of a bundle, and its print as PDF."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from msgspec import Struct

from orip.annexes import PICTURES_OF_REPORT, annex
from orip.errors import OripError, UsageError
from orip.files.text.atomic import replace_bytes, reporting_failure
from orip.progress import stage
from orip.records.results.solution import Solution
from orip.records.results.tests import GateResult
from orip.report.client import certificate_page, client_page
from orip.report.page import report_page
from orip.report.report_input import PictureSource, ReportInput
from orip.report.run_mark import run_of_page
from orip.structs import replace
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.images import image_warnings, usable_images
from orip.workflow.project.outputs import TextOutput, first_bytes, require_replaceable
from orip.workflow.project.state import Part, ProjectState
from orip.workflow.project.texts import Digests, is_measurement_file

REPORTED_FROM: tuple[Part, ...] = ("definitions", "replay")
"""What a report needs of the stores besides the solution."""

_REMEDY = "the page alone is missing; remove the cause, or choose another file: orip report --output FILE"


class WrittenReport(Struct, frozen=True):
    """A report: its bundle and run, its path, that as messages show it, and its size in bytes."""

    bundle: str
    run: str
    path: Path
    shown: str
    size: int


ReportKind = Literal["full", "client", "certificate"]
"""The report for who checks the work, that for the client, and the certificate of cameras that were calibrated."""


def report(
    bundle: BundleState,
    output: Path | None,
    *,
    force: bool = False,
    kind: ReportKind = "full",
    pictures: bool = True,
) -> Change[WrittenReport]:
    """Make the report of the last adjustment of a bundle, with the gates of orip.toml.

    Parameters
    ----------
    bundle : BundleState
        With `REPORTED_FROM` and solutions.
    output : Path or None
        None: report.html in the project folder, NAME_report.html where there are several bundles.
    force : bool
        Also in the place of a file that is no earlier report.
    kind : {"full", "client", "certificate"}
    pictures : bool
        With pictures of the photos whose images are there.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, a gate of orip.toml is malformed, or no camera of a certificate was
        calibrated.
    UsageError
        If another file would be replaced.
    """
    gates = check_solution(bundle.adjusted, project_gates(bundle.project))
    change = report_of(bundle.state, bundle.adjusted, gates, output, kind, pictures=pictures)
    usual = (bundle.project.report(bundle.name, kind),)
    for written in change.outputs:
        begins = first_bytes(written.pieces())
        require_replaceable(bundle.project, written.path, force=force, usual=usual, begins=begins)
    return change


def report_of(
    state: ProjectState,
    solution: Solution,
    gates: Iterable[GateResult],
    output: Path | None = None,
    kind: ReportKind = "full",
    *,
    pictures: bool = True,
) -> Change[WrittenReport]:
    """Make the report of a solution, which need not be stored; the state has `REPORTED_FROM`."""
    project = state.project
    path = output if output is not None else project.report(solution.bundle, kind)
    given = report_input(state, solution, gates)
    with stage("report"):
        text = _PAGES[kind](given if pictures else replace(given, pictures=None))
    written = WrittenReport(solution.bundle, solution.run, path, project.shown(path), len(text.encode()))
    return Change(state, written, outputs=(TextOutput(path, lambda: [text], _REMEDY),))


def report_input(state: ProjectState, solution: Solution, gates: Iterable[GateResult] = ()) -> ReportInput:
    """Return what a report of a solution is made from; the state has `REPORTED_FROM`."""
    bundle, header = state.definitions.bundle(solution.bundle), state.project.definition
    records = state.records.with_cameras_of(bundle)
    folder, photos = state.project.folder, records.photos.values()
    return ReportInput(
        solution, tuple(gates), bundle, records.cameras, records.photos,
        records.templates, header.report, header.crs, _measurement_files(state), header.test_level,
        image_warnings(folder, photos, records.cameras), _pictures(usable_images(folder, photos, records.cameras)),
    )  # fmt: skip


def _pictures(images: Mapping[str, Path]) -> PictureSource | None:
    """Return what makes the pictures of the report; None where no photo has an image."""
    if not images:
        return None
    source: PictureSource = annex(PICTURES_OF_REPORT).picture_source(images)
    return source


def write_report(given: ReportInput, path: Path, kind: ReportKind = "full") -> Path:
    """Write a report to a file that the user names: HTML, or PDF where it ends so; an earlier one is replaced.

    Raises
    ------
    UsageError
        If another file has this name, or there is no such kind.
    OripError
        If it cannot be written, or no browser is there to print it.
    """
    if kind not in _PAGES:
        message = f"there is no report {kind!r}; there are: {', '.join(_PAGES)}"
        raise UsageError(message)
    is_pdf = path.suffix.lower() == ".pdf"
    if path.exists() and not _is_earlier(path, is_pdf=is_pdf):
        message = f"{path} is there, and is no report of orip; name another file, or remove it"
        raise UsageError(message)
    text = _PAGES[kind](given)
    if is_pdf:
        with TemporaryDirectory(prefix="orip-") as folder:
            page = Path(folder) / path.with_suffix(".html").name
            page.write_text(text, encoding="utf-8", newline="")
            print_pdf(page, path, str(path))
    else:
        with reporting_failure(str(path), "name another file"):
            replace_bytes(path, text.encode())
    return path


def _is_earlier(path: Path, *, is_pdf: bool) -> bool:
    """Tell whether a file is an earlier report: a page with the mark of its run, or a PDF made by a browser."""
    with reporting_failure(str(path), "name another file"), path.open("rb") as file:
        head = file.read(_HEAD)
    return head.startswith(b"%PDF") if is_pdf else run_of_page(head.decode("utf-8", "replace")) is not None


_HEAD = 2000
"""Bytes at the beginning of a page that have the mark of its run."""

_PAGES: Mapping[ReportKind, Callable[[ReportInput], str]] = {
    "full": report_page,
    "client": client_page,
    "certificate": certificate_page,
}


def _measurement_files(state: ProjectState) -> Digests:
    """Return the measurement files that were replayed last, with their digests."""
    project = state.project
    return tuple((name, digest) for name, digest in state.replay.inputs if is_measurement_file(project, Path(name)))


BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
"""Programs that print a page by the same options."""

_SECONDS = 300.0
_OPTIONS = (
    "--headless=new --no-first-run --disable-background-networking --disable-component-update --disable-sync "
    "--no-pdf-header-footer --use-angle=swiftshader --enable-unsafe-swiftshader --virtual-time-budget=8000"
)
"""The time is the page's: enough for the view in three dimensions, which the processor draws."""


def print_pdf(page: Path, output: Path, shown: str) -> int:
    """Print a report to PDF and return its size in bytes.

    Parameters
    ----------
    page : Path
        The report, HTML.
    shown : str
        The output as messages call it.

    Raises
    ------
    OripError
        If no browser is installed, it fails, or the file cannot be written.
    """
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        message = (
            f"{shown} was not written: no Chromium, Chrome or Edge was found to print it; install chromium, or open "
            f"{page.name} in any browser and print it"
        )
        raise OripError(message)
    with TemporaryDirectory(prefix="orip-") as folder:
        printed = Path(folder) / "report.pdf"
        command = [program, *_OPTIONS.split(), f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium's own sandbox does not start for root
        fault = _run([*command, page.resolve().as_uri()])
        if not printed.is_file():
            message = f"{shown} was not written: {Path(program).name} failed ({fault}); open {page.name} and print it"
            raise OripError(message)
        data = printed.read_bytes()
    with reporting_failure(shown, "remove the cause, or choose another file: orip report --pdf --output FILE"):
        replace_bytes(output, data)
    return len(data)


def _run(command: list[str]) -> str:
    """Run a program, and return what it says if it fails."""
    try:
        # the program is found on PATH by a fixed name, the page is our own
        done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return f"it did not end within {_SECONDS:g} s"
    except OSError as error:
        return error.strerror or str(error)
    return done.stderr.strip().rpartition("\n")[2] or f"exit code {done.returncode}"
