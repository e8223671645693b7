"""What is handed over: the report for the client on two to four pages, and the calibration certificate of cameras."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from orip.bundle.results.compared_points import ComparedKind, ComparedPoints, compared_points
from orip.bundle.verdict import GlobalTest, Level, Untested, headline, sigma0_test
from orip.errors import InputError
from orip.geometry.rotation import rotation_from_angles
from orip.number_text import root_mean_square
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.report.calibration import STRONG, CameraSheet, camera_sheets, frame_reach
from orip.report.control_points import compared_table, distance_table
from orip.report.drawings.block_plan import block_plan
from orip.report.drawings.residual_vectors import VectorSheet, measured_reach, vector_sheets
from orip.report.first_page import Fact, gate_table, key_numbers, method_facts, order_facts
from orip.report.photos import rms_of_photos
from orip.report.report_input import ReportInput, photo_scale, pixel_of_camera
from orip.report.run_mark import RUN_NAME
from orip.report.table import PageTable, counted, length_unit, significant
from orip.report.templates import rendered
from orip.units import DEGREES_PER_RADIAN
from orip.version import __version__
from orip.wording import agreeing

MOST_ROWS = 25
"""Most control points, and most check points, in a table for the client; of more those that fit least."""


class ClientVerdict(Struct, frozen=True):
    """What a client reads first: whether the result can be used, and why, without a word of the trade."""

    level: Level
    headline: str
    sentences: tuple[str, ...]


def client_page(given: ReportInput) -> str:
    """Return the report for the client as one HTML page that loads nothing and runs nothing."""
    cameras = tuple(sheet for sheet in camera_sheets(given) if _is_adjusted(given.solution, sheet.name))
    content = {
        "verdict": client_verdict(given),
        "key_numbers": key_numbers(given),
        "plan": block_plan(given),
        "tables": [
            table
            for table in (
                gate_table(given), _shortened(given, "control"), _shortened(given, "check"),
                distance_table(given.solution),
            )
            if table is not None
        ],
        "cameras": cameras,
    }  # fmt: skip
    return rendered("client.html", {**_common(given), **content})


def certificate_page(given: ReportInput) -> str:
    """Return the calibration certificate of the cameras that were adjusted, as one HTML page that loads nothing.

    Raises
    ------
    InputError
        If no camera was adjusted.
    """
    solution = given.solution
    sheets = [sheet for sheet in camera_sheets(given) if _is_adjusted(solution, sheet.name)]
    if not sheets:
        message = (
            f"no camera was calibrated by bundle {solution.bundle}: all their parameters are held; name those to be "
            'adjusted in orip.toml, [[camera]] unknown = ["C", "DX", "DY", "A3"], and run it again'
        )
        raise InputError.single(message)
    vectors = {sheet.camera: sheet for sheet in vector_sheets(given, single=False)}
    cameras = [Calibration(sheet, vectors.get(sheet.name), tuple(_conditions(given, sheet.name))) for sheet in sheets]
    content = {
        "verdict": client_verdict(given),
        "cameras": cameras,
        "tables": [table for table in (distance_table(solution), _shortened(given, "control")) if table is not None],
    }
    return rendered("certificate.html", {**_common(given), **content})


class Calibration(Struct, frozen=True):
    """A camera on the certificate: its parameters, its residuals in the frame, and how it was calibrated."""

    sheet: CameraSheet
    vectors: VectorSheet | None
    conditions: tuple[Fact, ...]


def client_verdict(given: ReportInput) -> ClientVerdict:
    """Return whether the result can be used, in sentences that say no more and no less than the full report."""
    solution = given.solution
    test = sigma0_test(solution)
    level, technical = headline(solution, sum(not gate.passed for gate in given.gates), test)
    reason = technical
    for begins in ("Converged", "; ", ", ", "but ", "with doubts: ", "Not determined: "):
        reason = reason.removeprefix(begins)
    first = {
        "good": "The measurements fit each other and the given coordinates as well as they were expected to: nothing "
        "speaks against using the results.",
        "caution": f"The results are to be used with care: {reason}.",
        "bad": f"The results must not be used: {reason}.",
    }[level]
    return ClientVerdict(level, first, tuple(_reasons(solution, test, level)))


def _reasons(solution: Solution, test: GlobalTest | Untested, level: Level) -> Iterator[str]:
    """Yield what supports the verdict: the points given on the ground, what was left out, what checks nothing."""
    for kind, words in (
        ("check", "{points}, which had no influence on the results, {differ}"),
        ("control", "{points}, on which the results rest, {differ}"),
    ):
        points = compared_points(solution, kind)  # type: ignore[arg-type]
        if len(points) and level != "bad":
            yield words.format(points=counted(len(points), f"{kind} point"), differ=_differ(points, solution))
    if not solution.check_points and level != "bad":
        yield "No check points were kept back: nothing but the adjustment itself tells how good the results are."
    left_out = len({blunder.order for blunder in solution.blunders})
    if left_out:
        were = agreeing(left_out, "was", "were")
        yield f"{counted(left_out, 'measurement')} {were} found to be wrong and left out."
    down = int(np.count_nonzero(solution.residuals.weight_factor < 1.0))
    if down and not left_out:
        share = down / max(solution.observations, 1)
        yield f"{share:.1%} of the measured values fitted badly and were given little or no influence."
    if isinstance(test, Untested) and test is not Untested.ERRORS_ESTIMATED:
        yield "There are no surplus measurements that could reveal an error."
    if level == "good" and solution.diagnosis:
        yield (
            f"Parts of the block are less well determined than the rest: the full report has "
            f"{counted(len(solution.diagnosis), 'note')} on it."
        )


def _differ(points: ComparedPoints, solution: Solution) -> str:
    """Return how far points differ from what is given, and how far that was to be expected."""
    with np.errstate(invalid="ignore"):
        expected = np.hypot(points.given_sd, np.nan_to_num(points.sd, nan=0.0, posinf=np.nan))
    parts = (("X and Y", slice(0, 2)), ("Z", slice(2, 3)))
    found = []
    for name, axes in parts:
        size = root_mean_square(points.difference[:, axes])
        if np.isfinite(size):
            unit = length_unit(size, solution.ground_unit)
            allowed = root_mean_square(expected[:, axes])
            about = f" ({unit.of(allowed)} expected)" if points.kind == "check" and np.isfinite(allowed) else ""
            found.append(f"{unit.of(size)} in {name}{about}")
    differ = agreeing(len(points), "differs", "differ")
    return f"{differ} from the given coordinates by {' and '.join(found)} (root mean square)."


def _shortened(given: ReportInput, kind: ComparedKind) -> PageTable | None:
    """Return the table of the points that fit least, if they are many, in their order."""
    points = given.compared[kind]
    if len(points) <= MOST_ROWS:
        return compared_table(given, kind)
    worst = np.nan_to_num(np.nanmax(np.nan_to_num(points.w, nan=-1.0), axis=1), nan=-1.0)
    return compared_table(given, kind, np.sort(np.argsort(-worst, kind="stable")[:MOST_ROWS]))


def _work_done(given: ReportInput) -> Iterator[Fact]:
    """Yield the steps of the work: what was measured, how it was computed, and what was checked."""
    solution = given.solution
    rays = int(solution.point_rays.sum())
    photos, points = counted(len(solution.photos.names), "photo"), counted(len(solution.points.names), "point")
    yield Fact("Measured", f"{counted(rays, 'image point')} of {points} in {photos}")
    yield from method_facts(given)
    yield Fact(
        "Computed",
        f"{counted(solution.observations, 'observation')} determine {counted(solution.unknowns, 'unknown')} by least "
        f"squares; {counted(solution.redundancy, 'observation')} more than needed check the others",
    )
    yield Fact("Residuals in the photos, RMS", rms_of_photos(given) or "–")
    yield Fact("Program", f"orip {__version__}, run {solution.run}")


def _conditions(given: ReportInput, camera: str) -> Iterator[Fact]:
    """Yield under which conditions a camera was calibrated."""
    solution = given.solution
    mine = [
        row
        for row, name in enumerate(solution.photos.names)
        if (photo := given.photos.get(record_key(name))) is not None and record_key(photo.camera) == record_key(camera)
    ]
    yield Fact("Photos", str(len(mine)))
    yield Fact(
        "Points a photo, mean", significant(float(np.mean([len(given.seen_points[row]) for row in mine] or [0])))
    )
    depth = photo_scale(given).depth[mine]
    if np.isfinite(depth).any():
        near, far = (significant(float(value)) for value in (np.nanmin(depth), np.nanmax(depth)))
        yield Fact("Distance to the object", f"{near} to {far} {solution.ground_unit}")
    yield from _attitudes(solution, mine)
    reach, frame = measured_reach(given, camera), frame_reach(given, camera)
    if frame > 0.0:
        yield Fact("Image points reach", f"{min(reach / frame, 1.0):.0%} of the way to the corners of the frame")
    if np.isfinite(pixel := pixel_of_camera(given, camera)):
        yield Fact("Pixel", f"{significant(1e3 * pixel)} µm")
    yield Fact("Residuals in the photos, RMS", rms_of_photos(given) or "–")


def _attitudes(solution: Solution, rows: Sequence[int]) -> Iterator[Fact]:
    """Yield how far the photos converge, and how far they are rolled: both tell C, DX and DY from the orientations."""
    if len(rows) < 2:
        return
    turned = rotation_from_angles(solution.photos.values[rows, 3:] / DEGREES_PER_RADIAN)
    axes = turned[:, :, 2]
    widest = np.degrees(np.arccos(np.clip((axes @ axes.T).min(), -1.0, 1.0)))
    yield Fact("Largest angle between two photos", f"{widest:.0f}°")
    roll = np.degrees(np.arctan2(*(turned[0].T @ turned)[:, [1, 0], 0].T))
    quarters = len(set((np.round(roll / 90.0).astype(int) % 4).tolist()))
    yield Fact("Rolled photos", "none" if quarters == 1 else f"in {quarters} of 4 directions (quarter turns)")


def _is_adjusted(solution: Solution, camera: str) -> bool:
    row = solution.cameras.names.index(camera)
    own = [parameter.sd for parameter in solution.additional if parameter.camera == camera]
    return bool(np.isfinite([*solution.cameras.sd[row].tolist(), *own]).any())


def _common(given: ReportInput) -> dict[str, Any]:
    """Return what both have: whose work it is, and by which program and run."""
    return {
        "version": __version__,
        "run_name": RUN_NAME,
        "solution": given.solution,
        "details": given.details,
        "order": order_facts(given),
        "done": tuple(_work_done(given)),
        "strong": STRONG,
    }
