"""Additional parameters of self-calibration as weighted unknowns: each is observed as zero with an a-priori error."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orip.bundle.kinds.observation import KindEquations, Linearisation, Observations, Rows
from orip.bundle.state import BlockState
from orip.bundle.unknowns import Unknowns
from orip.interior.additional_parameters import PARAMETER_SETS, base_of_camera, default_error
from orip.records.block import Block
from orip.records.observation_kinds import ADDITIONAL_PARAMETER


class AdditionalParameterObservations(Observations, frozen=True):
    """n parameters observed as zero; `camera` and `parameter` (n,) say which."""

    rows: Rows
    camera: NDArray[np.int64]
    parameter: NDArray[np.int64]

    def linearise_with_partials(self, state: BlockState) -> Linearisation:
        """Return the values themselves and partials by them."""
        residual = state.additional[self.camera, self.parameter]
        return Linearisation(residual, np.ones((len(residual), 1)), np.ones(len(residual), dtype=bool))


def observe_additional_parameters(block: Block, unknowns: Unknowns) -> AdditionalParameterObservations:
    """Return the unknown parameters of all cameras that have a set."""
    found = [
        (row, parameter, name)
        for row, camera in enumerate(block.cameras)
        if camera.additional_set is not None
        for parameter, name in enumerate(PARAMETER_SETS[camera.additional_set].parameter_names)
        if (camera.name, name) not in block.held_additional
    ]
    camera = np.array([row for row, *_ in found], dtype=np.int64)
    parameter = np.array([index for _, index, _ in found], dtype=np.int64)
    errors = [_error(block, row, index) for row, index, _ in found]
    rows = Rows(
        kind=ADDITIONAL_PARAMETER,
        photo=("",) * len(found),
        point=tuple(block.cameras[row].name for row in camera),
        component=tuple(name for *_, name in found),
        observed=np.zeros(len(found)),
        error=np.array(errors, dtype=np.float64),
        used=np.ones(len(found), dtype=bool),
        columns=unknowns.additional[camera, parameter][:, None],
    )
    return AdditionalParameterObservations(rows, camera, parameter)


def _error(block: Block, row: int, parameter: int) -> float:
    camera = block.cameras[row]
    assert camera.additional_set is not None
    mine = block.photo_camera[block.photo_points.photo] == row
    photo_error = float(np.mean(block.photo_points.error[mine])) if mine.any() else 1.0
    return default_error(camera.additional_set, parameter, base_of_camera(camera), photo_error)


KINDS = (KindEquations(ADDITIONAL_PARAMETER, observe_additional_parameters),)
