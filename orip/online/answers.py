"""What is answered to a measurement, how large the errors of the block are, and the limits that follow from them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from msgspec import Struct

from orip.adjustment.outlier_tests import OutlierTest
from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.online.block.online_block import OnlineBlock
from orip.online.sequential.observation_rows import ObservationKey

State = Literal["waiting", "unchecked", "included", "suspect", "excluded"]
"""Waiting: its photo or point has no preliminary values yet. Unchecked: included, but an error in it would not show, or
not in both directions. Suspect: it does not fit and takes no part until it is measured again, included by the operator,
or cleared by further measurements. Excluded: by the operator."""


class Suspect(Struct, frozen=True):
    """An observation that does not fit.

    Parameters
    ----------
    w : float
        Root of the fall of the square sum when it is left out, a-priori errors.
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
    gain : float or None
        Information about the block, bits; None where it cannot be told yet: the photo or the point is not placed.
    """

    photo: str
    point: str
    xy: tuple[float, float]
    ellipse: tuple[float, float, float] | None
    gain: float | None
    why: str


class Answer(Struct, frozen=True):
    """What a measurement did.

    Parameters
    ----------
    text : str
        In a sentence: what it waits for, or how it fits.
    w, limit : float or None
        Root of the fall of the square sum when it is left out, and its limit; None: not tested.
    redundancy : tuple of float
        Redundancy numbers of x and y; none before it is included.
    sigma0 : float or None
        Of all observations that are in; None without redundancy.
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


_ENOUGH = 40
"""Redundancy from which the observations tell how large their errors are."""

_SAMPLE = 200
"""Photo points that these are estimated from."""

_WELL_CHECKED = 0.1
"""Redundancy number from which an observation counts for that."""

_TOO_SMALL = 2.0
"""Estimated errors over those a priori up to which the latter are believed."""

_LATER = 0.1
"""Part by which the observations have to increase before it is estimated again."""


class ErrorScale:
    """How many times too small the a-priori errors are: 1 unless the observations show much more.

    Parameters
    ----------
    alpha : float
        Error probability of the test of one observation.
    """

    def __init__(self, block: OnlineBlock, alpha: float) -> None:
        self._block, self._test = block, OutlierTest(alpha, 1.0, None)
        self._scale, self._next = 1.0, 0

    @property
    def is_believed(self) -> bool:
        """Return whether the a-priori errors explain the observations."""
        return self._scale == 1.0

    def limit(self, checked: int) -> float:
        """Return the limit of the root of a fall of the square sum, of so many equations that are checked."""
        return self._scale * self._test.group_limit(checked)

    def estimate_again(self) -> None:
        """Estimate it now, what was wrong having been taken out."""
        self._next = 0
        self.estimated()

    def estimated(self) -> bool:
        """Estimate it from the median of what is in; False: not enough has been measured since that was done.

        A sample of the photo points serves: half of it may be wrong.
        """
        equations = self._block.equations
        if equations.redundancy < _ENOUGH or len(equations.included) < self._next:
            return False
        self._next = int(len(equations.included) * (1.0 + _LATER))
        keys = [key for key in equations.included if key.kind == "photo"]
        sample = keys[:: max(1, len(keys) // _SAMPLE)]
        w = np.concatenate([standing.normalised(_WELL_CHECKED) for standing in equations.standings(sample)])
        w = np.abs(w[np.isfinite(w)])
        scale = float(np.median(w)) / MEDIAN_OF_NORMAL if len(w) >= _ENOUGH else 1.0
        self._scale = scale if scale > _TOO_SMALL else 1.0
        return True
