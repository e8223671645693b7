"""Terms of a camera that a format has no place for."""

from __future__ import annotations

from collections.abc import Sequence

from orip.errors import InputError
from orip.records.exchanged import ExchangedCamera

_NOTHING = 1e-12


def require_without(camera: ExchangedCamera, terms: Sequence[str], format_title: str) -> None:
    """Check that a camera has none of some terms.

    Raises
    ------
    InputError
        If it has, as the camera that is written would be another one.
    """
    found = [term for term in terms if abs(camera.parameters.get(term, 0.0)) > _NOTHING]
    if found:
        message = (
            f"camera {camera.name}: {format_title} has no place for its terms {', '.join(found)} "
            "(B1, B2 and A9 of orip give such); adjust without them, or export another format"
        )
        raise InputError.single(message)
