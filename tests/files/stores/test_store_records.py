"""What is written to a store is read back exactly."""

import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
import store_samples as samples
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import defstruct

from orip.errors import InputError
from orip.files.stores import digest as provenance
from orip.files.stores import store
from orip.files.stores.contents import observations, solutions
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.solution_tables import bundles
from orip.files.stores.contents.stores import (
    BUNDLES,
    CAMERAS,
    PHOTO_ORIENTATIONS,
    PHOTOS,
    TEMPLATE_ORIENTATIONS,
    TEMPLATES,
    TEMTICKS,
)
from orip.files.stores.digest import record_digest, same_record
from orip.files.stores.transaction import reading, writing
from orip.records.camera import Camera, Mark
from orip.records.definition import BundleDefinition
from orip.records.measurement import MeasuredMarks, PhotoObservations
from orip.records.names import record_key
from orip.records.photo import Photo, Temtick
from orip.structs import replace
from orip.workflow.project.run_id import digest_of_columns, digest_of_observations

# A commit to disk takes some 20 ms; the deadline of an example would count them.
exactly = settings(max_examples=12, deadline=None)


def round_trip(file_name, write, read):
    """Write to a new store in one transaction and read it back in another."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / file_name
        with writing([path]) as stores:
            write(stores[path])
        with reading([path]) as stores:
            return read(stores[path])


DEFINITIONS = {
    "C.CAM": (CAMERAS, samples.camera),
    "T.TIK": (TEMTICKS, samples.temtick),
    "Z.PHO": (PHOTOS, samples.photo),
    "Z.TEM": (TEMPLATES, samples.template),
    "Z.EXT": (BUNDLES, samples.bundle),
}


@exactly
@given(st.data())
@pytest.mark.parametrize("file_name", DEFINITIONS)
def test_definitions_come_back_exactly_and_in_order(file_name, data):
    tables, record = DEFINITIONS[file_name]
    written = data.draw(samples.stored_records(record))
    found = round_trip(file_name, lambda store: tables.write(store, written), tables.read)
    assert samples.same(found, written)
    assert [record_digest(item.record) for item in found] == [record_digest(item.record) for item in written]


ORIENTATIONS = {
    "Z.PHO": (PHOTO_ORIENTATIONS, samples.photo_orientations(), "photo"),
    "Z.TEM": (TEMPLATE_ORIENTATIONS, samples.template_orientations(), "template"),
}


@exactly
@given(st.data())
@pytest.mark.parametrize("file_name", ORIENTATIONS)
def test_orientations_come_back_exactly(file_name, data):
    tables, orientations, name = ORIENTATIONS[file_name]
    written = data.draw(orientations)
    found = round_trip(file_name, lambda store: tables.write(store, written), tables.read)
    expected = {record_key(getattr(item, name)): item for item in written}
    assert found.keys() == expected.keys()
    assert all(samples.same(found[key], expected[key]) for key in expected)


@exactly
@given(samples.photo_observations())
def test_observations_come_back_exactly_and_in_order(written):
    found = round_trip("A.EXO", lambda store: observations.write(store, written), observations.read)
    assert samples.same(found, written)


@exactly
@given(samples.photo_observations(), st.sampled_from([1, 1 << 20]))
def test_observations_have_the_same_digest_without_arrays(written, cells_of_part):
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(store, "CELLS_OF_PART", cells_of_part)
        found, plain = round_trip(
            "A.EXO",
            lambda opened: observations.write(opened, written),
            lambda opened: (observations.read(opened), observations.read_plain(opened)),
        )
    assert len(plain.points) == len(found.points)
    assert digest_of_columns((plain.photos, plain.points), plain.numbers) == digest_of_observations(found)


@exactly
@given(samples.photo_orientations())
def test_orientations_have_the_same_digests_without_arrays(written):
    found, digests = round_trip(
        "Z.PHO",
        lambda opened: PHOTO_ORIENTATIONS.write(opened, written),
        lambda opened: (PHOTO_ORIENTATIONS.read(opened), PHOTO_ORIENTATIONS.digests(opened)),
    )
    assert digests == tuple(map(record_digest, found.values()))


@exactly
@given(samples.any_solution())
def test_any_solution_comes_back_exactly(written):
    found = round_trip(
        "Z.EXT", lambda store: solutions.write(store, written), lambda store: solutions.read(store, written.bundle)
    )
    assert samples.same(found, written)


def test_a_rich_solution_comes_back_exactly():
    written = samples.rich_solution()
    found = round_trip(
        "Z.EXT", lambda store: solutions.write(store, written), lambda store: solutions.read(store, "main")
    )
    assert samples.same(found, written)


def test_numpy_scalars_in_a_solution_come_back_as_plain_numbers():
    rich = samples.rich_solution()
    written = replace(rich, redundancy=np.int64(214), sigma0=np.float64(1.5), status=np.str_("converged"))
    found = round_trip(
        "Z.EXT", lambda store: solutions.write(store, written), lambda store: solutions.read(store, "MAIN")
    )
    assert samples.same(found, replace(rich, redundancy=214, sigma0=1.5, status="converged"))


def test_negative_zero_becomes_zero_and_keeps_the_digest():
    written = [StoredRecord(Temtick("T", (Mark("1", -0.0, 1.0),)))]
    found = round_trip("T.TIK", lambda store: TEMTICKS.write(store, written), TEMTICKS.read)
    assert str(found[0].record.ticks[0].x) == "0.0"
    assert record_digest(found[0].record) == record_digest(written[0].record)


def test_a_solution_replaces_that_of_its_bundle_only(tmp_path):
    path = tmp_path / "Z.EXT"
    with writing([path]) as stores:
        for name in ("MAIN", "second", "ä"):
            solutions.write(stores[path], samples.rich_solution(name))
    with writing([path]) as stores:
        shorter = replace(samples.rich_solution("Main"), warnings=())
        solutions.write(stores[path], shorter)
        solutions.delete(stores[path], "Ä")
        solutions.delete(stores[path], "never solved")
    with reading([path]) as stores:
        assert bundles(stores[path]) == ("Main", "second")
        assert samples.same(solutions.read(stores[path], "MAIN"), shorter)
        assert samples.same(solutions.read(stores[path], "SECOND"), samples.rich_solution("second"))
        assert solutions.read(stores[path], "ä") is None


def test_a_solution_with_arrays_of_different_lengths_is_refused(tmp_path):
    path = tmp_path / "Z.EXT"
    with pytest.raises(ValueError, match="shorter"), writing([path]) as stores:
        solutions.write(stores[path], replace(samples.rich_solution(), point_rays=np.array([1])))


def test_writing_definitions_keeps_orientations_and_solutions(tmp_path):
    stores_of = samples.filled_stores(tmp_path)
    pho, ext = tmp_path / "Z.PHO", tmp_path / "Z.EXT"
    with writing([pho, ext]) as stores:
        stores_of[pho](stores[pho])
        stores_of[ext](stores[ext])
        PHOTOS.write(stores[pho], [StoredRecord(Photo("other", "C"))])
        BUNDLES.write(stores[ext], [StoredRecord(BundleDefinition("other"))])
    with reading([pho, ext]) as stores:
        assert [item.record.name for item in PHOTOS.read(stores[pho])] == ["other"]
        assert list(PHOTO_ORIENTATIONS.read(stores[pho])) == ["P1", "P2"]
        assert bundles(stores[ext]) == ("MAIN",)


@pytest.mark.parametrize(("first", "second"), [("OLYMPUS", "Olympus"), ("ä", "Ä"), ("A", "A")])
def test_records_whose_names_differ_in_case_alone_are_refused(tmp_path, first, second):
    path = tmp_path / "C.CAM"
    twins = [StoredRecord(Camera(name, (0.0,) * 13)) for name in (first, second)]
    with pytest.raises(InputError, match=f"'{first}' and '{second}' are one name"), writing([path]) as stores:
        CAMERAS.write(stores[path], twins)


def test_a_record_that_breaks_a_rule_is_bad_input(tmp_path):
    path = tmp_path / "C.CAM"
    wrong = Camera("A", (0.0,) * 13, additional_set="BROWN")
    with pytest.raises(InputError, match=r"C\.CAM: a record breaks a rule.*additional_set"), writing([path]) as stores:
        CAMERAS.write(stores[path], [StoredRecord(wrong)])


def test_text_that_is_no_unicode_is_bad_input(tmp_path):
    path = tmp_path / "C.CAM"
    with pytest.raises(InputError, match="udce4"), writing([path]) as stores:
        provenance.write_inputs(stores[path], "init", [("M\udce4r.toml", "0")])


def test_a_store_knows_its_run_and_inputs(tmp_path):
    path = tmp_path / "Z.PHO"
    with writing([path]) as stores:
        assert provenance.run_of(stores[path]) is None
        provenance.set_run(stores[path], "run-1")
        provenance.write_inputs(stores[path], "init", [("orip.toml", "aa")])
        provenance.write_inputs(stores[path], "measure", [("S2.MEA", "bb"), ("S10.MEA", "cc")])
        provenance.write_inputs(stores[path], "init", [("orip.toml", "dd")])
    with reading([path]) as stores:
        assert provenance.run_of(stores[path]) == "run-1"
        assert provenance.read_meta(stores[path]) == {"kind": "PHO", "run": "run-1"}
        assert provenance.read_inputs(stores[path], "init") == (("orip.toml", "dd"),)
        assert provenance.read_inputs(stores[path], "measure") == (("S2.MEA", "bb"), ("S10.MEA", "cc"))
        assert provenance.read_inputs(stores[path], "solve") == ()


def test_a_digest_tells_case_and_values_apart():
    base = Temtick("T", (Mark("1", 0.0, 1.0),))
    assert record_digest(base) == record_digest(Temtick("T", (Mark("1", -0.0, 1),)))
    others = [Temtick("t", base.ticks), Temtick("T", ()), Temtick("T", (Mark("1", 0.0, np.nextafter(1.0, 2.0)),))]
    assert len({record_digest(item) for item in [base, *others]}) == 4


def test_a_digest_depends_neither_on_the_name_of_a_class_nor_on_the_order_of_its_fields():
    renamed = defstruct("Renamed", ["ticks", "name"])
    marks = (Mark("1", 0.0, 1.0),)
    assert record_digest(renamed(marks, "T")) == record_digest(Temtick("T", marks))
    assert record_digest(renamed(marks, "U")) != record_digest(Temtick("T", marks))


def test_a_digest_of_what_is_no_record_is_refused():
    with pytest.raises(TypeError, match="Path has no canonical form"):
        record_digest((Path("a"),))


@pytest.mark.long
def test_a_million_observations_are_written_and_read_within_half_a_minute(tmp_path):
    n = 1_300_000
    path = tmp_path / "BIG.EXO"
    generator = np.random.default_rng(1)
    written = PhotoObservations(
        "BIG",
        tuple(f"P{number // 1300}" for number in range(n)),
        tuple(str(1000 + number % 1300) for number in range(n)),
        generator.normal(size=(n, 2)),
        np.full((n, 2), np.nan),
        np.zeros(n, dtype=bool),
    )
    began = time.monotonic()
    with writing([path]) as stores:
        observations.write(stores[path], written)
    with reading([path]) as stores:
        found = observations.read(stores[path])
    # On a laptop it takes some 5 s: half a minute tells slowness of another order from a busy machine.
    assert time.monotonic() - began < 30
    assert samples.same(found, written)


def _marks(values: list[float], name: str = "1") -> MeasuredMarks:
    array = np.array(values).reshape(-1, 2)
    return MeasuredMarks((name,) * len(array), array, np.zeros(len(array), dtype=bool), np.full(array.shape, np.nan))


@given(st.lists(st.floats(allow_nan=True) | st.sampled_from([0.0, -0.0]), min_size=2, max_size=2))
def test_records_are_the_same_as_their_digests_are(values: list[float]) -> None:
    for other in (_marks(values), _marks([0.0, 1.0]), _marks(values * 2), _marks(values, "2")):
        assert same_record(_marks(values), other) == (record_digest(_marks(values)) == record_digest(other))


def test_no_solution_is_not_the_same_as_one() -> None:
    assert same_record(None, None)
    assert not same_record(None, _marks([1.0, 2.0]))
