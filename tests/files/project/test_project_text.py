"""A project definition as text: it says what was meant, and keeps what its owner wrote."""

from __future__ import annotations

import tomllib

import pytest
from files.any_project import project_definitions
from files.full_project import FULL
from hypothesis import given, settings
from hypothesis import strategies as st

from orip.files.project.merge import merged_project_text
from orip.files.project.reader import parse_project
from orip.files.project.records import project_document, project_text
from orip.files.project.toml_text import toml_key, toml_value
from orip.records.definition import ProjectDefinition
from orip.records.photo import Photo
from orip.structs import replace


def read(text: str) -> ProjectDefinition:
    parsed = parse_project(text)
    assert parsed.complaints == ()
    assert parsed.value is not None
    return parsed.value.definition


@given(project_definitions())
@settings(max_examples=60, deadline=None)
def test_any_definition_written_and_read_is_the_same(definition: ProjectDefinition) -> None:
    document = project_document(definition)
    text = project_text(document)
    assert read(text) == definition
    assert project_text(project_document(read(text))) == text


@given(project_definitions(), project_definitions())
@settings(max_examples=40, deadline=None)
def test_any_text_brought_up_to_any_definition_says_the_same(old: ProjectDefinition, new: ProjectDefinition) -> None:
    heading = {
        key: getattr(old, key) for key in ("name", "user", "project_files", "control_files", "ground_unit", "crs")
    }
    wanted = replace(new, **heading, gates=old.gates)
    assert read(merged_project_text(project_text(project_document(old)), wanted)) == wanted


values = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(max_size=5), values, max_size=3))
@settings(max_examples=100)
def test_any_value_written_and_read_is_the_same(table: dict[str, object]) -> None:
    text = "".join(f"{toml_key(key)} = {toml_value(value)}\n" for key, value in table.items())
    assert tomllib.loads(text) == table


def test_every_key_of_a_full_project_file_comes_back() -> None:
    assert read(project_text(project_document(read(FULL)))) == read(FULL)


COMMENTED = """\
# survey of 1987

project = { name = "Z" }   # short

# the old camera
[[camera]]
name = "O"
c = 8.5          # calibrated

[[camera]]
name = "N"       # new
c = 9
frame = [
  24,            # height
  36,
]

# ---- photos ----
[[photo]]
name = "P1"
camera = "O"     # not N!
[[photo]]
name = "P2"
camera = "O"
# end
"""


def test_a_text_that_says_it_already_stays_as_it_is() -> None:
    assert merged_project_text(COMMENTED, read(COMMENTED)) == COMMENTED
    assert merged_project_text(COMMENTED.rstrip("\n"), read(COMMENTED)) == COMMENTED


def test_comments_of_records_that_have_not_changed_stay() -> None:
    old = read(COMMENTED)
    camera = replace(old.cameras[0], parameters=(8.75, *old.cameras[0].parameters[1:]))
    new = replace(old, cameras=(camera, *old.cameras[1:]), photos=(*old.photos, Photo("P3", "N")))
    text = merged_project_text(COMMENTED, new)
    assert read(text) == new
    added = '\n[[photo]]\nname = "P3"\ncamera = "N"\n'
    assert text == COMMENTED.replace("c = 8.5 ", "c = 8.75 ") + added


def test_keys_that_come_and_go_leave_the_others_alone() -> None:
    old = read(COMMENTED)
    cameras = replace(old.cameras[0], unknown=("C",)), replace(old.cameras[1], frame=None)
    text = merged_project_text(COMMENTED, replace(old, cameras=cameras))
    expected = COMMENTED.replace("# calibrated\n", '# calibrated\nunknown = ["C"]\n')
    start, end = expected.index("frame ="), expected.index("\n# ---- photos")
    assert text == expected[:start] + expected[end:]


def test_a_deleted_record_takes_its_comments_along() -> None:
    old = read(COMMENTED)
    text = merged_project_text(COMMENTED, replace(old, cameras=old.cameras[:1]))
    assert "new" not in text
    assert "# the old camera" in text
    assert "# ---- photos ----" in text


def test_kinds_of_records_stay_in_their_order() -> None:
    text = '[project]\nname = "Z"\n\n# first\n[[bundle]]\nname = "M"\n\n[[camera]]\nname = "C"\nc = 1.0\n'
    old = read(text)
    new = replace(old, cameras=(replace(old.cameras[0], unknown=("C",)),))
    assert merged_project_text(text, new) == f'{text}unknown = ["C"]\n'


INLINE = """\
project = { name = "Z" }
camera = [{ name = "O", c = 8.5 }, { name = "N", c = 9 }]
"""
WITH_TABLE_OF_ITS_OWN = """\
[project]
name = "Z"
[[camera]]
name = "O"
c = 8.5
[camera.sensor]
columns = 1
rows = 1
width = 1
height = 1
"""
OUT_OF_ORDER = """\
[[camera]]
name = "O"
c = 8.5
[[temtick]]
name = "T"
[[camera]]
name = "N"
c = 9
[project]
name = "Z"
"""


@pytest.mark.parametrize("text", [INLINE, WITH_TABLE_OF_ITS_OWN, OUT_OF_ORDER])
def test_texts_of_another_build(text: str) -> None:
    old = read(text)
    camera = replace(old.cameras[-1], unknown=("C",))
    new = replace(old, cameras=(*old.cameras[:-1], camera))
    assert read(merged_project_text(text, old)) == old
    assert read(merged_project_text(text, new)) == new
