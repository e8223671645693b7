"""Normal equations that serve for one more correction near the solution, with misclosures of the state there.

The corrections of Gauss and Newton become smaller so quickly there that the last one mostly shows only that nothing is
left to correct. For that the right-hand side has to be new, not the matrix (simplified Newton; Deuflhard 2011): it is
the same solution, for a pass over the observations in place of the formation and factorisation of normal equations.
"""

from __future__ import annotations

from typing import Generic

import numpy as np
from msgspec import Struct

from orip.adjustment.equations import Equations, Layout, Linearised, StateT
from orip.adjustment.iteration_state import IterationRecord
from orip.adjustment.normals import SolvedNormals
from orip.arrays import FloatArray
from orip.structs import replace

_WORTH_IT = 20_000
"""Observations from which normal equations are held: below, an iteration takes a few milliseconds."""

_NEAR_ENP, _NEXT_GAIN = 0.5, 1.5
"""ENP from which they are held; and how many times the digits of the last correction the next one gains."""

_SAME_PLACE_ENP = 3.0
"""ENP of a correction from which normal equations before it are those after it: it is a thousandth of the standard
deviations, and changes partials by less than the rounding of printed figures."""

_SAME_MATRIX_DIGITS = 3.5
"""Digits that a correction with held normal equations gains where these are those of the solution too: what is left of
a correction shows by what part the matrix has changed with it."""


class FormedNormals(Struct, Generic[StateT], frozen=True):
    """The normal equations of an iteration.

    Parameters
    ----------
    at : Linearised
        Where they were formed.
    normals : SolvedNormals
    weights : array (n,)
        Weight factors.
    served_before : bool
        The last correction is not the first one with them.
    """

    at: Linearised[StateT]
    normals: SolvedNormals
    weights: FloatArray
    served_before: bool = False

    def have_weights(self, equations: Equations, weights: FloatArray) -> bool:
        """Return whether other equations have the same weights (n,), those of inactive observations aside."""
        mine = self.at.equations.effective(self.weights)
        return bool(np.array_equal(mine, equations.effective(weights)))

    def solved_again(self, equations: Equations, layout: Layout) -> FormedNormals[StateT]:
        """Return them with the correction at another linearisation."""
        roots = np.sqrt(equations.effective(self.weights))
        misclosure = -roots * np.where(equations.active, equations.residual, 0.0)
        normals = self.normals.with_right_side(equations.rows.right_side(roots, misclosure, layout))
        return replace(self, normals=normals, served_before=True)

    def are_of_solution(self, records: tuple[IterationRecord, ...]) -> bool:
        """Return whether they are the normal equations where the last of the iterations ended, within rounding."""
        last = records[-1].enp
        if self.served_before:
            before = records[-2].enp
            return before >= _SAME_PLACE_ENP or last - before >= _SAME_MATRIX_DIGITS
        return last >= _SAME_PLACE_ENP


def will_do(formed: FormedNormals[StateT], records: tuple[IterationRecord, ...], enp_stop: float) -> bool:
    """Return whether the normal equations of the last iteration are enough for what is probably the last correction."""
    equations = formed.at.equations
    if (
        formed.served_before
        or equations.has_exact_constraints
        or len(records) < 2
        or len(equations.residual) < _WORTH_IT
    ):
        return False
    last = records[-1].enp
    next_gain = _NEXT_GAIN * (last - records[-2].enp)
    # else they would have to be formed at the end all the same
    are_of_next = last >= _SAME_PLACE_ENP or next_gain >= _SAME_MATRIX_DIGITS
    return last >= _NEAR_ENP and last + next_gain >= enp_stop and are_of_next
