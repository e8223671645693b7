"""Allan variance: closed forms of noise that is known, and the command."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from support.json_schemas import schema_faults

from orip.stations.inertial.allan import FLICKER, allan_variance, axis_noise

STEP = 0.01
WHITE, FLAT, WALK = 7e-5, 2e-5, 4e-6


def times(hours: float) -> np.ndarray:
    return np.arange(round(hours * 3600.0 / STEP)) * STEP


def white(count: int, random: np.random.Generator, density: float = WHITE) -> np.ndarray:
    return density / np.sqrt(STEP) * random.standard_normal(count)


def walk(count: int, random: np.random.Generator, density: float = WALK) -> np.ndarray:
    return np.cumsum(density * np.sqrt(STEP) * random.standard_normal(count))


def flicker(count: int, random: np.random.Generator) -> np.ndarray:
    """Return noise of the double-sided power density B² / (2π f)."""
    density = FLAT**2 / (2.0 * np.pi * np.fft.rfftfreq(count, STEP)[1:])
    phases = random.standard_normal(len(density)) + 1j * random.standard_normal(len(density))
    return np.fft.irfft(np.append(0.0, np.sqrt(density * count / STEP / 2.0) * phases), count)


def test_a_ramp_and_a_sequence_that_can_be_computed_by_hand():
    time = times(0.2)
    tau, variance, _ = allan_variance(time, 3e-6 * time)
    np.testing.assert_allclose(variance, (3e-6 * tau) ** 2 / 2.0, rtol=1e-6)
    # +1, -1, +1 ...: neighbours differ by 2, averages of two by 0
    tau, variance, _ = allan_variance(time, np.where(np.arange(len(time)) % 2, -1.0, 1.0))
    assert variance[0] == pytest.approx(2.0)
    assert variance[np.isclose(tau, 2.0 * STEP)] == pytest.approx(0.0, abs=1e-12) or tau[1] > 2.5 * STEP


@pytest.mark.parametrize(
    ("noise", "form"),
    [
        (white, lambda tau: WHITE**2 / tau),
        (walk, lambda tau: WALK**2 * tau / 3.0),
        (flicker, lambda tau: FLICKER * FLAT**2 + 0.0 * tau),
    ],
    ids=["white", "walk", "flicker"],
)
def test_closed_forms(noise, form):
    time = times(1.0)
    tau, variance, count = allan_variance(time, noise(len(time), np.random.default_rng(3)))
    # from ten samples on the discrete forms are those of the continuous ones to 1 %
    seen = (tau > 10 * STEP) & (count > 30)
    ratio = variance[seen] / form(tau[seen])
    assert (np.abs(ratio - 1.0) < 0.02 + 4.0 * np.sqrt(2.0 / count[seen])).all(), ratio


def test_parameters_of_noise_of_all_kinds():
    """Three hours: random walk is good to 1 %, what shows at long times to some ten of a hundred."""
    time = times(3.0)
    found = []
    for seed in range(4):
        random = np.random.default_rng(seed)
        values = sum(one(len(time), random) for one in (white, flicker, walk))
        axis = axis_noise(time, values)
        found.append((axis.random_walk / WHITE, axis.instability / FLAT, axis.bias_walk / WALK))
    mean = np.mean(found, axis=0)
    assert (np.abs(mean - 1.0) < [0.01, 0.35, 0.3]).all(), found
    np.testing.assert_allclose(np.array(found)[:, 0], 1.0, atol=0.02)


def test_samples_that_are_not_even_in_time():
    random = np.random.default_rng(1)
    steps = STEP * random.uniform(0.7, 1.3, 200_000)
    values = WHITE / np.sqrt(steps) * random.standard_normal(len(steps))
    assert axis_noise(np.cumsum(steps), values).random_walk == pytest.approx(WHITE, rel=0.05)


def record(folder: Path, hours: float, **change: float) -> None:
    random = np.random.default_rng(5)
    time = times(hours)
    count = len(time)
    rate = np.column_stack([white(count, random) for _ in range(3)]) + np.array([1e-3, 0.0, 0.0])
    force = np.column_stack([white(count, random, 6e-4) for _ in range(3)]) + np.array([0.0, 0.0, -9.83])
    if "moves" in change:
        rate[count // 2 :] += [0.0, change["moves"], 0.0]
    table = np.column_stack([time, force, rate])
    text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in table)
    (folder / "standing.csv.gz").write_bytes(gzip.compress(text.encode(), 1))


def test_the_command(tmp_path):
    record(tmp_path, 0.25)
    said = orip(tmp_path, "imu", "noise", "standing.csv.gz", "--json")
    assert said.code == 0, said.err
    assert schema_faults(said.document) == []
    noise = said.document["noise"]
    np.testing.assert_allclose(noise[:2], [WHITE, 6e-4], rtol=0.03)
    assert noise[4] == pytest.approx(1e-3 - 7.3e-5, rel=0.05)  # what is not the rotation of the Earth
    assert 0.01 < noise[5] < 0.04
    assert all(value > 0.0 for value in noise)
    text = orip(tmp_path, "imu", "noise", "standing.csv.gz").err
    assert "random walk 0.239, 0.24" in text  # 7e-5 rad/s/sqrt(Hz) are 0.2406 degrees/sqrt(h)
    assert f"--noise {noise[0]:.3g}," in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["standing.csv.gz"]


def test_what_is_no_standing_record(tmp_path):
    record(tmp_path, 0.1, moves=0.1)
    assert "the unit moves 180 s after the beginning" in orip(tmp_path, "imu", "noise", "standing.csv.gz").err
    record(tmp_path, 0.01)
    assert "the record lasts 36 s; 120 s are needed" in orip(tmp_path, "imu", "noise", "standing.csv.gz").err
    assert "there is no such file" in orip(tmp_path, "imu", "noise", "none.csv").err
