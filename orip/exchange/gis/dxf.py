"""Points, photos, lines and areas as DXF of release 12, which every CAD program reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from orip.arrays import FloatArray
from orip.exchange.gis.layers import Shapes, photo_layer, point_layer, shapes
from orip.records.exchanged import ExchangedProject

_TEXT_OF_EXTENT = 0.005
_COLOURS = {"error": 1, "footprints": 4, "residual": 2, "rays": 8}
"""By the first word of a layer's name: red, cyan, yellow, grey."""


def write_dxf(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one drawing; the names of layers say how much larger ellipses and vectors are drawn."""
    points, photos = point_layer(project), photo_layer(project)
    drawn = shapes(project)
    extent = max((float(values.max() - values.min()) for values in points.values[:, :2].T if values.size), default=1.0)
    colours = {"POINTS": 7, "PHOTOS": 5, **{_layer(one): _COLOURS[one.name.split("_")[0]] for one in drawn}}
    pairs: list[tuple[int, object]] = [(0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(colours))]
    for name, colour in colours.items():
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    height = _TEXT_OF_EXTENT * (extent or 1.0)
    for layer, labelled in (("POINTS", points), ("PHOTOS", photos)):
        for name, row in zip(labelled.names, labelled.values[:, :3].tolist(), strict=True):
            pairs += _place("POINT", layer, row)
            pairs += [*_place("TEXT", layer, row), (40, height), (1, _plain(name))]
    for one in drawn:
        for place in one.places:
            pairs += _line(_layer(one), place) if one.geometry == "LINESTRING" else _outline(_layer(one), place)
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return {"orip.dxf": "".join(_lines(pairs)).encode("ascii")}


def _layer(drawn: Shapes) -> str:
    """Return a name in the letters that release 12 allows for layers."""
    return drawn.name.upper().replace("ERROR_", "").replace(".", "_").replace("+", "")


def _line(layer: str, place: FloatArray) -> list[tuple[int, object]]:
    start, end = place.tolist()
    return [*_place("LINE", layer, start), *zip((11, 21, 31), end, strict=True)]


def _outline(layer: str, place: FloatArray) -> list[tuple[int, object]]:
    """Return a closed polyline, in space where places have heights."""
    is_in_space = place.shape[1] == 3
    pairs: list[tuple[int, object]] = [(0, "POLYLINE"), (8, layer), (66, 1), (70, 9 if is_in_space else 1)]
    for x, y, *z in place[:-1].tolist():
        pairs += [*_place("VERTEX", layer, [x, y, *(z or [0.0])]), *([(70, 32)] if is_in_space else [])]
    return [*pairs, (0, "SEQEND"), (8, layer)]


def _place(kind: str, layer: str, place: list[float]) -> list[tuple[int, object]]:
    return [(0, kind), (8, layer), *zip((10, 20, 30), place, strict=True)]


def _lines(pairs: list[tuple[int, object]]) -> Iterator[str]:
    return (f"{code:3d}\n{repr(value) if isinstance(value, float) else value}\n" for code, value in pairs)


def _plain(name: str) -> str:
    """Return a name in the characters of release 12: others as their numbers, which newer programs show."""
    return "".join(letter if letter.isascii() and letter.isprintable() else f"\\U+{ord(letter):04X}" for letter in name)
