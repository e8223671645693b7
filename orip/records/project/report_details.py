"""What the first page of the report says beside the results, as the user gives it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Struct

from orip.records.project.fields import Field


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

    title: Annotated[str, Field(text="line", example='"Quarry Hohenfels, flight 3"')] = ""
    client: Annotated[str, Field(text="line", example='"Kalkwerk Hohenfels GmbH"')] = ""
    contractor: Annotated[str, Field(text="line", example='"Vermessung Huber"')] = ""
    author: Annotated[str, Field(text="line", example='"K. Huber"')] = ""
    order: Annotated[str, Field(text="line", example='"2026-117"')] = ""
    location: Annotated[str, Field(text="line", example='"Hohenfels"')] = ""
    flown: Annotated[str, Field(text="date", example="2026-04-28")] = ""
    date: Annotated[str, Field(text="date", example="2026-05-04")] = ""
    equipment: Annotated[str, Field(text="line", example='"DJI M3E, RTK by SAPOS"')] = ""
    remarks: Annotated[
        tuple[str, ...], Field(text="line", example='["Signalled points were set out by the client."]')
    ] = ()
