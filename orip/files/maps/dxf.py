"""DXF of release 12: pairs of a code and a value, each on a line of its own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from orip.arrays import FloatArray

Pairs = list[tuple[int, object]]


def drawing(colours: Mapping[str, int], entities: Iterable[tuple[int, object]]) -> bytes:
    """Return a drawing.

    Parameters
    ----------
    colours : mapping of str to int
        Colour numbers of all layers.
    entities : iterable of pairs
        What `labelled_point`, `line` and `polyline` give, joined.
    """
    pairs: Pairs = [(0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(colours))]
    for name, colour in colours.items():
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES"), *entities, (0, "ENDSEC"), (0, "EOF")]
    return "".join(_lines(pairs)).encode("ascii")


def labelled_point(layer: str, place: list[float], name: str, height: float) -> Pairs:
    """Return a point X, Y, Z with its name, written in that height (ground units)."""
    return [*_place("POINT", layer, place), *_place("TEXT", layer, place), (40, height), (1, _plain(name))]


def line(layer: str, place: FloatArray) -> Pairs:
    """Return a straight line between two places (2, 3)."""
    start, end = place.tolist()
    return [*_place("LINE", layer, start), *zip((11, 21, 31), end, strict=True)]


def polyline(layer: str, place: FloatArray, *, closed: bool) -> Pairs:
    """Return a polyline of places (n, 2 or 3), in space where they have heights; the first of a closed one once."""
    is_in_space = place.shape[1] == 3
    pairs: Pairs = [(0, "POLYLINE"), (8, layer), (66, 1), (70, 8 * is_in_space + closed)]
    for x, y, *z in place.tolist():
        pairs += [*_place("VERTEX", layer, [x, y, *(z or [0.0])]), *([(70, 32)] if is_in_space else [])]
    return [*pairs, (0, "SEQEND"), (8, layer)]


def _place(kind: str, layer: str, place: list[float]) -> Pairs:
    return [(0, kind), (8, layer), *zip((10, 20, 30), place, strict=True)]


def _lines(pairs: Pairs) -> Iterator[str]:
    return (f"{code:3d}\n{repr(value) if isinstance(value, float) else value}\n" for code, value in pairs)


def _plain(name: str) -> str:
    """Return a name in the characters of release 12: others as their numbers, which newer programs show."""
    return "".join(letter if letter.isascii() and letter.isprintable() else f"\\U+{ord(letter):04X}" for letter in name)
