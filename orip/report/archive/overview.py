"""The overview page of an archive: one line a project, to be sorted and filtered, with histograms of what is shown."""

from __future__ import annotations

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

from markupsafe import Markup
from msgspec import Struct

from orip.archive.tables import Cell, Row

if TYPE_CHECKING:
    from jinja2 import Template

_NUMBERS = ("sigma0", "redundancy", "photos", "points", "check_rms_xy", "check_rms_z", "check_max")


class OverviewInput(Struct, frozen=True):
    """What the overview shows.

    Parameters
    ----------
    base, method, orip : str
        The top of the archive, how it was adjusted, and by which version.
    planned : int
        Projects of the archive, finished or not.
    projects : sequence of Row
        Rows of the table `projects`.
    failed : mapping by (project, bundle)
        The gates that it failed.
    links : mapping by project
        Its folder, as a link from the page.
    """

    base: str
    method: str
    orip: str
    planned: int
    projects: Sequence[Row]
    failed: Mapping[tuple[str, str], Sequence[str]]
    links: Mapping[str, str]


def archive_page(given: OverviewInput) -> str:
    """Return the overview as one HTML page that loads nothing."""
    rows = [_shown(given, row) for row in sorted(given.projects, key=lambda row: (row["project"], row["bundle"]))]
    states = Counter(str(row["state"]) for row in rows)
    gates = Counter(gate for row in rows for gate in given.failed.get((str(row["project"]), str(row["bundle"])), ()))
    text = json.dumps({"rows": rows, "gates": gates.most_common()}, separators=(",", ":"), allow_nan=False)
    # the characters that could end the element, as JSON writes them
    data = Markup(text.replace("<", "\\u003c").replace("&", "\\u0026").replace(">", "\\u003e"))
    finished = len({row["project"] for row in rows})
    return f"{_template().render(given=given, data=data, states=states.most_common(), finished=finished)}\n"


def _shown(given: OverviewInput, row: Row) -> dict[str, Cell | Sequence[str]]:
    """Return what the page has to know of a row of `projects`."""
    name, bundle = str(row["project"]), str(row["bundle"])
    adjusted = row["state"] == "adjusted"
    report = row.get("report")
    return {
        "project": name,
        "bundle": bundle,
        "state": str(row.get("status") or row["state"]).replace("_", " "),
        "text": row.get("verdict") if adjusted and row.get("verdict") else row["message"],
        "link": f"{given.links[name]}/{report or ''}",
        "failed": list(given.failed.get((name, bundle), ())),
        **{number: row.get(number) for number in _NUMBERS},
    }


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("orip.report", "page")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    script = f"\n{loader.get_source(environment, 'archive.js')[0]}\n"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    environment.globals["script"] = Markup(script)
    environment.globals["style"] = Markup(loader.get_source(environment, "archive.css")[0])
    environment.globals["policy"] = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; "
        "base-uri 'none'; form-action 'none'"
    )
    return environment.get_template("archive.html")
