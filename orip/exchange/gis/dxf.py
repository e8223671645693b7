"""Points, photos and error ellipses as DXF of release 12, which every CAD program reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from orip.exchange.gis.layers import ellipses, magnification, photo_layer, point_layer
from orip.records.exchanged import ExchangedProject

_TEXT_OF_EXTENT = 0.005


def write_dxf(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one drawing; the name of the layer of ellipses says how much larger they are drawn."""
    points, photos = point_layer(project), photo_layer(project)
    factor = magnification(points)
    extent = max((float(values.max() - values.min()) for values in points.values[:, :2].T if values.size), default=1.0)
    layers = {"POINTS": 7, "PHOTOS": 5, f"ELLIPSES_{factor:g}X".replace(".", "_").replace("+", ""): 1}
    of_ellipses = list(layers)[-1]
    pairs: list[tuple[int, object]] = [(0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(layers))]
    for name, colour in layers.items():
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    height = _TEXT_OF_EXTENT * (extent or 1.0)
    for layer, drawn in (("POINTS", points), ("PHOTOS", photos)):
        for name, row in zip(drawn.names, drawn.values[:, :3].tolist(), strict=True):
            pairs += _place("POINT", layer, row)
            pairs += [*_place("TEXT", layer, row), (40, height), (1, _plain(name))]
    for _, outline in ellipses(points, factor):
        pairs += [(0, "POLYLINE"), (8, of_ellipses), (66, 1), (70, 1)]
        for x, y in outline[:-1].tolist():
            pairs += _place("VERTEX", of_ellipses, [x, y, 0.0])
        pairs += [(0, "SEQEND"), (8, of_ellipses)]
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return {"orip.dxf": "".join(_lines(pairs)).encode("ascii")}


def _place(kind: str, layer: str, place: list[float]) -> list[tuple[int, object]]:
    return [(0, kind), (8, layer), *zip((10, 20, 30), place, strict=True)]


def _lines(pairs: list[tuple[int, object]]) -> Iterator[str]:
    return (f"{code:3d}\n{repr(value) if isinstance(value, float) else value}\n" for code, value in pairs)


def _plain(name: str) -> str:
    """Return a name in the characters of release 12: others as their numbers, which newer programs show."""
    return "".join(letter if letter.isascii() and letter.isprintable() else f"\\U+{ord(letter):04X}" for letter in name)
