"""From files of rover, base and orbits to a solution: what is checked before, RTKLIB both ways, what came out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.text.shown import shown_token
from orip.geometry.ground_ellipsoid import geographic_from_geocentric, place_axes
from orip.progress import stage
from orip.stations.gnss.given_files import Antex, PreciseFile, is_precise, read_antex, read_precise
from orip.stations.gnss.raw_files import moment
from orip.stations.gnss.receiver_data import ReceiverFile, read_receiver_file
from orip.stations.gnss.rtklib import Settings, Way, engine, run_rtklib
from orip.stations.gnss.solution import (
    Joined,
    SatelliteUse,
    Stretch,
    doubted_stretches,
    forward_alone,
    join_directions,
    parse_solution,
    satellites_used,
    unlike_the_others,
)
from orip.stations.interpolation import WGS84
from orip.structs import replace

_ORBITS_HOLD = 4 * 3600.0
"""Seconds from the time of a broadcast orbit for which it serves."""

_SAME_EPOCH = 0.5
"""Seconds by which epochs of two receivers may differ."""

_EXCHANGED, _OFF = 200.0, 30.0
"""Metres: of the place in a header to the place given, where it is meant; and where it is astonishing."""

_LONG = 20_000.0
"""Metres of a baseline on which the ionosphere no longer is the same at both ends."""

_LEAST_FIXED = 0.5


class GnssFiles(Struct, frozen=True):
    """What is computed from, and how.

    Parameters
    ----------
    rover, base : Path
    orbits : tuple of Path
        Navigation messages (RINEX); precise orbits and clocks (SP3, CLK).
    way : Way
    base_place : tuple of 3 float or None
        Geocentric coordinates of the base's mark, m; None: those in its header.
    rover_height, base_height : float or None
        Of the antenna's reference point above the mark, m; None: as the header says.
    elevation : float
        Degrees.
    systems : str
    frequencies : int
    antex : Path or None
        Calibrations of antennas.
    rover_antenna, base_antenna : str
        Types of antennas in it; empty: those of the headers.
    """

    rover: Path
    base: Path
    orbits: tuple[Path, ...]
    way: Way = "kinematic"
    base_place: tuple[float, float, float] | None = None
    rover_height: float | None = None
    base_height: float | None = None
    elevation: float = 15.0
    systems: str = "GREJC"
    frequencies: int = 2
    antex: Path | None = None
    rover_antenna: str = ""
    base_antenna: str = ""


class GnssResult(Struct, frozen=True):
    """What came out.

    Parameters
    ----------
    rover, base : ReceiverFile
    settings : Settings
    engine : str
    joined : Joined
    stretches : tuple of Stretch
        When it is not to be trusted.
    epochs_in_common : int
        Of rover and base.
    place, covariance : arrays (3,), (3, 3)
        Geocentric, of a rover that stands: the last epoch forward, which has all observations; m, m².
    closure : array (3,)
        Of a rover that stands: forward less backward, each with all observations, m.
    satellites : tuple of SatelliteUse
        Forward in time.
    warnings : tuple of ProjectWarning
    """

    rover: ReceiverFile
    base: ReceiverFile
    settings: Settings
    engine: str
    joined: Joined
    stretches: tuple[Stretch, ...]
    epochs_in_common: int
    place: FloatArray
    covariance: FloatArray
    closure: FloatArray
    satellites: tuple[SatelliteUse, ...]
    warnings: tuple[ProjectWarning, ...]

    @property
    def text(self) -> str:
        """Return the solution in the form of RTKLIB, .pos."""
        solution = self.joined.solution
        return "\n".join([*solution.header, *solution.lines, ""])

    @property
    def vector(self) -> FloatArray:
        """Return the baseline from the base's mark to the rover, geocentric, array (3,), m."""
        vector: FloatArray = self.place - np.array(self.settings.base)
        return vector

    @property
    def geographic(self) -> FloatArray:
        """Return longitude and latitude (radians) and height above the ellipsoid of the place, array (3,)."""
        geographic: FloatArray = geographic_from_geocentric(self.place[None], WGS84)[0]
        return geographic

    @property
    def local_covariance(self) -> FloatArray:
        """Return the covariance of the place along east, north and up, array (3, 3), m²."""
        axes = place_axes(self.geographic[None])[0]
        covariance: FloatArray = axes @ self.covariance @ axes.T
        return covariance


def process_gnss(files: GnssFiles) -> GnssResult:
    """Compute the positions of a rover.

    Raises
    ------
    InputError
        With everything that is wrong with the files; or if no position comes out of them.
    OripError
        If RTKLIB is not there, or broke off.
    """
    program = engine()
    rover, base, orbits, precise = _read(files)
    place = files.base_place
    complaints = list(_complaints(files, rover, base, orbits, precise))
    antex = None if files.antex is None else read_antex(files.antex)
    antennas = ("", "")
    if isinstance(antex, Complaint):
        complaints.append(antex)
    elif antex is not None:
        wanted = (files.rover_antenna or rover.antenna_type, files.base_antenna or base.antenna_type)
        complaints += _unknown_antennas(antex, wanted, (rover, base))
        antennas = (antex.known(wanted[0]) or "", antex.known(wanted[1]) or "")
    if place is None and not np.isfinite(base.place).all():
        complaints.append(Complaint("the header has no place of the base; give it: --base X,Y,Z", base.shown))
    if complaints:
        raise InputError(complaints)
    if place is None:
        place = (float(base.place[0]), float(base.place[1]), float(base.place[2]))
    warnings = list(_warnings(place, rover, base))
    settings = Settings(
        files.way, place,
        rover_antenna=_antenna(rover, files.rover_height), base_antenna=_antenna(base, files.base_height),
        elevation=files.elevation, frequencies=files.frequencies, systems=files.systems,
        precise=bool(precise), antennas=antennas,
    )  # fmt: skip
    texts = [(_ENDINGS[part.kind], part.data) for part in (rover, base, *orbits)]
    texts += [(part.ending, part.data) for part in precise]
    calibrations = None if antex is None or isinstance(antex, Complaint) else antex.data
    directions, said = [], ""
    with stage("RTKLIB", total=2) as advance:
        for backward in (True, False):
            text, said = run_rtklib(replace(settings, backward=backward), texts, program, calibrations)
            directions.append(parse_solution(text))
            advance(len(directions))
    backward_solution, forward = directions
    if not len(forward) or not len(backward_solution):
        message = (
            f"RTKLIB finds no position: {common_epochs(rover, base)} epochs and "
            f"{len(rover.satellites & base.satellites)} satellites in common, satellites above {files.elevation:g} "
            "degrees are used; are orbits of all of them there, and code and phase of at least five at a time?"
        )
        raise InputError([Complaint(message, rover.shown)])
    joined = forward_alone(forward) if files.way == "static" else join_directions(forward, backward_solution)
    last, other = forward.place[-1], backward_solution.place[-1]
    result = GnssResult(
        rover, base, settings, program, joined, doubted_stretches(joined), common_epochs(rover, base),
        last, forward.covariance[-1], last - other, satellites_used(said), tuple(warnings),
    )  # fmt: skip
    return replace(result, warnings=(*warnings, *_doubts(result)))


def _read(files: GnssFiles) -> tuple[ReceiverFile, ReceiverFile, list[ReceiverFile], list[PreciseFile]]:
    """Return rover, base, broadcast orbits, and precise orbits and clocks."""
    paths = [(files.rover, "O"), (files.base, "O"), *((path, "N") for path in files.orbits if not is_precise(path))]
    read = {at: read_receiver_file(path, path.name, kind) for at, (path, kind) in enumerate(paths)}
    known = [part.time[0] for part in read.values() if isinstance(part, ReceiverFile)]
    if known:  # what has seconds of the week alone is of the week of the others
        for at, part in read.items():
            if isinstance(part, list):
                path, kind = paths[at]
                read[at] = read_receiver_file(path, path.name, kind, near=known[0])
    precise = [read_precise(path) for path in files.orbits if is_precise(path)]
    found, complaints = [], [part for part in precise if isinstance(part, Complaint)]
    for at, part in read.items():
        if isinstance(part, list):
            complaints += part
        elif part.kind != paths[at][1]:
            wanted = "observations" if paths[at][1] == "O" else "orbits (a navigation file)"
            message = f"this file has {_KINDS[part.kind]} where {wanted} are needed: the order is ROVER BASE NAV..."
            complaints.append(Complaint(message, part.shown))
        else:
            found.append(part)
    if complaints:
        raise InputError(complaints)
    return found[0], found[1], found[2:], [part for part in precise if isinstance(part, PreciseFile)]


def _unknown_antennas(antex: Antex, wanted: Sequence[str], parts: Sequence[ReceiverFile]) -> Iterator[Complaint]:
    for antenna, part, option in zip(wanted, parts, ("--rover-antenna", "--base-antenna"), strict=True):
        if antex.known(antenna) is None:
            what = (
                f"antenna '{shown_token(antenna)}' is not in {antex.shown}" if antenna else "the header has no antenna"
            )
            yield Complaint(f"{what}; give its type with {option}: {antex.alike(antenna)}", part.shown)


_KINDS = {"O": "observations", "N": "orbits"}
_ENDINGS = {"O": ".obs", "N": ".nav"}
"""By which RTKLIB knows what is in a file; one that it takes for compressed it would hand to another program."""


def _complaints(
    files: GnssFiles, rover: ReceiverFile, base: ReceiverFile, orbits: Sequence[ReceiverFile],
    precise: Sequence[PreciseFile],
) -> Iterator[Complaint]:  # fmt: skip
    if not orbits and not precise:
        yield Complaint("no orbits are given; name the navigation file of the day", rover.shown)
    if files.base_place is not None and not is_on_earth(files.base_place):
        given = ", ".join(f"{value:g}" for value in files.base_place)
        text = f"the place of the base is {given}; geocentric X, Y and Z in metres are needed"
        yield Complaint(text, base.shown)
    if rover.data == base.data:
        yield Complaint("rover and base are the same file; give the observations of two receivers", rover.shown)
        return
    if not common_epochs(rover, base):
        yield Complaint(
            f"rover and base have no epoch in common: {rover.span} in {rover.shown}, {base.span} in {base.shown} "
            "(GPS time); give files of the same hours",
            rover.shown,
        )
        return
    if files.way == "static" and common_epochs(rover, base) == 1:
        yield Complaint("there is one epoch in common; a baseline that stands needs many: --way epochs", rover.shown)
    common = {name for name in rover.satellites & base.satellites if name[0] in files.systems}
    if not common:
        yield Complaint(f"rover and base have no satellite of the systems {files.systems} in common", rover.shown)
    yield from _of_other_times(rover, orbits, precise)
    known = {name for part in orbits for name in part.satellites}
    if orbits and common and not common & known:
        yield Complaint("the orbits are of other satellites than those observed", orbits[0].shown)
    if files.base_place is not None and np.isfinite([rover.place, base.place]).all():
        to_rover, to_base = (float(np.linalg.norm(part.place - files.base_place)) for part in (rover, base))
        if to_rover < _EXCHANGED < to_base:
            yield Complaint(
                f"the place of the base is that of the rover's header ({to_rover:.0f} m away), not of the base's "
                f"({to_base:.0f} m): are rover and base exchanged? The order is ROVER BASE NAV...",
                rover.shown,
            )


def _of_other_times(
    rover: ReceiverFile, orbits: Sequence[ReceiverFile], precise: Sequence[PreciseFile]
) -> Iterator[Complaint]:
    if precise and not orbits:
        text = "RTKLIB needs broadcast orbits beside precise ones; give a navigation file of the day too"
        yield Complaint(text, precise[0].shown)
    for part in orbits:
        if part.time[-1] + _ORBITS_HOLD < rover.time[0] or part.time[0] - _ORBITS_HOLD > rover.time[-1]:
            yield Complaint(f"orbits of {part.span} do not serve for {rover.span}; give those of the day", part.shown)
    for given in precise:
        if given.time[-1] < rover.time[0] or given.time[0] > rover.time[-1]:
            text = f"{given.span} does not serve for {rover.span}; give the file of the day"
            yield Complaint(text, given.shown)


def _warnings(place: Sequence[float], rover: ReceiverFile, base: ReceiverFile) -> Iterator[ProjectWarning]:
    if np.isfinite(base.place).all() and (off := float(np.linalg.norm(base.place - place))) > _OFF:
        text = f"the base is {off:.0f} m from the place in its header; check --base"
        yield ProjectWarning("base-off", base.shown, text)
    length = float(np.linalg.norm(rover.place - place))
    if length > _LONG:
        text = (
            f"the baseline has {length / 1000:.0f} km: the ionosphere is not the same at both ends; use a nearer base"
        )
        yield ProjectWarning("long-baseline", rover.shown, text)


def _doubts(result: GnssResult) -> Iterator[ProjectWarning]:
    solution = result.joined.solution
    fixed = int(np.count_nonzero(solution.is_fixed))
    if fixed < _LEAST_FIXED * len(solution):
        text = (
            f"ambiguities are fixed in {fixed} of {len(solution)} epochs: decimetres at best; look at shadows, the "
            "length of the baseline and the interval of the observations"
        )
        yield ProjectWarning("few-fixed", result.rover.shown, text)
    for one in unlike_the_others(result.satellites):
        text = f"phases of {one.name} have residuals of {1000.0 * one.residual:.0f} mm, far above those of the others"
        yield ProjectWarning("bad-satellite", result.rover.shown, text)
    if result.settings.way == "static" and solution.is_fixed[-1]:
        limit = 5.0 * np.sqrt(np.diag(result.covariance)) + 0.002
        if (np.abs(result.closure) > limit).any():
            size = 1000.0 * float(np.linalg.norm(result.closure))
            text = f"forward and backward in time differ by {size:.0f} mm; did the receiver stand all the time?"
            yield ProjectWarning("rover-moved", result.rover.shown, text)


def _antenna(part: ReceiverFile, height: float | None) -> tuple[float, float, float]:
    east, north, up = (float(value) for value in part.antenna)
    return east, north, up if height is None else height


def is_on_earth(place: Sequence[float]) -> bool:
    """Return whether geocentric coordinates are of a place near the surface of the Earth."""
    return 6.2e6 < float(np.linalg.norm(place)) < 6.5e6


def common_epochs(rover: ReceiverFile, base: ReceiverFile) -> int:
    """Return how many epochs of the rover the base observed too."""
    at = np.searchsorted(base.time, rover.time)
    before, after = base.time[np.maximum(at - 1, 0)], base.time[np.minimum(at, len(base.time) - 1)]
    nearest = np.minimum(np.abs(rover.time - before), np.abs(rover.time - after))
    return int(np.count_nonzero(nearest <= _SAME_EPOCH))


def stretch_text(stretch: Stretch) -> str:
    """Return a stretch as a line for people."""
    end = "" if stretch.epochs == 1 else f" to {moment(stretch.end)[11:]}"
    count = f"{stretch.epochs} epoch{'s' * (stretch.epochs != 1)}"
    return f"{moment(stretch.begin)}{end}, {count}: {stretch.why}"
