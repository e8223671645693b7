"""Line numbers of keys, tables and array elements of a TOML text."""

from __future__ import annotations

from orip.files.project.toml_lines import TomlLines

TEXT = '''\
# [no.header]
[project]
"name" = "a # [b] = c"
[[camera]]   # first
c = 1.5
distortion.A1 = 2
distortion . "A 3" = 3
fiducials = [
  { name = "1", x = [1, 2] },  # ] }
  # comment with " and [
  { name = '2',
    x = 1 },
]
[[camera]]
text = """
[[camera]]
c = 9 \\"""
"""
c = 2
[camera.sensor]
rows = 4
[[bundle]]
[[bundle.model]]
row = 1
[[bundle.model]]
row = 2
[[bundle]]
model = [{ row = 1 }, { row = 5 }]
[[bundle.model.x]]
last = \'\'\'
\'\'\'\'
'''


def line_of(*path: str | int) -> int:
    return TomlLines(TEXT).line_of(path)


def test_keys_and_tables() -> None:
    assert line_of("project") == 2
    assert line_of("project", "name") == 3
    assert line_of("camera", 0) == 4
    assert line_of("camera", 0, "c") == 5
    assert line_of("camera", 1) == 14
    assert line_of("camera", 1, "c") == 19
    assert line_of("camera", 1, "sensor", "rows") == 21


def test_dotted_and_quoted_keys() -> None:
    assert line_of("camera", 0, "distortion") == 6
    assert line_of("camera", 0, "distortion", "A 3") == 7


def test_elements_of_arrays_and_inline_tables() -> None:
    assert line_of("camera", 0, "fiducials", 0, "x", 1) == 9
    assert line_of("camera", 0, "fiducials", 1, "name") == 11
    assert line_of("camera", 0, "fiducials", 1, "x") == 12


def test_nested_tables_are_counted_within_their_table() -> None:
    assert line_of("bundle", 0, "model", 0, "row") == 24
    assert line_of("bundle", 0, "model", 1, "row") == 26
    assert line_of("bundle", 1, "model", 1, "row") == 28


def test_what_is_missing_is_where_it_should_be() -> None:
    assert line_of("camera", 1, "name") == 14
    assert line_of("photo") == 1
    assert line_of() == 1


def test_a_key_of_a_quoted_form_that_is_no_toml_is_kept_as_it_is() -> None:
    assert TomlLines('"a\\q" = 1').line_of(('"a\\q"',)) == 1
