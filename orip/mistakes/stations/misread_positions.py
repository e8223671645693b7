"""Positions of photos that contradict the block: in another order, unit or system, or shifted by an event."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes import two_systems
from orip.mistakes.control.check_points import OF_HEIGHT_SYSTEMS
from orip.mistakes.hypothesis import Misfit, fit_of_adjustment
from orip.mistakes.mistake import STATIONS_OFF, Consequence, declare
from orip.mistakes.other_units import FEET_AND_METRES, LENGTH_UNITS
from orip.records.block import Block
from orip.records.names import record_key
from orip.structs import replace

# The block has to fit without them: they lost their weight, and control shows where the photos are.

ORDER = declare("station-order", "positions of photos stand under the names of others", STATIONS_OFF)
HEIGHTS = declare("station-heights", OF_HEIGHT_SYSTEMS, STATIONS_OFF)
ZERO_HEIGHTS = declare("zero-heights", "the heights of the control are not filled in", STATIONS_OFF)
GRID = declare("crs-of-another-grid", "crs is probably not the system of the coordinates", STATIONS_OFF)
AXES = declare("station-axes", "the axes of the stations are not those of the control", STATIONS_OFF)
UNIT = declare("station-unit", "the stations are in another unit than the control", STATIONS_OFF)
HEIGHT_OFFSET = declare(
    "height-offset", "the heights of the control and of the stations differ by a constant", STATIONS_OFF,
    Consequence(groups=("camera",)),
)  # fmt: skip
SHORTENED = declare("shortened-coordinates", "leading digits are missing in the stations or the control", STATIONS_OFF)
LOCAL = declare("local-system", "the stations or the control are in another system, or a local one", STATIONS_OFF)

_OFF_IN_Z = {HEIGHTS, ZERO_HEIGHTS, GRID}

_FEWEST, _FEWEST_MOVED = 5, 3
"""Least number of positions, and of those that are of other photos."""

_MOST = 0.9
"""Part of the positions that are explained at least."""

_AT = 0.1
"""Part of the distance of neighbouring photos within which a position is that of a photo."""

_REMAINS = 0.05
"""Part of their misfit that positions keep at most where they are read as they were meant."""

_GEOID = (10.0, 120.0)
"""Metres: heights of the geoid above the ellipsoid are between -107 and 86; GNSS is hardly off by the first."""

_ALIKE = 0.05
"""Spread of the differences of height systems, and what X and Y are off by, as parts of the difference at most."""


_OFF_SCALE = 0.01
"""What the scale of a grid differs from 1 by where it is hardly that of a survey: national grids and UTM have 0.001."""

_FEWEST_CONTROL = 3
"""Least number of control points that show where the block is."""

_FITS, _BENT, _WRONG_CONTROL = 3.0, 1.5, 0.1
"""Standard errors within which control fits, standard error of unit weight from which a block is bent, and part of the
control that does not fit then at most."""


class _Observed(Struct, frozen=True):
    """Positions of photos as observed and as adjusted, both (n, 3) in the project; `photo` are rows of photos."""

    photo: IntArray
    given: FloatArray
    found: FloatArray
    file: str

    @property
    def misfit(self) -> float:
        """Return the median distance of the two."""
        return _misfit(self.given, self.found)


def misread_stations(block: Block, solved: SolvedBlock) -> list[ProjectWarning]:
    """Return what is wrong with all positions of a file, if that explains why they do not fit.

    Parameters
    ----------
    block : Block
        As gathered.
    """
    if any(warning.code in two_systems.CODES for warning in block.warnings):
        return []  # said already
    observed = _observed(block, solved)
    if observed is None or len(observed.photo) < _FEWEST or not _is_where_photos_are(solved):
        return []
    readings = [_in_another_order(block, observed)]
    # positions that all agree may hold the block themselves, and it is the control that shows where the photos are
    moved = _where_control_puts_it(block, solved, observed)
    for placed in (observed, moved) if moved is not None else (observed,):
        # heights in feet are nearly constant above others of a low object
        readings += [*_read(placed), _in_another_height_system(block, placed), *_far_away(block, placed)]
    where = {ZERO_HEIGHTS: "control points", GRID: "crs"}
    found = ((where.get(code, "exposure stations"), code, text) for code, text in readings if text)
    return [ProjectWarning(code, of, text) for of, code, text in found][:1]


def misread_places(misfit: Misfit) -> list[ProjectWarning]:
    """Return the same of a misfit, but for heights that are off alike."""
    found = misread_stations(misfit.readjuster.block, misfit.solved)
    return [] if any(warning.code in _OFF_IN_Z for warning in found) else found


def other_heights(misfit: Misfit) -> list[ProjectWarning]:
    """Return why heights of stations are off alike, which a lens or a lever arm may look like."""
    return misread_stations(misfit.readjuster.block, misfit.solved)


def _is_where_photos_are(solved: SolvedBlock) -> bool:
    """Tell whether photo points or control fit: a block that both do not fit has the photos anywhere."""
    fit = fit_of_adjustment(solved)
    off = fit.standard[fit.columns[0].where("control".__eq__)] > _FITS * fit.scale
    return bool(fit.scale < _BENT or np.count_nonzero(off) <= _WRONG_CONTROL * len(off))


def _observed(block: Block, solved: SolvedBlock) -> _Observed | None:
    """Return the positions of the .STA file; without any, those of the .ELE file."""
    rows = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    places = {
        rows[record_key(station.photo)]: station.position
        for station in block.stations
        if station.has_position and record_key(station.photo) in rows
    }
    file = ".STA" if places else ".ELE"
    places = places or _of_elements(block, rows)
    if not places:
        return None
    photo = np.array(sorted(places), dtype=np.int64)
    found = block.ground.to_project(solved.state.centres[photo])
    return _Observed(photo, np.array([places[row] for row in photo.tolist()], dtype=np.float64), found, file)


def _where_control_puts_it(block: Block, solved: SolvedBlock, observed: _Observed) -> _Observed | None:
    """Return the positions as control has them, where most of it is off from the block by the same; else None."""
    place = solved.block.point_index()
    known = [point for point in block.control_points if point.name in place and None not in point.coordinates]
    if len(known) < _FEWEST_CONTROL:
        return None
    given = np.array([point.coordinates for point in known], dtype=np.float64)
    found = block.ground.to_project(solved.state.points[[place[point.name] for point in known]])
    shift = np.median(given - found, axis=0)
    size = float(np.linalg.norm(shift))
    is_alike = np.linalg.norm(given - found - shift, axis=1) < _REMAINS * size
    if not np.count_nonzero(is_alike) > 0.5 * len(known) or _misfit(observed.given, observed.found) > 0.5 * size:
        return None
    return replace(observed, found=observed.found + shift)


def _of_elements(block: Block, rows: dict[str, int]) -> dict[int, tuple[float, float, float]]:
    values: dict[int, dict[str, float]] = {}
    for element in block.elements:
        if element.group == "PHOTO" and element.error > 0.0 and record_key(element.name) in rows:
            values.setdefault(rows[record_key(element.name)], {})[element.kind] = element.value
    kinds = ("X0", "Y0", "Z0")
    return {row: (of["X0"], of["Y0"], of["Z0"]) for row, of in values.items() if set(kinds) <= set(of)}


def _misfit(given: FloatArray, found: FloatArray) -> float:
    return float(np.median(np.linalg.norm(given - found, axis=1)))


def _in_another_order(block: Block, observed: _Observed) -> tuple[str, str]:
    """Return that the positions are those of the photos, under other names."""
    from scipy.spatial import cKDTree

    if not np.isfinite(observed.found).all():
        return ORDER, ""
    between = cKDTree(observed.found).query(observed.found, k=2)[0][:, 1]
    distance, at = cKDTree(observed.given).query(observed.found)
    there = distance < _AT * float(np.median(between))
    own = np.arange(len(at))
    moved = there & (at != own)
    # stations moved by one photo, all of them: events and photos do not correspond, which is tried by itself
    by_one = max(int(np.count_nonzero(there & (at == own + step))) for step in (-1, 1))
    is_tried = observed.file == ".STA" and by_one >= _MOST * len(at) - 1
    is_permuted = len(np.unique(at[there])) == np.count_nonzero(there)
    # those that begin some photos later end as many earlier
    absent = max((1.0 - _MOST) * len(at), abs(float(np.median((at - own)[there]))) if there.any() else 0.0)
    is_explained = np.count_nonzero(~there) <= min(absent, 0.5 * len(at))
    if is_tried or not (is_permuted and is_explained and moved.sum() >= _FEWEST_MOVED):
        return ORDER, ""
    names = [block.photos[row].name for row in observed.photo.tolist()]
    first = int(np.flatnonzero(moved)[0])
    as_text = np.argsort(np.argsort([_number_first(name) for name in names]))
    is_text = bool((at[moved] == as_text[moved]).all())
    how = "; they are sorted as text (1, 10, 11, 2), and the names by number" if is_text else ""
    text = (
        f"{moved.sum()} of {len(at)} positions are those of other photos: that of {names[first]} stands under "
        f"{names[int(at[first])]}, and so on{how}; match positions and names again in the {observed.file} file"
    )
    return ORDER, text


def _number_first(name: str) -> str:
    """Return the number at the end of a name without leading zeros: what a list without these is sorted by."""
    digits = name[len(name.rstrip("0123456789")) :]
    return digits.lstrip("0") or digits


def _in_another_height_system(block: Block, observed: _Observed) -> tuple[str, str]:
    """Return that all heights are off alike, by what systems of heights differ."""
    off = observed.given - observed.found
    middle = np.median(off, axis=0)
    spread = np.median(np.abs(off - middle), axis=0)
    height = abs(float(middle[2]))
    fits = spread[2] < _ALIKE * height and np.abs(middle[:2]).max() + spread[:2].max() < _ALIKE * height
    if block.ground_unit != "m" or not (_GEOID[0] < height and fits):
        return HEIGHTS, ""
    by = f"{height:.2f} m too {'high' if middle[2] > 0.0 else 'low'} in Z"
    heights = [point.coordinates[2] for point in block.control_points if point.coordinates[2] is not None]
    is_controlled = len(heights) >= _FEWEST_CONTROL
    scale = _grid_scale(block, np.median(observed.given, axis=0))
    above = float(np.median(observed.given[:, 2]) - np.median(heights)) if is_controlled else np.inf
    # a block in a grid of another scale keeps its shape, and so flies lower or higher by that scale
    if abs(scale - 1.0) > _OFF_SCALE and abs(above - scale * (above - middle[2])) < _ALIKE * abs(above):
        text = (
            f"its grid makes lengths at the block {scale:.3f} times those on the ground, and the stations are given "
            f"{by}, compared with the control, as where X and Y are of another system, such as UTM or a national grid: "
            "name that system as crs in orip.toml"
        )
        return GRID, text
    if is_controlled and not any(heights):
        text = (
            f"all {len(heights)} have the height 0, and the stations are given {by}, compared with them: fill in their "
            "heights in the .PNT file, or, if they are right, give the stations in the same height system"
        )
        return ZERO_HEIGHTS, text
    text = (
        f"they are given {by}, compared with the control, and fit in X and Y: their heights and those of the control "
        "are probably in different height systems (above the ellipsoid, above the geoid); use one for both"
    )
    return HEIGHTS, text if height < _GEOID[1] else ""


def _grid_scale(block: Block, place: FloatArray) -> float:
    """Return how long a kilometre on the ground is in the grid at a place of the project, in kilometres."""
    along = block.ground.to_local(place + np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0]]))
    return 1000.0 / float(np.linalg.norm(along[1] - along[0]))


_ROUND, _SHORT = 1000.0, 5.0
"""What coordinates are shortened by is a multiple of the first; the block is off by it within the second."""

_TURNED = 0.2
"""Degrees that axes of another zone are turned by at least."""


def _far_away(block: Block, observed: _Observed) -> Iterator[tuple[str, str]]:
    """Yield why X and Y are kilometres apart: another zone or system, leading digits or an origin that was left out."""
    off = observed.given - observed.found
    middle = np.median(off, axis=0)
    thousands = _ROUND * np.round(middle / _ROUND)
    if block.ground_unit != "m" or not thousands.any() or abs(float(middle[2])) > _SHORT:
        return
    is_round = bool((np.abs(middle - thousands) < _SHORT).all())
    turn, rest = _turned(observed)
    if not is_round and abs(turn) > _TURNED and rest < _SHORT:
        text = (
            f"they are turned by {abs(turn):.2g} degrees and shifted against the control, as where they are in another "
            "zone or system: convert them to the system of the control"
        )
        yield LOCAL, text
    elif (np.median(np.abs(off - middle), axis=0) < _SHORT).all():
        yield _shortened(observed, thousands if is_round else np.where(thousands == 0.0, 0.0, middle), is_round)


def _turned(observed: _Observed) -> tuple[float, float]:
    """Return the rotation in the plane from the photos to their positions, degrees, and what (median) it leaves."""
    given, found = (xyz[:, 0] + 1j * xyz[:, 1] for xyz in (observed.given, observed.found))
    given, found = given - given.mean(), found - found.mean()
    turn = np.angle(np.vdot(found, given))
    return float(np.degrees(turn)), float(np.median(np.abs(given - np.exp(1j * turn) * found)))


def _shortened(observed: _Observed, by: FloatArray, is_round: bool) -> tuple[str, str]:
    """Return that leading digits (`by` (3,) is round) or an origin were left out, of the positions or the control."""
    axes = np.flatnonzero(by)
    longer, shorter = np.abs(observed.given), np.abs(observed.found)
    is_control = bool((np.median(longer, axis=0) > np.median(shorter, axis=0))[axes].all())
    short, whole = ("the control", "the positions") if is_control else ("the positions", "the control")
    added = " and ".join(
        f"{by[axis] if is_control else -by[axis]:+.{0 if is_round else 2}f} to {'XYZ'[axis]}" for axis in axes.tolist()
    )
    code, differ, cause = (
        (SHORTENED, "whole thousands", f"where leading digits were left out of {short}")
        if is_round
        else (LOCAL, "a constant", f"where {short} {'is' if is_control else 'are'} in a local system")
    )
    text = (
        f"they and the control differ by {differ}, as {cause}: write whole coordinates there, as in {whole}: add "
        f"{added}"
    )
    return code, text


def _read(observed: _Observed) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with axes and units."""
    found, given = observed.found, observed.given
    extent = float(np.ptp(found, axis=0).max())
    for code, read, text in _readings(given):
        misfit = _misfit(read, found)
        if misfit < _REMAINS * min(observed.misfit, extent):
            yield code, f"{text} in the {observed.file} file"
            return


def _readings(given: FloatArray) -> Iterator[tuple[str, FloatArray, str]]:
    text = "they fit when X and Y are exchanged: X is the easting, Y the northing; exchange the columns X and Y"
    yield AXES, given[:, [1, 0, 2]], text
    for axis, name in enumerate("XYZ"):
        signs = np.ones(3)
        signs[axis] = -1.0
        yield AXES, given * signs, f"they fit when {name} has the opposite sign; reverse the sign of {name}"
    for factor in FEET_AND_METRES:
        unit, other = LENGTH_UNITS[factor]
        text = f"when multiplied by {factor:.5g}: {{}} in {unit}, and the control in {other}; use one unit"
        yield UNIT, given * factor, f"they fit {text.format('they seem to be')}"
        yield UNIT, given * [1.0, 1.0, factor], f"their Z fits {text.format('it seems to be')}"
