"""Results compared figure by figure."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.records.results.tests import Figure, FigureGroup, Quantity, ResultFigures
from orip.solving.differences import Tolerance, compare_figures


def result(kind: str = "point", name: str = "1", **figures: Figure) -> ResultFigures:
    return {(kind, name): FigureGroup(f"{kind} {name}", figures)}


def adjusted(value: float, quantity: Quantity = "other", sd: float | None = None) -> Figure:
    return Figure(value, quantity, sd, adjusted=True)


def differs(a: Figure, b: Figure, **tolerance: float) -> bool:
    return not compare_figures(result(F=a), result(F=b), Tolerance(**tolerance)).equal


@pytest.mark.parametrize(
    ("a", "b", "size"),
    [(179.9, -179.9, 0.2), (-180.0, 180.0, 0.0), (359.0, 1.0, 2.0), (10.0, 370.0, 0.0), (-90.0, 90.0, 180.0)],
)
def test_angles_differ_on_the_circle(a: float, b: float, size: float) -> None:
    found = compare_figures(result(F=adjusted(a, "angle")), result(F=adjusted(b, "angle")), Tolerance())
    if size == 0.0:
        assert found.equal
    else:
        (difference,) = found.differences
        assert difference.size == pytest.approx(size)


def test_absolute_and_relative_tolerance_add_up() -> None:
    assert not differs(Figure(1000.0, "other"), Figure(1000.0015, "other"), absolute=0.0006, relative=1e-6)
    assert differs(Figure(1000.0, "other"), Figure(1000.0015, "other"), absolute=0.0004, relative=1e-6)
    assert differs(Figure(1.0, "other"), Figure(1.0 + 1e-15, "other"), absolute=0.0, relative=0.0)


def test_ground_coordinates_are_measured_by_the_extent_not_by_the_origin() -> None:
    def block(origin: float, shift: float) -> ResultFigures:
        west, east = adjusted(origin, "ground"), adjusted(origin + 100.0 + shift, "ground")
        return {**result(name="1", X=west), **result(name="2", X=east)}

    for origin in (0.0, 5e6):
        assert compare_figures(block(origin, 0.0), block(origin, 5e-5), Tolerance()).equal
        assert not compare_figures(block(origin, 0.0), block(origin, 2e-4), Tolerance()).equal


def test_the_principal_point_is_measured_by_the_principal_distance() -> None:
    def camera(dx: float) -> ResultFigures:
        return result("camera", "C", C=adjusted(35.0, "photo"), DX=adjusted(dx, "photo"))

    assert compare_figures(camera(1e-6), camera(2e-5), Tolerance()).equal
    assert not compare_figures(camera(1e-6), camera(1e-4), Tolerance()).equal


def test_an_absolute_tolerance_of_coefficients_is_one_of_their_effect() -> None:
    a, b = (Figure(value, "other", adjusted=True, effect=1e7) for value in (1.0e-10, 1.1e-10))
    assert not differs(a, b, absolute=2e-4, relative=0.0)
    assert differs(a, b, absolute=5e-5, relative=0.0)


def test_a_small_value_is_measured_by_its_deviation() -> None:
    assert not differs(adjusted(1e-12, sd=1e-3), adjusted(2e-10, sd=1e-3), absolute=0.0)
    assert differs(adjusted(1e-12, sd=1e-3), adjusted(2e-8, sd=1e-3), absolute=0.0)


def test_sigma_looks_at_adjusted_values_alone() -> None:
    def point(x: float, sd: float) -> ResultFigures:
        return result(X=adjusted(x, "ground", sd), **{"X sd": Figure(sd, "other"), "rays": Figure(sd, "other")})

    a, b = point(0.0, 3.0), point(5.0, 4.0)
    one = compare_figures(a, b, Tolerance(sigma=1.0))
    assert one.equal
    assert one.compared == 1
    (difference,) = compare_figures(a, b, Tolerance(sigma=0.9)).differences
    assert (difference.size, difference.allowed) == (5.0, 4.5)


def test_sigma_of_constants_is_the_tolerance() -> None:
    assert not differs(adjusted(1.0), adjusted(1.0 + 1e-7), sigma=3.0)
    assert differs(adjusted(1.0), adjusted(1.1), sigma=3.0)


@pytest.mark.parametrize(("a", "b"), [(None, 1.0), ("singular", 1.0), ("singular", None), ("converged", "doubtful")])
def test_what_is_no_number_on_one_side_comes_first(a: float | str | None, b: float | str | None) -> None:
    one = {**result(name="1", F=Figure(a, "text")), **result(name="2", F=Figure(0.0, "other"))}
    other = {**result(name="1", F=Figure(b, "text")), **result(name="2", F=Figure(1e9, "other"))}
    found = compare_figures(one, other, Tolerance())
    assert [difference.name for difference in found.differences] == ["point 1 F", "point 2 F"]
    assert compare_figures(one, one, Tolerance()).equal


def test_largest_first_by_what_is_allowed() -> None:
    a = result(A=Figure(0.0, "other"), B=Figure(1e6, "other"), D=Figure(1.0, "other"))
    b = result(A=Figure(0.0, "other"), B=Figure(1e6 + 10, "other"), D=Figure(1.1, "other"))
    found = compare_figures(a, b, Tolerance())
    assert [difference.name for difference in found.differences] == ["point 1 D", "point 1 B"]


def test_names_that_one_has_alone() -> None:
    shared = {"X": adjusted(1.0), "X sd": Figure(0.1, "other")}
    a = {**result(name="1", **shared), **result(name="2", **shared)}
    b = {**result(name="1", **shared, B11=adjusted(1.0), **{"B11 sd": Figure(0.1, "other")}), **result("photo", "p")}
    found = compare_figures(a, b, Tolerance())
    assert found.only_a == ("point 2",)
    assert found.only_b == ("photo p", "point 1 B11")
    assert not found.equal
    assert not found.differences


numbers = st.floats(-1e6, 1e6) | st.none() | st.just("singular")
quantities = st.sampled_from(["ground", "angle", "photo", "other"])


@given(st.lists(st.tuples(numbers, numbers, quantities), max_size=5))
def test_both_ways_are_the_same_and_a_result_equals_itself(rows: list[tuple[float, float, Quantity]]) -> None:
    a, b = ({("point", str(number)): FigureGroup(str(number), {"F": Figure(row[side], row[2], adjusted=True)})
             for number, row in enumerate(rows)} for side in (0, 1))  # fmt: skip
    exact = Tolerance(0.0, 0.0)
    assert compare_figures(a, a, exact).equal
    there, back = compare_figures(a, b, Tolerance()), compare_figures(b, a, Tolerance())
    assert [(difference.name, difference.size) for difference in there.differences] == [
        (difference.name, difference.size) for difference in back.differences
    ]
