"""Other forms of the radial distortion beside tangential and affine parameters, as a camera's record has them."""

from __future__ import annotations

import pytest

from orip.records.camera import CAMERA_PARAMETERS, Camera
from orip.structs import replace
from orip.workflow.records.reconcile import with_polynomial

OTHERS = {"P1": 1e-5, "P2": -2e-5, "B1": 3e-4, "B2": -1e-4}


def camera(**parameters: float) -> Camera:
    values = {"C": 8.5, **OTHERS, **parameters}
    return Camera("O", tuple(values.get(name, 0.0) for name in CAMERA_PARAMETERS))


def test_the_isp_form_beside_tangential_and_affine_parameters() -> None:
    isp = replace(camera(), distortion_isp=(10.0, 2e-5, -3e-8, 0.0))
    # D = R (a1 (R^2 - R0^2) + a2 (R^4 - R0^4)), written out in powers of R
    plain = camera(A1=-(2e-5 * 10.0**2 - 3e-8 * 10.0**4), A3=2e-5, A5=-3e-8)
    # nothing but the rounding of four products
    assert with_polynomial(isp).parameters == pytest.approx(plain.parameters, rel=1e-14)
