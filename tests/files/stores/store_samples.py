"""Records to store: one rich example of each kind, hypothesis strategies, and an exact comparison."""

from typing import get_args

import numpy as np
from hypothesis import strategies as st
from msgspec import Struct
from msgspec.structs import astuple

from orip.files.project.file_names import file_name_fault
from orip.files.stores.contents import observations, solutions
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.stores import (
    BUNDLES,
    CAMERAS,
    PHOTO_ORIENTATIONS,
    PHOTOS,
    TEMPLATE_ORIENTATIONS,
    TEMPLATES,
    TEMTICKS,
)
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark, Projection, Sensor
from orip.records.coded_names import CodedNames
from orip.records.control import PointKind
from orip.records.definition import BundleDefinition, Precision, StereoModel
from orip.records.measurement import (
    MeasuredMarks,
    PhotoObservations,
    PhotoOrientation,
    TemplateOrientation,
)
from orip.records.names import name_fault, record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo, Scan, Template, Temtick
from orip.records.results.solution import (
    Blunder,
    CheckPoint,
    Correlation,
    Diagnosis,
    Estimates,
    InteriorSummary,
    IterationPass,
    Residuals,
    RigEstimate,
    SingularUnknown,
    Solution,
)
from orip.records.results.tests import GroupKind, GroupTest

NAN, INF = float("nan"), float("inf")


def same(a, b):
    """Whether two values agree in type and to the last bit; NaN is NaN."""
    a, b = (tuple(value) if isinstance(value, CodedNames) else value for value in (a, b))
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, Struct):
        return all(map(same, astuple(a), astuple(b)))
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    return bool(a == b) or (a != a and b != b)


def rich_solution(bundle="MAIN"):
    generator = np.random.default_rng(7)

    def estimates(names, count):
        values, sd = generator.normal(size=(2, len(names), count)) * 1e3
        sd[0, :2] = NAN, INF
        return Estimates(names, values, sd)

    n = 5
    figures = [generator.normal(size=n) for _ in range(7)]
    figures[4][1] = figures[5][1] = figures[6][1] = NAN
    return Solution(
        project="ZÜRICH",
        user="K. Dueholm",
        bundle=bundle,
        ground_unit="US survey foot",
        run="r-0001",
        status="doubtful",
        sigma0=0.1 + 0.2,
        sigma0_all=NAN,
        redundancy=214,
        redundancy_used=213.00000000000003,
        observations=400,
        unknowns=186,
        enp=INF,
        iterations=(IterationPass(1, -0.5, 3.25, 0, 2), IterationPass(2, 4.75, NAN, 3, 2, step_limited=True)),
        cameras=estimates(("OLYMPUS", "größe"), len(CAMERA_PARAMETERS)),
        projections=("perspective", "equidistant"),
        photos=estimates(("P1", "p2", "фото3"), len(PHOTO_PARAMETERS)),
        points=estimates(("1001", "a", "A", "点"), 3),
        point_rays=np.array([2, 3, 0, 9]),
        point_kinds=("tie", "control", "check", "rejected"),
        residuals=Residuals(
            ("photo", "photo", "control", "element", "distance"),
            ("P1", "p2", "", "", ""),
            ("a", "A", "点", "OLYMPUS", "D 1"),
            ("x", "y", "Z", "C", "XYZ"),
            *figures,
        ),
        photo_rotation_sd_about_axes=(True, False, True),
        singular=(SingularUnknown("POINT", "a", "Z", INF), SingularUnknown("CAMERA", "OLYMPUS", "A7", 13.5)),
        correlations=(Correlation("OLYMPUS.C", "P1.Z0", -0.987654321),),
        rigs=(RigEstimate("OLYMPUS", "kamera 2", 3, "BX", -0.1, NAN, 1e-3),),
        blunders=(Blunder(1, "photo", "P1", "a", "xy", 0.25, 0.01, 25.0, 3.29),),
        diagnosis=(Diagnosis("weak-scale", "P1", "zwei\nZeilen \u2028 und '\"\x00", "measure a distance"),),
        check_points=(CheckPoint("A", 0.01, NAN, -0.02),),
        interior=(InteriorSummary("photos", "P1", "A", 1.0, 2.0, 0.5, -0.01, 1.001, 0.999, NAN, 4),),
        inputs=(("ORIP.toml", "ab" * 32), ("Maß.MEA", "cd" * 32)),
        warnings=(("look-alikes", "A.PNT:3", "'a' and 'A'"),),
    )


letters = st.characters(exclude_categories=["C", "Z"])
names = st.text(letters, min_size=1, max_size=5).filter(lambda name: not name_fault(name))
record_name_lists = st.lists(names, unique_by=record_key, max_size=4)
numbers = st.floats(allow_nan=False, allow_infinity=False).map(lambda value: value + 0.0)
positive = st.floats(min_value=0.0, exclude_min=True, allow_infinity=False)
any_float = st.floats(allow_infinity=False).map(lambda value: value + 0.0)
any_figure = st.floats().map(lambda value: value + 0.0)
texts = st.text(max_size=20)
integers = st.integers(-(2**63), 2**63 - 1)


def some(strategy):
    return st.none() | strategy


def arrays(count, width, elements=numbers):
    row = st.tuples(*[elements] * width)
    return st.lists(row, min_size=count, max_size=count).map(lambda rows: np.array(rows, float).reshape(count, width))


def flags(count):
    return st.lists(st.booleans(), min_size=count, max_size=count)


marks = st.builds(Mark, names, numbers, numbers)
given_marks = st.lists(marks, unique_by=lambda mark: mark.name, max_size=4).map(tuple)
scans = some(st.builds(Scan, st.tuples(positive, positive), st.sampled_from(["corner", "centre"])))
stages = some(st.sampled_from(["UPPER", "LOWER"]))


@st.composite
def measured_marks(draw):
    mark_names = tuple(draw(st.lists(names, unique=True, max_size=4)))
    n = len(mark_names)
    disregarded = np.array(draw(flags(n)), dtype=bool)
    return MeasuredMarks(mark_names, draw(arrays(n, 2)), disregarded, draw(arrays(n, 2, any_float)))


def camera(name):
    return st.builds(
        Camera,
        st.just(name),
        st.tuples(*[numbers] * len(CAMERA_PARAMETERS)),
        st.sampled_from(["ideal", "measured"]),
        some(st.tuples(numbers, numbers, numbers, numbers)),
        some(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=3).map(tuple)),
        some(st.tuples(numbers, numbers)),
        given_marks,
        some(st.builds(Sensor, st.integers(1, 10**6), st.integers(1, 10**6), positive, positive)),
        st.lists(st.sampled_from(CAMERA_PARAMETERS), unique=True).map(tuple),
        some(st.sampled_from(["EBNER", "GRUEN"])),
    )


def temtick(name):
    return st.builds(Temtick, st.just(name), given_marks)


def photo(name):
    orientation = st.tuples(*[some(numbers)] * 6)
    constant = st.lists(st.sampled_from(PHOTO_PARAMETERS), unique=True).map(tuple)
    return st.builds(Photo, st.just(name), names, some(names), stages, orientation, constant, scans)


def template(name):
    return st.builds(Template, st.just(name), names, stages, record_name_lists.map(tuple), scans)


def bundle(name):
    model = st.builds(StereoModel, names, names, names, integers, integers)
    return st.builds(
        BundleDefinition,
        st.just(name),
        st.builds(Precision, positive, st.sampled_from(["mm", "px"])),
        numbers,
        integers,
        integers,
        numbers,
        numbers,
        st.sampled_from(["control", "free"]),
        st.lists(names, max_size=3).map(tuple),
        st.lists(model, unique_by=lambda item: record_key(item.name), max_size=3).map(tuple),
    )


@st.composite
def stored_records(draw, of_name):
    # files are named after bundles
    named = [name for name in draw(record_name_lists) if of_name is not bundle or file_name_fault(name) is None]
    records = [draw(of_name(name)) for name in named]
    return tuple(StoredRecord(record, draw(some(texts)), draw(some(texts))) for record in records)


@st.composite
def photo_orientations(draw):
    return [
        PhotoOrientation(name, draw(st.sampled_from("ACW")), draw(measured_marks())) for name in draw(record_name_lists)
    ]


@st.composite
def template_orientations(draw):
    return [
        TemplateOrientation(name, draw(st.sampled_from("ACW")), draw(stages), draw(measured_marks()))
        for name in draw(record_name_lists)
    ]


@st.composite
def photo_observations(draw):
    pairs = draw(st.lists(st.tuples(names, names), unique_by=lambda pair: (record_key(pair[0]), pair[1]), max_size=6))
    n = len(pairs)
    return PhotoObservations(
        draw(names),
        tuple(pair[0] for pair in pairs),
        tuple(pair[1] for pair in pairs),
        draw(arrays(n, 2)),
        draw(arrays(n, 2, any_float)),
        np.array(draw(flags(n)), dtype=bool),
    )


@st.composite
def estimates(draw, count, least=0):
    labels = tuple(draw(st.lists(texts, min_size=least, max_size=3)))
    return Estimates(labels, draw(arrays(len(labels), count, any_figure)), draw(arrays(len(labels), count, any_figure)))


def tuples_of(strategy):
    return st.lists(strategy, max_size=3).map(tuple)


@st.composite
def any_solution(draw):
    photo_part, point_part = draw(estimates(6)), draw(estimates(3))
    camera_part = draw(estimates(len(CAMERA_PARAMETERS)))
    projections = st.lists(st.sampled_from(get_args(Projection)), min_size=len(camera_part.names))
    n, points = draw(st.integers(0, 4)), len(point_part.names)
    column = st.lists(texts, min_size=n, max_size=n).map(tuple)
    figures = st.lists(any_figure, min_size=n, max_size=n).map(lambda values: np.array(values, dtype=float))
    residuals = Residuals(*[draw(column) for _ in range(4)], *[draw(figures) for _ in range(7)])
    kinds = st.sampled_from(get_args(PointKind))
    return Solution(
        *[draw(texts) for _ in range(2)],
        draw(names),
        *[draw(texts) for _ in range(2)],
        draw(st.sampled_from(["converged", "doubtful", "not_converged", "stopped"])),
        *[draw(any_figure) for _ in range(2)],
        draw(integers),
        draw(any_figure),
        *[draw(integers) for _ in range(2)],
        draw(any_figure),
        draw(tuples_of(st.builds(IterationPass, integers, any_figure, any_figure, integers, integers, st.booleans()))),
        camera_part,
        photo_part,
        point_part,
        np.array(draw(st.lists(st.integers(0, 99), min_size=points, max_size=points)), dtype=np.int64),
        tuple(draw(st.lists(kinds, min_size=points, max_size=points))),
        residuals,
        tuple(draw(flags(len(photo_part.names)))),
        draw(tuples_of(st.builds(SingularUnknown, texts, texts, texts, any_figure))),
        draw(tuples_of(st.builds(Correlation, texts, texts, any_figure))),
        draw(tuples_of(st.builds(Blunder, integers, texts, texts, texts, texts, *[any_figure] * 4))),
        draw(tuples_of(st.builds(Diagnosis, texts, texts, texts, texts))),
        draw(tuples_of(st.builds(CheckPoint, texts, any_figure, any_figure, any_figure))),
        draw(
            tuples_of(
                st.builds(
                    InteriorSummary,
                    st.sampled_from(["templates", "photos"]),
                    texts,
                    texts,
                    *[any_figure] * 7,
                    integers,
                )
            )
        ),
        draw(tuples_of(st.tuples(texts, texts))),
        draw(tuples_of(st.tuples(texts, texts, texts))),
        verdict=draw(texts),
        projections=tuple(draw(projections)[: len(camera_part.names)]),
        groups=draw(tuples_of(any_group_test())),
    )


def any_group_test():
    return st.builds(
        GroupTest,
        st.sampled_from(get_args(GroupKind)),
        *[texts] * 2,
        *[integers] * 2,
        *[any_float] * 8,
        texts,
        *[any_float] * 2,
        st.booleans(),
    )


def marks_of(*mark_names, shift=0.0):
    n = len(mark_names)
    measured = np.arange(2.0 * n).reshape(n, 2) / 3 + shift
    given = np.full((n, 2), NAN)
    given[-1] = 100.0, 0.0
    return MeasuredMarks(mark_names, measured, np.arange(n) == 1, given)


def filled_stores(folder):
    """Return a function per kind that fills a store of that kind with rich content, by file."""

    def stored(*records):
        return [StoredRecord(record, "d" * 64, "ZURICH") for record in records]

    observed = PhotoObservations(
        "MAIN",
        ("P1", "P1", "p2"),
        ("a", "A", "点"),
        np.array([[1.1, 2.2], [1 / 3, -1e-300], [0.1, 1e300]]),
        np.array([[NAN, NAN], [-1.0, 0.004], [0.005, NAN]]),
        np.array([False, True, False]),
    )
    two_orientations = [PhotoOrientation(name, "A", marks_of("1", "9")) for name in ("P1", "p2")]
    camera_record = Camera(
        "Größe",
        tuple(0.1 * k for k in range(13)),
        "measured",
        (10.0, 0.1, 0.2, 0.3),
        ((1.0, 0.01), (2.0, 0.04)),
        (24.0, 36.0),
        (Mark("1", -12.0, 18.0), Mark("a", 12.0, 18.0)),
        Sensor(1280, 1024, 8.245, 6.6),
        ("C", "A3"),
        "EBNER",
    )

    def fill_photos(store):
        known = (1.0, None, 3.0, 0.5, None, -180.0)
        PHOTOS.write(
            store, stored(Photo("P1", "Größe", "T1", None, known, ("X0",), Scan((0.01, 0.02))), Photo("p2", "C"))
        )
        PHOTO_ORIENTATIONS.write(store, two_orientations)

    def fill_templates(store):
        TEMPLATES.write(store, stored(Template("T1", "TT", "LOWER", ("P1", "p2"), Scan((0.01, 0.01), "centre"))))
        TEMPLATE_ORIENTATIONS.write(store, [TemplateOrientation("T1", "C", "UPPER", marks_of("1", "2", "3"))])

    def fill_exterior(store):
        models = (StereoModel("M1", "P1", "p2", 1, 1), StereoModel("M2", "p2", "P3", 1, 2))
        definition = BundleDefinition(
            "MAIN", Precision(0.5, "px"), datum="free", datum_points=("a", "A"), models=models
        )
        BUNDLES.write(store, stored(definition, BundleDefinition("second")))
        solutions.write(store, rich_solution())

    return {
        folder / "C.CAM": lambda store: CAMERAS.write(store, stored(camera_record)),
        folder / "T.TIK": lambda store: TEMTICKS.write(store, stored(Temtick("TT", (Mark("1", 0.0, 1.0),)))),
        folder / "Z.PHO": fill_photos,
        folder / "Z.TEM": fill_templates,
        folder / "Z.EXT": fill_exterior,
        folder / "MAIN.EXO": lambda store: observations.write(store, observed),
    }
