"""What a reader of a file returns: the records, and everything that is wrong or doubtful in the text."""

from __future__ import annotations

from typing import Generic, TypeVar

from msgspec import Struct

from orip.errors import Complaint, ProjectWarning

T = TypeVar("T")


class Parsed(Struct, Generic[T], frozen=True):
    """The outcome of reading one file.

    A reader never stops at the first fault. The caller gathers the complaints of all files and raises one
    `orip.errors.InputError`; the value is good for use only where there are no complaints.

    Parameters
    ----------
    value : T
    complaints : tuple of Complaint
        In the order of the file's lines as far as they have one.
    warnings : tuple of ProjectWarning
    """

    value: T
    complaints: tuple[Complaint, ...] = ()
    warnings: tuple[ProjectWarning, ...] = ()
