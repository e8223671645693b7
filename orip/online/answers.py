"""What is answered to a measurement: its state, how it fits, what was found out about others."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from orip.sequential.observation_rows import ObservationKey

State = Literal["waiting", "unchecked", "included", "suspect", "excluded"]
"""Waiting: its photo or point has no preliminary values yet. Unchecked: included, but an error in it would not show, or
not in both directions. Suspect: it does not fit and takes no part until it is measured again, included by the operator,
or cleared by further measurements. Excluded: by the operator."""


class Suspect(Struct, frozen=True):
    """An observation that does not fit.

    Parameters
    ----------
    key : ObservationKey
    w : float
        Root of the fall of the square sum when it is left out, a-priori errors.
    limit : float
    alike : tuple of ObservationKey
        Others that an error could be in just as well.
    """

    key: ObservationKey
    w: float
    limit: float
    alike: tuple[ObservationKey, ...]


class Candidate(Struct, frozen=True):
    """A measurement that would be worth making.

    Parameters
    ----------
    photo, point : str
        Point: empty for a new one.
    xy : tuple
        Stored coordinates at which it is expected.
    ellipse : tuple or None
        Semi-axes (mm) of the standard ellipse of this position, and the direction of the larger one, degrees from the x
        axis of the photo; None: not known.
    gain : float
        Information about the block, bits.
    why : str
    """

    photo: str
    point: str
    xy: tuple[float, float]
    ellipse: tuple[float, float, float] | None
    gain: float
    why: str


class Answer(Struct, frozen=True):
    """What a measurement did.

    Parameters
    ----------
    photo, point : str
    state : State
    text : str
        In a sentence: what it waits for, or how it fits.
    w, limit : float or None
        Root of the fall of the square sum when it is left out, and its limit; None: not tested.
    redundancy : tuple of float
        Redundancy numbers of x and y; none before it is included.
    sigma0 : float or None
        Of all observations that are in; None without redundancy.
    sigma0_before : float or None
    suspects : tuple of Suspect
        Observations that this measurement has shown to be wrong.
    cleared : tuple of ObservationKey
        Suspects that fit now.
    oriented : tuple of str
        Photos that are oriented since.
    placed : tuple of str
        Points that have coordinates since.
    next : tuple of Candidate
        What to measure next in this photo, the most profitable first.
    is_pending : bool
        It is not tested yet: what it changes has to be computed first, and the test follows.
    """

    photo: str
    point: str
    state: State
    text: str
    w: float | None = None
    limit: float | None = None
    redundancy: tuple[float, ...] = ()
    sigma0: float | None = None
    sigma0_before: float | None = None
    suspects: tuple[Suspect, ...] = ()
    cleared: tuple[ObservationKey, ...] = ()
    oriented: tuple[str, ...] = ()
    placed: tuple[str, ...] = ()
    next: tuple[Candidate, ...] = ()
    is_pending: bool = False


def words_of(key: ObservationKey) -> str:
    """Return an observation in words: ``101 in P3``, ``control point 7``, ``X0 of P1``."""
    if key.kind == "photo":
        return f"{key.point} in {key.photo}"
    if key.kind == "control":
        return f"control point {key.point}"
    owner = key.photo or key.point
    return f"{key.kind} {owner} {key.component}".strip()
