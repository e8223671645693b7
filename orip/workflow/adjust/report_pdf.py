"""The report as PDF: Chromium, if it is installed, prints the page."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from orip.errors import OripError
from orip.files.text.atomic import replace_bytes, reporting_failure

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
    output : Path
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
