"""How large the errors of a block that is being measured are, and the limits of the tests that follow from that."""

from __future__ import annotations

import numpy as np

from orip.adjustment.outlier_tests import OutlierTest
from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.online.online_block import OnlineBlock

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
    block : OnlineBlock
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
