"""Tables of other programs: the fields of their lines, decimal commas, and the units that their headings name."""

from __future__ import annotations

import csv
import math
import re
import unicodedata
from collections.abc import Iterable
from types import MappingProxyType

from orip.units import METRES_PER_FOOT, METRES_PER_GROUND_UNIT

_SEPARATORS = (";", "\t", ",")
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?")
_UNIT = re.compile(r"[(\[]([^)\]]*)[)\]]")
_AFTER_NAME = re.compile(r"(?P<name>[A-Za-z0-9]+)[ _](?P<unit>[A-Za-z -]+)")

DEGREES = MappingProxyType(
    {"gon": 0.9, "grad": 0.9, "gons": 0.9} | dict.fromkeys(("rad", "radian", "radians"), 180.0 / math.pi)
)
"""Angles in degrees, by their units but degrees."""

METRES = MappingProxyType(
    {"m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "mm": 0.001, "cm": 0.01, "km": 1000.0}
    | dict.fromkeys(("ft", "feet", "foot", "ift", "international foot", "international feet"), METRES_PER_FOOT)
    | dict.fromkeys(
        ("ftus", "ft us", "ft-us", "usft", "us ft", "us-ft", "sft", "us feet", "us survey foot", "us survey feet"),
        METRES_PER_GROUND_UNIT["US survey foot"],
    )
)
"""Lengths in metres, by their units; a foot is the international one where the survey's is not named."""

NAMES_OF_PHOTOS = (
    "photo image filename file imagename photoname bild bildname foto dateiname nom imagen immagine imagem"
)
NAMES_OF_POINTS = "point name label id gcp target punkt punktnummer punktnr pktnr pkt nr nom punto ponto"
EASTINGS = "x easting east e rechtswert rechts ostwert ost este est"
NORTHINGS = "y northing north n hochwert hoch nordwert nord norte"
HEIGHTS = "z height h elevation altitude hohe hoehe hauteur altura altezza quota"
"""Headings as `folded`; those of German, French, Italian, Portuguese and Spanish tables are among them."""

EXTRA_FIELDS = "; with decimal commas the separator has to be a semicolon"
"""What may be wrong where a row has more fields than the heading and commas between them."""

EXTRA_WORDS = "; separate fields that have blanks in them, such as 53 30 00 N, by semicolons"
"""What may be wrong where it has blanks between them."""


def separator_of(heading: str) -> str | None:
    """Return what separates the fields of a table with a heading; None: blanks."""
    return next((mark for mark in _SEPARATORS if mark in heading), None)


def fields_of_line(line: str, separator: str | None) -> list[str]:
    """Return the fields of a line, which may be in quotation marks."""
    if separator is None:
        return line.split()
    try:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        fields = line.split(separator)
    return [field.strip() for field in fields]


def has_decimal_commas(words: Iterable[str]) -> bool:
    """Return whether numbers among the words have decimal commas, and none has a point."""
    known = list(words)
    return any(map(_WITH_COMMA.fullmatch, known)) and not any(map(_WITH_POINT.fullmatch, known))


def folded(heading: str) -> str:
    """Return a heading in small letters without accents and umlauts."""
    return "".join(one for one in unicodedata.normalize("NFKD", heading.lower()) if not unicodedata.combining(one))


def unit_of(heading: str) -> str:
    """Return the unit that a heading names in brackets, in small letters; empty where it names none."""
    found = _UNIT.search(heading)
    return "" if found is None else found[1].replace(".", "").strip().lower()


def with_bracketed_length(heading: str) -> str:
    """Return a heading such as ``X_ft`` or ``East ft`` with its unit of length in brackets; others as they are."""
    found = _AFTER_NAME.fullmatch(heading.strip())
    return f"{found['name']} ({found['unit']})" if found and found["unit"].lower() in METRES else heading
