"""Solutions written by hand, small and awkward, for the tests of everything that is printed from one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from orip.bundle.results.reliability import reliability, suspect_rows
from orip.files.listings.bundle import bundle_listing_lines
from orip.files.listings.errors import error_listing_lines
from orip.files.result.residuals import residuals_csv_pieces
from orip.records.control import PointKind
from orip.records.interior import MarkAdjustment
from orip.records.measurement import MeasuredMarks, PhotoObservations
from orip.records.results.solution import (
    Blunder,
    CheckPoint,
    Correlation,
    Diagnosis,
    Estimates,
    InteriorSummary,
    IterationPass,
    Residuals,
    SingularUnknown,
    Solution,
)
from orip.structs import replace

NAN = float("nan")
INF = float("inf")

LONG_NAME = "CORNER_OF_THE_NORTHERN_TOWER_BELOW_THE_CLOCK_17a"

COLUMNS = (
    "observed",
    "residual",
    "a_priori",
    "standard_residual",
    "weight_factor",
    "redundancy_number",
    "w",
)

# kind, photo, point, component, and the numbers in the order of COLUMNS
ROWS: tuple[tuple[object, ...], ...] = (
    ("photo", "P101", "1001", "x", -4.123456, 0.00312, 0.005, 0.624, 1.0, 0.412, 0.972),
    ("photo", "P101", "1001", "y", 7.000049, -0.000004, 0.005, 0.0008, 1.0, 0.733, -0.001),
    ("photo", "P102", "1001", "x", 3.9, -0.0311, 0.005, 6.22, 0.288, 0.87, -6.67),
    ("photo", "P102", "1001", "y", 7.25, 0.0041, 0.005, 0.82, 1.0, 0.61, 1.05),
    ("photo", "P101", LONG_NAME, "x", -110.5, 0.0021, 0.005, 0.42, 1.0, 0.55, 0.566),
    ("photo", "P101", LONG_NAME, "y", 99.875, -0.0013, 0.005, 0.26, 1.0, 1e-9, NAN),
    ("photo", "P102", "7", "x", 1.5, 0.25, -0.005, 50.0, NAN, NAN, NAN),
    ("photo", "P102", "7", "y", -2.5, -0.125, 0.005, 25.0, 1.0, 0.9, -26.35),
    ("control", "", "1001", "X", 1000482.579395, -0.0123, 0.02, 0.615, 1.0, 0.21, -1.342),
    ("control", "", "1001", "Y", 245113.25, 0.004, 0.02, 0.2, 1.0, 0.2, 0.447),
    ("control", "", "1001", "Z", 402.125, 0.0333, 0.05, 0.666, 1.0, 0.31, 1.196),
    ("element", "", "OLYMPUS", "C", 8.595, -0.0021, 0.01, 0.21, 1.0, 0.4, -0.332),
    ("element", "", "OLYMPUS", "A3", 1.25e-5, 3.5e-7, 1e-6, 0.35, 1.0, 0.4, 0.553),
    ("element", "", "P101", "OMEGA", 12.5, 0.0003, 0.001, 0.3, 1.0, 0.15, 0.775),
    ("distance", "", "D1", "XYZ", 45.128, -0.0007, 0.002, 0.35, 1.0, 0.5, -0.495),
    ("direction", "", "S1", "direction", 312.0042, 0.0011, 0.001, 1.1, 1.0, 0.5, 1.556),
)


def residuals(rows: tuple[tuple[object, ...], ...] = ROWS) -> Residuals:
    """Residuals from rows of names and numbers."""
    kind, photo, point, component = (tuple(str(row[k]) for row in rows) for k in range(4))
    numbers = np.array([row[4:] for row in rows], dtype=np.float64).reshape(-1, len(COLUMNS))
    return Residuals(kind, photo, point, component, *(numbers[:, k].copy() for k in range(len(COLUMNS))))


def estimates(names: tuple[str, ...], values: object, sd: object, width: int) -> Estimates:
    """Estimates from nested lists; also of no record at all."""
    return Estimates(names, _rows(values, width), _rows(sd, width))


def _rows(values: object, width: int) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64).reshape(-1, width)


def awkward() -> Solution:
    """A doubtful solution with a constant, a removed unknown, a check point without height, long and similar names."""
    return Solution(
        project="ZURICH",
        user="K. Dueholm",
        bundle="MAIN",
        ground_unit="m",
        run="20240229-0001-7f3a",
        status="doubtful",
        sigma0=1.0342,
        sigma0_all=1.8125,
        redundancy=4,
        redundancy_used=3.1375,
        observations=15,
        unknowns=12,
        enp=5.1238,
        iterations=(
            IterationPass(1, -0.52, 210.25, 0, 0, step_limited=True),
            IterationPass(2, 2.25, 3.125, 3, 1),
            IterationPass(3, 5.1238, 1.0342, 1, 1),
        ),
        cameras=estimates(
            ("OLYMPUS", "RESERVE"),
            [
                [8.595123, -0.190512, 0.930544, 0.0, -4.2123456e-4, 1.3e-6, 0.0, 0.0, 2.5e-5, -1e-5, 3e-4, 0.0, 0.0],
                [152.41, 0.002, -0.011, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            ],
            [[0.0012, 0.00081, 0.0009, NAN, 3.1e-6, 2e-8, NAN, NAN, INF, 1e-6, 2e-5, NAN, NAN], [NAN] * 13],
            13,
        ),
        projections=("perspective", "perspective"),
        photos=estimates(
            ("P101", "P102"),
            [
                [1000400.123456, 245000.5, 1402.75, 0.0123456, -0.5, 179.99875],
                [1000600.25, 245010.0, 1398.5, 33.0, 89.99, -12.25],
            ],
            [[0.021, 0.019, 0.0083, 0.00042, 0.00051, 0.00012], [NAN, INF, 0.03, 0.001, 0.002, 0.0015]],
            6,
        ),
        points=estimates(
            ("1001", LONG_NAME, "7"),
            [[1000482.567095, 245113.254, 402.1583], [1000500.0, 245000.125, 410.5], [999999.5, -0.00001, -12.25]],
            [[0.0123, 0.0118, 0.0291], [0.031, 0.029, INF], [NAN, NAN, NAN]],
            3,
        ),
        point_rays=np.array([2, 1, 1]),
        point_kinds=("control", "tie", "rejected"),
        residuals=residuals(),
        photo_rotation_sd_about_axes=(False, True),
        singular=(SingularUnknown("POINT", LONG_NAME, "Z", 13.42), SingularUnknown("CAMERA", "OLYMPUS", "P1", INF)),
        correlations=(Correlation("OLYMPUS.C", "OLYMPUS.A3", -0.9731), Correlation("OLYMPUS.DX", "OLYMPUS.P2", NAN)),
        blunders=(
            Blunder(1, "photo", "P102", "7", "y", -0.1391, 0.0055, 26.35, 3.29, "distance D1"),
            Blunder(2, "control", "", "1001", "Z", 0.11, 0.0894, 1.2, NAN),
        ),
        diagnosis=(
            Diagnosis(
                "one-ray-point", LONG_NAME, "the point is seen in one photo only", "Measure it in a second photo."
            ),
        ),
        check_points=(CheckPoint("K1", 0.012, -0.016, NAN), CheckPoint("K2", -0.03, 0.04, 0.1)),
        interior=(
            InteriorSummary("photos", "P101", "A", 0.012, -0.034, 0.5, 0.001, 1.0002, 0.9998, 0.0031, 2),
            InteriorSummary("templates", "T1", "C", 12.5, -3.25, 179.5, 0.0, 1.0001, 1.0001, NAN, 0),
        ),
        inputs=(("orip.toml", "ab" * 32), ("ZURICH.MEA", "cd" * 32)),
        warnings=(
            ("unused-control", "ZURICH.PNT:12", "no photo shows point 9004"),
            ("look-alike-names", "", 'points "7" and "07" — are they \n the same?'),
        ),
    )


def empty() -> Solution:
    """A solution stopped before anything was found: no residuals, no points, numbers missing."""
    return Solution(
        project="",
        user="",
        bundle="B",
        ground_unit="US survey foot",
        run="r0",
        status="stopped",
        sigma0=NAN,
        sigma0_all=NAN,
        redundancy=0,
        redundancy_used=0.0,
        observations=0,
        unknowns=0,
        enp=-INF,
        iterations=(),
        cameras=estimates((), [], [], 13),
        photos=estimates((), [], [], 6),
        points=estimates((), [], [], 3),
        point_rays=np.zeros(0, dtype=np.int64),
        point_kinds=(),
        residuals=residuals(()),
        photo_rotation_sd_about_axes=(),
    )


def with_many_points(count: int, photos: int = 4) -> Solution:
    """A converged solution with `count` points in `photos` photos each; numbers seeded, without meaning."""
    random = np.random.default_rng(482)
    names = tuple(f"{number}" for number in range(1, count + 1))
    cells = [(f"F{photo}", name, axis) for photo in range(photos) for name in names for axis in "xy"]
    n = len(cells)
    residual = random.normal(0.0, 0.005, n)
    base = awkward()
    kind: PointKind = "tie"
    return replace(
        base,
        status="converged",
        photos=estimates(
            tuple(f"F{photo}" for photo in range(photos)),
            random.uniform(-90, 90, (photos, 6)),
            random.uniform(0.001, 0.01, (photos, 6)),
            6,
        ),
        photo_rotation_sd_about_axes=(False,) * photos,
        points=estimates(names, random.uniform(1e5, 2e5, (count, 3)), random.uniform(0.01, 0.1, (count, 3)), 3),
        point_rays=np.full(count, photos),
        point_kinds=(kind,) * count,
        residuals=Residuals(
            ("photo",) * n,
            tuple(cell[0] for cell in cells),
            tuple(cell[1] for cell in cells),
            tuple(cell[2] for cell in cells),
            random.uniform(-115.0, 115.0, n),
            residual,
            np.full(n, 0.005),
            np.abs(residual) / 0.005,
            np.ones(n),
            np.full(n, 0.5),
            residual / 0.005 / np.sqrt(0.5),
        ),
        singular=(),
        warnings=(),
    )


def interior() -> list[MarkAdjustment]:
    """Orientations of a photo and of its template, in the wrong order; one has no redundancy and is mirrored."""
    photo = InteriorSummary("photos", "P101", "A", 0.0121, -0.0341, 0.5, 0.001, 1.0002, 0.9998, 0.00312, 2)
    template = InteriorSummary("templates", "STRIP_1", "W", 212.5, -3.25, -179.5, 0.0, 1.0, 1.0, NAN, 0)
    five, two = _coordinates(5), _coordinates(2)
    return [
        MarkAdjustment(photo, "A", "template", None, _marks(5, 1), five + 0.002, five * 1e-4, mirrored=False),
        MarkAdjustment(template, "W", "plate", "UPPER", _marks(2, 0), two, two * 0.0, mirrored=True),
    ]


def _coordinates(count: int) -> NDArray[np.float64]:
    return np.array([[(-1) ** k * (100.0 + k), k * 12.3456] for k in range(count)])


def _marks(count: int, disregarded: int) -> MeasuredMarks:
    flags = np.arange(count) >= count - disregarded
    names = tuple(f"{k + 1}" for k in range(count))
    return MeasuredMarks(names, _coordinates(count) + 212.5, flags, np.full((count, 2), NAN))


def measured(solution: Solution) -> PhotoObservations:
    """Photo observations of a solution, with coordinates that follow from their order."""
    found = solution.residuals
    rows = zip(found.kind, found.photo, found.point, strict=True)
    keys = list(dict.fromkeys((photo, point) for kind, photo, point in rows if kind == "photo"))
    coordinates = np.array([(100.0 + k / 8, -50.0 - k / 16) for k in range(len(keys))]).reshape(-1, 2)
    # names of records are compared without regard to case
    photos, points = tuple(photo.lower() for photo, _ in keys), tuple(point for _, point in keys)
    return PhotoObservations(
        solution.bundle, photos, points, coordinates, np.full_like(coordinates, NAN), np.zeros(len(keys), dtype=bool)
    )


def listing(solution: Solution) -> str:
    """BUNDLE_RESULT.OUT of a solution."""
    return result_listing(solution, measured(solution))


def result_listing(solution: Solution, observations: PhotoObservations) -> str:
    """BUNDLE_RESULT.OUT of a solution with certain photo observations."""
    lines = bundle_listing_lines(solution, reliability(solution.residuals, 1.0), observations)
    return "".join(f"{line}\n" for line in lines)


def error_listing(solution: Solution) -> str:
    """BUNDLE_ERROR.OUT of a solution."""
    return "".join(f"{line}\n" for line in error_listing_lines(solution, suspect_rows(solution).tolist()))


def csv_text(found: Residuals) -> str:
    """residuals.csv of residuals."""
    return "".join(csv_pieces(found))


def csv_pieces(found: Residuals) -> Iterator[str]:
    """residuals.csv of residuals in its pieces."""
    return residuals_csv_pieces(found, reliability(found, 1.0))
