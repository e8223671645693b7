"""The report of the last adjustment as `orip screen` serves it: what it names leads to its place in the images."""

from __future__ import annotations

import threading
from html import escape
from pathlib import Path

from orip.errors import OripError
from orip.records.definition import ProjectDefinition
from orip.report.page import report_page
from orip.structs import replace
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.adjust.report import REPORTED_FROM, report_input
from orip.workflow.project.bundle_state import read_bundle
from orip.workflow.status import STATUS_FROM, initialise_step, measure_step, solve_step

SCREEN = "./"
"""Address of the page of the screen, from that of the report."""

_NO_REPORT = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<link rel="icon" href="data:,">
<title>No report</title>
<style>:root { color-scheme: light dark; } body { font: 17px/1.5 system-ui, sans-serif; margin: 2rem; }</style>
</head>
<body>
<main><h1>No report</h1><p style="white-space: pre-line">{fault}</p><p><a href="{screen}">Images</a></p></main>
</body>
</html>
"""


class ServedReport:
    """Makes the report when it is asked for, again when there is another adjustment; for several threads.

    Parameters
    ----------
    folder : Path
        Of the project.
    bundle : str
    """

    def __init__(self, folder: Path, bundle: str) -> None:
        self._folder, self._bundle = folder, bundle
        self._lock = threading.Lock()
        self._made: tuple[tuple[str, str, ProjectDefinition] | None, str] = (None, "")

    def __call__(self) -> str:
        """Return the page; where there is no report, one that says why."""
        with self._lock:
            try:
                return self._page()
            except OripError as fault:
                return _NO_REPORT.replace("{screen}", SCREEN).replace("{fault}", escape(str(fault)))

    def _page(self) -> str:
        bundle = read_bundle(self._folder, self._bundle, *STATUS_FROM)
        head, notice = bundle.state.head(bundle.name), ""
        for step in (initialise_step(bundle.state), measure_step(bundle.state), solve_step(bundle)):
            if step.state != "up to date" and not notice:
                notice = f"This is the last adjustment, which is out of date ({step.text}): orip run makes the next."
        made_from = ("" if head is None else head.run, notice, bundle.project.definition)
        if made_from != self._made[0]:
            bundle = read_bundle(self._folder, self._bundle, *REPORTED_FROM, "solutions")
            gates = check_solution(bundle.adjusted, project_gates(bundle.project))
            given = report_input(bundle.state, bundle.adjusted, gates)
            self._made = made_from, report_page(replace(given, screen=SCREEN, notice=notice))
        return self._made[1]
