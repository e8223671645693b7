"""Orip's camera as a lens of another program: by closed formulas where that holds it, else fitted over the frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.exchange.conversion.lens_exact import Polynomial
from orip.exchange.conversion.lens_fit import RATIONAL, RadialProfile, fitted_parameters, fitted_rational
from orip.exchange.conversion.lens_table import LENSES
from orip.records.exchanged import Lens

_EXACT = 1e-9
"""Of the largest coordinate: a hundred thousandth of a pixel."""

_AS_GOOD = 1.2
"""A lens with fewer terms is taken where its largest misfit is up to this factor that of one with more."""

_NOT_FITTED = ("ex", "ey", "c4", "c5", "p3", "p4", "r0", "k5", "k6", "s2", "s4")
"""Parameters that others stand for, or that are better left alone; those of the rational model are its own matter."""

_DECENTRING = ("p1", "p2")
"""Not fitted where the camera has none."""

_MORE_TERMS: Mapping[Lens, tuple[tuple[str, ...], ...]] = {
    "opencv": (("k3", "k4", "k5", "k6"), ("k4", "k5", "k6")),
    "equidistant": (("p1", "p2", "s1", "s3"), ("s1", "s3")),
}
"""Terms that a lens is first tried without, one set after the other."""


class LensOfCamera(Struct, frozen=True):
    """Parameters of a lens that stands for a camera.

    Parameters
    ----------
    parameters : mapping of str to float
        All of the lens, by name.
    residuals : array (n, 2)
        What the lens leaves over the frame, in its unit; zeros where it is exact.
    """

    parameters: Mapping[str, float]
    residuals: FloatArray

    @property
    def worst(self) -> float:
        """Return the length of the largest residual; infinite where one is no number."""
        length = float(np.hypot(*self.residuals.T).max())
        return length if np.isfinite(length) else np.inf


def lens_of_polynomial(
    polynomial: Polynomial,
    lens: Lens,
    directions: FloatArray,
    image: FloatArray,
    terms: tuple[str, ...] | None = None,
    *,
    enough: float = 0.0,
) -> LensOfCamera:
    """Return the parameters of a lens that images directions where a camera does.

    Parameters
    ----------
    polynomial : Polynomial
        The camera, in the axes of the lens.
    lens : Lens
        One whose formula gives image coordinates, or ``measured``.
    directions, image : arrays (n, 2)
        Over the frame.
    terms : tuple of str, or None
        Parameters that may differ from 0; None: all.
    enough : float
        Misfit in the unit of the lens up to which fewer terms are preferred.
    """
    formula = LENSES[lens]
    allowed = formula.names if terms is None else terms
    start = dict.fromkeys(formula.names, 0.0)
    start |= {name: value for name, value in _CLOSED[lens](polynomial).items() if name in allowed}

    def misfit(values: Mapping[str, Any]) -> Any:
        given, wanted = (image, directions) if formula.gives_directions else (directions, image)
        found = np.stack(formula.formula(values, *given.T), axis=1) - wanted
        return found * polynomial.c if formula.gives_directions else found

    residuals = misfit(start)
    if np.abs(residuals).max() <= _EXACT * np.abs(image).max():
        return LensOfCamera(start, np.zeros_like(residuals))
    held = (*_NOT_FITTED, *RATIONAL, *(() if _is_decentred(polynomial) else _DECENTRING))
    found: list[LensOfCamera] = []
    for without in (*_MORE_TERMS.get(lens, ()), ()):
        if terms is not None and without and not set(without) & set(terms):
            continue
        names = tuple(name for name in allowed if name not in (*without, *held))
        fitted = fitted_parameters({**start, **dict.fromkeys(without, 0.0)}, names, misfit)
        found.append(LensOfCamera(fitted, misfit(fitted)))
        if found[-1].worst <= enough:
            return found[-1]
    if lens == "opencv" and set(RATIONAL) <= set(allowed):
        profile = RadialProfile.of(directions, image, polynomial.point, polynomial.c)
        rational = fitted_rational(start, profile, misfit, held)
        found += [] if rational is None else [LensOfCamera(rational, misfit(rational))]
    best = min(one.worst for one in found)
    return next(one for one in found if one.worst <= max(enough, _AS_GOOD * best))


def _is_decentred(polynomial: Polynomial) -> bool:
    return any(polynomial.coefficients.get(name) for name in ("P1", "P2"))


def _opencv(p: Polynomial) -> dict[str, float]:
    term, grown, c = _terms(p)
    return {
        "fx": grown + c * term("B1"), "fy": grown, "cx": p.point[0], "cy": p.point[1],
        "k1": term("A3") * c**3 / grown, "k2": term("A5") * c**5 / grown, "k3": term("A7") * c**7 / grown,
        "p1": term("P2") * c**2 / grown, "p2": term("P1") * c**2 / grown,
    }  # fmt: skip


def _agisoft(p: Polynomial) -> dict[str, float]:
    term, grown, c = _terms(p)
    return {
        "f": grown, "cx": p.point[0], "cy": p.point[1], "b1": c * term("B1"), "b2": c * term("B2"),
        "k1": term("A3") * c**3 / grown, "k2": term("A5") * c**5 / grown, "k3": term("A7") * c**7 / grown,
        "k4": term("A9") * c**9 / grown, "p1": term("P1") * c**2 / grown, "p2": term("P2") * c**2 / grown,
    }  # fmt: skip


def _fraser(p: Polynomial) -> dict[str, float]:
    term, grown, c = _terms(p)
    part = c / grown
    return {
        "f": grown, "cx": p.point[0], "cy": p.point[1], "b1": part * term("B1"), "b2": part * term("B2"),
        "c1": term("A3") * part**3, "c2": term("A5") * part**5, "c3": term("A7") * part**7, "c4": term("A9") * part**9,
        "p1": term("P1") * part**2, "p2": term("P2") * part**2,
    }  # fmt: skip


def _measured(p: Polynomial) -> dict[str, float]:
    sign = -1.0
    found = {"f": p.c, "cx": p.point[0], "cy": p.point[1]}
    for name, own in (("A3", "k1"), ("A5", "k2"), ("A7", "k3"), ("P1", "p1"), ("P2", "p2"), ("B1", "b1"), ("B2", "b2")):
        found[own] = sign * p.coefficients.get(name, 0.0)
    return found


def _equidistant(p: Polynomial) -> dict[str, float]:
    term, grown, c = _terms(p)
    radial = {f"k{n}": term(f"A{2 * n + 1}") * c ** (2 * n + 1) / grown for n in (1, 2, 3, 4)}
    decentring = {"p1": term("P2") * c**2 / grown, "p2": term("P1") * c**2 / grown}
    plane = {"fx": grown + c * term("B1"), "fy": grown, "cx": p.point[0], "cy": p.point[1]}
    return {**plane, **radial, **decentring}


def _pinhole(p: Polynomial) -> dict[str, float]:
    return {"f": p.c, "fx": p.c, "fy": p.c, "cx": p.point[0], "cy": p.point[1]}


def _terms(p: Polynomial) -> tuple[Callable[[str], float], float, float]:
    """Return the terms of a polynomial at ideal coordinates by name, C (1 + A1), and C.

    One at measured coordinates has them, for small distortions, with the other sign.
    """
    sign = -1.0 if p.at_measured else 1.0

    def term(name: str) -> float:
        return sign * p.coefficients.get(name, 0.0)

    return term, p.c * (1.0 + term("A1")), p.c


_CLOSED: Mapping[Lens, Callable[[Polynomial], dict[str, float]]] = {
    "opencv": _opencv,
    "agisoft": _agisoft,
    "fraser": _fraser,
    "measured": _measured,
    "isp": _pinhole,
    "division": _pinhole,
    "fov": _pinhole,
    "eucm": _pinhole,
    "angle_polynomial": _pinhole,
    "equidistant": _equidistant,
    "fisheye624": _equidistant,
    "agisoft_fisheye": _agisoft,
}
