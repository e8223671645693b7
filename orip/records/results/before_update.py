"""What `orip update` replaced, so that the last update can be undone."""

from __future__ import annotations

from typing import Literal, TypeAlias

from msgspec import Struct

Kept: TypeAlias = "float | tuple[Kept, ...] | None"
"""The value of a field: a number, none, or several."""


class RecordBefore(Struct, frozen=True):
    """A camera or photo before an update.

    Parameters
    ----------
    name : str
    fields : tuple of (str, Kept)
        The fields that the update has changed, as they were.
    updated : str
        `record_digest` of the record that the update has made.
    """

    name: str
    fields: tuple[tuple[str, Kept], ...]
    updated: str


class TextBefore(Struct, frozen=True):
    """BUNDLE.PRE before an update.

    Parameters
    ----------
    text : str or None
        None: there was none.
    updated : str
        Digest of the file that the update has made.
    """

    text: str | None
    updated: str


class BeforeUpdate(Struct, frozen=True):
    """What the last update replaced: records, or the text of a bundle's preliminary points.

    Parameters
    ----------
    what : {"cameras", "photos", "points"}
    bundle, run : str
        The adjustment that the update took its values from.
    records : tuple of RecordBefore
    text : TextBefore or None
    """

    what: Literal["cameras", "photos", "points"]
    bundle: str
    run: str
    records: tuple[RecordBefore, ...] = ()
    text: TextBefore | None = None
