"""Names of files that are made of names of other things."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from orip.exchange.project.texts import project_title
from orip.files.project.file_names import file_name_fault, fit_file_name


@given(st.text() | st.text("abcäß", min_size=190, max_size=260))
@example("NUL")
@example("com1.txt")
@example("..")
@example("ß" * 101)
def test_what_is_made_fit_is_fit(name: str) -> None:
    assert file_name_fault(fit_file_name(name)) is None


@given(st.text())
@example("NUL")
@example("__aux__")
@example("lpt1")
def test_the_title_of_an_import_can_name_its_files(title: str) -> None:
    assert file_name_fault(project_title(title)) is None
