"""What the first page of the report says beside the results, as the user gives it."""

from __future__ import annotations

from msgspec import Struct


class ReportDetails(Struct, frozen=True):
    """The table `[report]` of orip.toml; texts that are not given are empty.

    Parameters
    ----------
    title : str
        Heading of the report; empty: the project's name.
    client, contractor, author : str
        For whom, by which company and by whom the work was done.
    order : str
        Number or name of the order.
    location : str
    flown : str
        When the photos were taken.
    date : str
        Of the report; it is not taken from the clock, so that equal inputs give equal pages.
    equipment : str
        Camera, aircraft, receiver.
    remarks : tuple of str
        Paragraphs.
    """

    title: str = ""
    client: str = ""
    contractor: str = ""
    author: str = ""
    order: str = ""
    location: str = ""
    flown: str = ""
    date: str = ""
    equipment: str = ""
    remarks: tuple[str, ...] = ()
