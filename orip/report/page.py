"""The report page: all sections put into the template, with everything that the browser needs."""

from __future__ import annotations

import base64
import hashlib
import re
import shlex
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from markupsafe import Markup, escape

from orip.bundle.verdict import GlobalTest, sigma0_test
from orip.errors import ProjectWarning, by_kind
from orip.records.results.solution import Solution
from orip.report.calibration import STRONG, camera_sheets
from orip.report.control_points import compared_table, distance_table, group_table, model_grid
from orip.report.drawings.block_plan import MOST_OVERLAP, block_plan
from orip.report.drawings.block_view import block_view
from orip.report.drawings.ellipses import ellipse_views
from orip.report.drawings.residual_vectors import photo_anchors, vector_sheets
from orip.report.drawings.svg import drawing, element, number, text
from orip.report.first_page import gate_table, key_numbers, method_facts, order_facts, verdict
from orip.report.photos import (
    motion_table,
    mounting_table,
    photo_residual_table,
    residual_histograms,
    rig_table,
    station_charts,
    station_table,
    strip_table,
)
from orip.report.pictures import Chip, report_pictures
from orip.report.precision import (
    antenna_table,
    convergence_charts,
    figure_table,
    iteration_table,
    photo_table,
    point_table,
    spreads,
    variance_component_table,
    zero_direction_table,
)
from orip.report.report_input import CHIP_PIXELS, ReportInput
from orip.report.run_mark import RUN_NAME
from orip.report.table import counted
from orip.report.templates import kept, rendered, template_source
from orip.report.trouble import blunder_table, singular_table, suspect_table, weak_table, worst_in_photo
from orip.version import __version__

_TIMES = 2.0
_ARM, _GAP, _RADIUS = 14.0, 4.0, 6.0
_ROOM_FOR_WORDS = 30.0


def chip_drawings(given: ReportInput, chips: Sequence[Chip]) -> tuple[Markup, ...]:
    """Return a drawing of each chip: a cross at the measured place, a ring at the adjusted one."""
    return tuple(_leading(_drawing(chip), given.place(chip.photo, chip.point)) for chip in chips)


def _leading(picture: Markup, address: str) -> Markup:
    """Return a drawing that is a link where there is an address."""
    return Markup('<a href="{}">{}</a>').format(address, picture) if address else picture


def _drawing(chip: Chip) -> Markup:
    side = CHIP_PIXELS * _TIMES
    off = float(np.hypot(*(chip.adjusted - chip.measured)))
    size = f"{off:.2f} px" if off < 10.0 else f"{off:.0f} px"
    tested = f"v {size}, w {chip.w:.1f}" if np.isfinite(chip.w) else f"v {size}"
    label = f"Point {chip.point} in photo {chip.photo}: {tested}"
    parts = [*_chip_parts(chip, side), text(0.0, side + 12.0, f"{chip.point} in {chip.photo}", class_="label")]
    return drawing(side, side + _ROOM_FOR_WORDS, label, [*parts, text(0.0, side + 26.0, tested)], "chip")


def _chip_parts(chip: Chip, side: float) -> Iterator[str]:
    yield element("image", href=chip.address, x=0, y=0, width=side, height=side, preserveAspectRatio="none")
    (x, y), (u, v) = (place * _TIMES for place in (chip.measured, chip.adjusted))
    arms = "".join(
        f"M{number(x + _GAP * dx)} {number(y + _GAP * dy)}l{number(_ARM * dx)} {number(_ARM * dy)}"
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    # each line twice: dark below light, so that it is seen on any ground
    for style in ("below", "measured"):
        yield element("path", d=arms, class_=style)
    u, v = (min(max(float(place), _RADIUS), side - _RADIUS) for place in (u, v))
    for style in ("below", "adjusted"):
        yield element("circle", cx=u, cy=v, r=_RADIUS, class_=style)


_NAMED_PLACE = re.compile(r"(?:photo (\S+))?(?: ?(?:control )?point (\S+))?")


def _named_place(given: ReportInput, where: str) -> Markup:
    """Return what a finding is about: a link where that is a photo or a point, and the page has such links."""
    found = _NAMED_PLACE.fullmatch(where)
    return _leading(escape(where), given.place(found[1] or "", found[2] or "") if found else "")


MOST_BYTES = 6_000_000
"""Largest size of a page; for 500 photos and 50 000 points it is kept by drawing and listing fewer of them."""

_COMPRESSION = 4


def report_page(given: ReportInput) -> str:
    """Return the report as one HTML page that loads nothing."""
    script = f"\n{template_source('report.js')}\n"
    content = {"script": Markup(script), "policy": _policy(script), **_content(given)}
    return rendered("report.html", content)


def _content(given: ReportInput) -> dict[str, Any]:
    solution = given.solution
    pictures = report_pictures(given)
    vectors = vector_sheets(given, thumbnails=pictures.thumbnails)
    anchors = photo_anchors(vectors)
    links = {name: given.place(name) or f"#{at}" for name, at in anchors.items()}
    worst = worst_in_photo(given) if given.pictures is not None else ""
    return {
        "version": __version__,
        "run_name": RUN_NAME,
        "solution": solution,
        "details": given.details,
        "order": order_facts(given),
        "method": method_facts(given),
        "plan": block_plan(given),
        "most_overlap": MOST_OVERLAP,
        "bundle": given.bundle,
        "precision": f"{given.bundle.measurement_precision.value:g} {given.bundle.measurement_precision.unit}",
        **_trust(given),
        **_observations(given, links),
        **_unknowns(given, links),
        "vectors": vectors,
        "anchors": anchors,
        "pictures": pictures.note,
        "drawn": {name: _leading(picture, given.place(name)) for sheet in vectors for name, picture in sheet.photos},
        "led_to": partial(_named_place, given),
        "screen": given.screen,
        "notice": given.notice,
        "look": f"orip screen --at {shlex.quote(worst)}" if worst else "",
        "chips_of_control": chip_drawings(given, pictures.of_control),
        "chips_of_worst": chip_drawings(given, pictures.of_worst),
        "strong": STRONG,
        "block": _as_data(block_view(given)),
        "size": _size(solution),
        "inputs": tuple(dict((*given.replayed, *solution.inputs)).items()),
        "plotly": _plotly(),
        "convergence": convergence_charts(given),
        "iterations": iteration_table(solution),
        "models": model_grid(given.bundle),
    }


def _trust(given: ReportInput) -> dict[str, Any]:
    """Return what tells whether the result can be trusted."""
    test = sigma0_test(given.solution)
    return {
        "warnings": by_kind([*(ProjectWarning(*row) for row in given.solution.warnings), *given.image_warnings]),
        "key_numbers": key_numbers(given),
        "test": test if isinstance(test, GlobalTest) else None,
        "verdict": verdict(given, test),
        "gates": gate_table(given),
    }


def _observations(given: ReportInput, links: Mapping[str, str]) -> dict[str, Any]:
    """Return what the residuals show: how well the observations fit, and which do not."""
    solution = given.solution
    return {
        "groups": group_table(solution),
        "histograms": residual_histograms(solution),
        "photo_residuals": photo_residual_table(given, links),
        "variance_components": variance_component_table(solution),
        "control_points": compared_table(given, "control"),
        "check_points": compared_table(given, "check"),
        "distances": distance_table(solution),
        "trouble": [
            table
            for table in (
                blunder_table(given),
                suspect_table(given, links),
                singular_table(solution),
                weak_table(given),
            )
            if table is not None
        ],
        "station_charts": station_charts(solution),
    }


def _unknowns(given: ReportInput, links: Mapping[str, str]) -> dict[str, Any]:
    """Return the adjusted unknowns and their precision."""
    solution = given.solution
    return {
        "spreads": spreads(solution),
        "points": point_table(given),
        "photos": photo_table(solution, links),
        "zero_directions": zero_direction_table(solution),
        "figures": figure_table(solution),
        "antennas": antenna_table(solution),
        "stations": station_table(solution),
        "strips": strip_table(solution),
        "ellipses": ellipse_views(solution),
        "cameras": camera_sheets(given),
        "rigs": rig_table(solution),
        "mountings": mounting_table(solution),
        "motions": motion_table(solution),
    }


def _size(solution: Solution) -> str:
    return f"{counted(len(solution.photos.names), 'photo')}, {counted(len(solution.points.names), 'point')}"


def _as_data(content: dict[str, Any]) -> Markup:
    """Return JSON that is safe inside a script element."""
    text = msgspec.json.encode(content).decode("utf-8")
    # the characters that could end the element, as JSON writes them
    return Markup(text.replace("<", "\\u003c").replace("&", "\\u0026").replace(">", "\\u003e"))


def _policy(script: str) -> str:
    """Return what a browser may do with the page: run these two scripts and no other, and load nothing."""
    digests = map(_digest, (script.encode(), _source()))
    hashes = " ".join(f"'sha256-{base64.b64encode(digest).decode('ascii')}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {hashes}; "
        "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


@cache
def _source() -> bytes:
    package = find_spec("plotly")  # its modules take longer to import than the script to read
    folders = package.submodule_search_locations if package is not None else None
    return Path(*(folders or ())[:1], "package_data", "plotly.min.js").read_bytes()


@cache
def _plotly() -> Markup:
    """Return plotly's script, compressed: the page unpacks it when the block is to be shown."""
    source = _source()
    packed = kept(f"{_digest(source).hex()}.deflated", lambda: zlib.compress(source, _COMPRESSION))
    return Markup(base64.b64encode(packed).decode("ascii"))


@cache
def _digest(source: bytes) -> bytes:
    return hashlib.sha256(source).digest()
