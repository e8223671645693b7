"""BUNDLE_RESULT.OUT: the listing of a bundle adjustment, and its exposure stations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.files.listings.bundle_estimates import (
    antenna_lines,
    camera_lines,
    check_point_lines,
    exposure_lines,
    figure_lines,
    motion_lines,
    mounting_lines,
    photo_lines,
    point_lines,
    variance_component_lines,
    zero_direction_lines,
)
from orip.files.listings.bundle_residuals import (
    ground_residual_lines,
    largest_residual_lines,
    photo_residual_lines,
)
from orip.files.listings.title import bundle_title
from orip.files.text.table import Column, key_lines, paragraph, section, table_lines
from orip.number_text import decimals_for, fixed, one_fixed, root_mean_square
from orip.records.coded_names import coded
from orip.records.epochs import SECONDS_PER_WEEK
from orip.records.measurement import PhotoObservations
from orip.records.results.solution import MOST_AS_TEXT, Reliability, Solution
from orip.records.results.stations import ATTITUDE_KINDS, POSITION_KINDS, StationResiduals, station_residuals
from orip.records.results.tests import FIGURE_GROUPS

STATION_KINDS = (*POSITION_KINDS, *ATTITUDE_KINDS)
"""Kinds of observation that are listed here."""

_LEGEND = [
    "",
    "  v = residual (adjusted minus observed), w = normalised residual, WF = least weight factor of the three",
    "  (below 1: down-weighted, '-': only compared). Time: seconds, of the GPS week where that is known.",
]


def station_lines(solution: Solution) -> Iterator[str]:
    """Yield the tables of positions and attitudes, and their root mean squares by strip."""
    position, attitude = station_residuals(solution, "position"), station_residuals(solution, "attitude")
    if len(position):
        yield from _table(position, ("X", "Y", "Z"), solution.ground_unit)
        yield from _strips(position, ("X", "Y", "Z"), solution.ground_unit)
    if len(position) and len(attitude):
        yield ""
    if len(attitude):
        yield from _table(attitude, ("OMEGA", "PHI", "KAPPA"), "°")
    yield from _LEGEND


def _table(found: StationResiduals, names: Sequence[str], unit: str) -> list[str]:
    decimals = decimals_for(np.abs(found.a_priori), 3, 6)
    times = [exposure.time % SECONDS_PER_WEEK for exposure in found.exposures]
    columns = [
        Column("Photo", [exposure.photo for exposure in found.exposures], align="left"),
        Column("Strip", [exposure.strip for exposure in found.exposures], align="left"),
        Column("Time", fixed(times, 2), "s"),
        *(
            Column(f"v{name}", fixed(column, decimals), unit)
            for name, column in zip(names, found.residual.T, strict=True)
        ),
        *(Column(f"w{name}", fixed(column, 2)) for name, column in zip(names, found.w.T, strict=True)),
        Column("WF", fixed(least_weight_factors(found), 3)),
    ]
    return table_lines([column for column in columns if any(cell not in {"", "-"} for cell in column.cells)])


def _strips(found: StationResiduals, names: Sequence[str], unit: str) -> Iterator[str]:
    """Yield mean and root mean square of the residuals of each strip."""
    strips = dict.fromkeys(exposure.strip for exposure in found.exposures if exposure.strip)
    if not strips:
        return
    decimals = decimals_for(np.abs(found.a_priori), 3, 6)
    of_strip = np.array([exposure.strip for exposure in found.exposures])
    used = np.where(np.isnan(found.weight_factor), np.nan, found.residual)
    parts = [used[of_strip == strip] for strip in strips]
    columns = [
        Column("Strip", list(strips), align="left"),
        Column("Stations", [str(len(part)) for part in parts]),
        *(
            Column(f"mean v{name}", fixed([_mean(part[:, axis]) for part in parts], decimals), unit)
            for axis, name in enumerate(names)
        ),
        *(
            Column(f"RMS v{name}", fixed([_rms(part[:, axis]) for part in parts], decimals), unit)
            for axis, name in enumerate(names)
        ),
    ]
    yield from ["", *table_lines(columns)]


def least_weight_factors(found: StationResiduals) -> FloatArray:
    """Return the least weight factor (n,) of the three components; NaN where a station is only compared."""
    return np.asarray(found.weight_factor.min(axis=1))


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return root_mean_square(known) if len(known) else math.nan


TITLE = "BUNDLE ADJUSTMENT: RESULTS"

STRONG_CORRELATION = 0.95


def bundle_listing_lines(solution: Solution, reliability: Reliability, measured: PhotoObservations) -> Iterator[str]:
    """Yield the lines of BUNDLE_RESULT.OUT, without newlines.

    Parameters
    ----------
    reliability : Reliability
        Of its residuals.
    measured : PhotoObservations
        Those that were adjusted; of a photo point that is not among them no measured coordinates are listed.
    """
    yield from bundle_title(TITLE, solution)
    yield from section("KEY FIGURES", _key_figures(solution))
    if solution.remarks:
        yield from section("GROUND SYSTEM", [line for remark in solution.remarks for line in paragraph(remark.text)])
    if solution.variance_components:
        yield from section("VARIANCE COMPONENTS", variance_component_lines(solution))
    yield from section("LARGEST STANDARD RESIDUALS", largest_residual_lines(solution))
    yield from section("ITERATIONS", _iterations(solution))
    yield from section("CAMERAS", camera_lines(solution))
    with_antennas = " AND ANTENNA" if solution.antennas else ""
    yield from section(f"CORRELATIONS OF CAMERA{with_antennas} UNKNOWNS", _correlations(solution))
    yield from section("PHOTOS", photo_lines(solution))
    if solution.motions:
        yield from section("MOTIONS OF PHOTOS DURING THE READOUT", motion_lines(solution))
    yield from section("POINTS", _at_request(solution, "points") or point_lines(solution))
    if solution.antennas:
        yield from section("ANTENNAS: LEVER ARM, BORESIGHT, SHIFTS AND DRIFTS", antenna_lines(solution))
    if solution.mountings:
        yield from section("RIGS: MOUNTINGS OF CAMERAS", mounting_lines(solution))
        yield from section("RIGS: EXPOSURES", exposure_lines(solution))
    if solution.zero_directions:
        yield from section("ZERO DIRECTIONS OF THEODOLITE SETS", zero_direction_lines(solution))
    if solution.figures:
        yield from section("LINES, PLANES, CYLINDERS AND EQUAL HEIGHTS", figure_lines(solution))
        yield from section("DISTANCES FROM THEM", ground_residual_lines(solution, FIGURE_GROUPS.__contains__))
    yield from section("CONTROL POINT RESIDUALS", ground_residual_lines(solution, lambda kind: kind == "control"))
    yield from section("CHECK POINTS: ADJUSTED MINUS GIVEN COORDINATES", check_point_lines(solution))
    if any(kind in STATION_KINDS for kind in coded(solution.residuals.kind).occurring()):
        yield from section("EXPOSURE STATIONS", station_lines(solution))
    others = ground_residual_lines(
        solution, lambda kind: kind not in ("control", "photo", *STATION_KINDS, *FIGURE_GROUPS)
    )
    yield from section("RESIDUALS OF ELEMENTS, DISTANCES AND DIRECTIONS", others)
    residual_lines = _at_request(solution, "residuals") or photo_residual_lines(solution, reliability, measured)
    yield from section("PHOTO RESIDUALS", residual_lines)


def _at_request(solution: Solution, what: str) -> list[str]:
    """Return where the lines of a section are that is not listed as it would be too long; none if it is listed."""
    if not solution.is_large:
        return []
    text = (
        f"Not listed here, as the block has more than {MOST_AS_TEXT} observations: 'orip results {what}' shows them, "
        f"'orip results {what} NAME ...' those of some photos or points."
    )
    return paragraph(text)


def _key_figures(solution: Solution) -> list[str]:
    residuals = solution.residuals
    down_weighted = int(np.count_nonzero(residuals.weight_factor < 1.0))
    disregarded = int(np.count_nonzero(np.isnan(residuals.weight_factor)))
    no_redundancy = "no redundancy: nothing checks the observations" if solution.redundancy <= 0 else ""
    removed = f"{len(solution.singular)} of them singular and removed" if solution.singular else ""
    pairs = [
        (
            "Standard error of unit weight (sigma0)",
            one_fixed(solution.sigma0, 4),
            no_redundancy or "of the observations with weight factor 1",
        ),
        ("Standard error of unit weight (sigma0_all)", one_fixed(solution.sigma0_all, 4), "of all observations"),
        ("Redundancy", str(solution.redundancy), no_redundancy),
        ("Redundancy of the observations with weight factor 1", one_fixed(solution.redundancy_used, 2), ""),
        ("Observations (equations)", str(solution.observations), ""),
        ("Unknowns", str(solution.unknowns), removed),
        ("Exponent of numerical precision (ENP)", one_fixed(solution.enp, 2), ""),
        ("Down-weighted observations", str(down_weighted), ""),
        (
            "Disregarded observations",
            str(disregarded),
            "their residuals are listed, they have no influence" if disregarded else "",
        ),
        *_photo_figures(solution),
    ]
    return key_lines(pairs)


def _photo_figures(solution: Solution) -> list[tuple[str, str, str]]:
    residuals = solution.residuals
    used = coded(residuals.kind).where("photo".__eq__) & np.isfinite(residuals.weight_factor)
    a_priori = residuals.a_priori[used]
    figures = [("Photo observations", str(a_priori.size), "x and y counted one by one")]
    if a_priori.size == 0:
        return figures
    mean = root_mean_square(residuals.residual[used])
    figures.append(("Root mean square of the photo residuals", one_fixed(mean, 5), "mm"))
    if a_priori.min() == a_priori.max():
        figures.append(("A-priori error of an image coordinate", one_fixed(float(a_priori[0]), 5), "mm"))
        standard_error = solution.sigma0 * float(a_priori[0])
        figures.append(
            (
                "Standard error of an image coordinate",
                one_fixed(standard_error, 5),
                "mm, sigma0 times the a-priori error",
            )
        )
    return figures


def _iterations(solution: Solution) -> list[str]:
    passes = solution.iterations
    lines = table_lines(
        [
            Column("Iteration", [f"{row.iteration}{'*' if row.step_limited else ' '}" for row in passes]),
            Column("ENP", fixed([row.enp for row in passes], 2)),
            Column("sigma0", fixed([row.sigma0 for row in passes], 4)),
            Column("Down-weighted", [str(row.down_weighted) for row in passes]),
            Column("Singular", [str(row.singular) for row in passes]),
        ]
    )
    if any(row.step_limited for row in passes):
        lines += ["", *paragraph("* the step of this iteration was shortened or damped")]
    return lines


def _correlations(solution: Solution) -> list[str]:
    rows = solution.correlations
    return table_lines(
        [
            Column("Unknown", [row.a for row in rows], align="left"),
            Column("Unknown", [row.b for row in rows], align="left"),
            Column("r", fixed([row.r for row in rows], 3)),
            Column("", ["strong" if abs(row.r) >= STRONG_CORRELATION else "" for row in rows], align="left"),
        ]
    )
