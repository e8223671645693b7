"""What helps a network most, against forecasts of the network with it."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from cli.command_line import orip
from planning.planned_blocks import planned, settings
from workflow.small_projects import REPOSITORY

from orip.bundle.additions.candidates import distance_candidates, network_of, photo_candidates, with_rays
from orip.bundle.additions.placing import Wanted, place_in_block
from orip.bundle.additions.search import place_greedily, with_all
from orip.planning.forecast import forecast
from orip.records.control import ControlDistance
from orip.records.photo import Photo
from orip.structs import replace


@pytest.fixture(scope="module")
def block():
    return planned(settings(tie_points=20, cross_strips=2, cross_height=1.2))


@pytest.fixture(scope="module")
def network(block):
    return network_of(forecast(block).solved, 1000, tied=True)


def test_distances_are_worth_what_a_forecast_with_them_says(block, network):
    candidates, pairs = distance_candidates(network, 0.002, 100.0)
    assert all(np.linalg.norm(network.points[end] - network.points[start]) <= 100.0 for start, end in pairs)
    chosen = [0, len(candidates) // 2, len(candidates) - 1]
    updated = np.sqrt(with_all(network.covariance, [candidates[one] for one in chosen]).diagonal()[network.of_points])
    distances = []
    for number, (start, end) in enumerate(pairs[chosen].tolist()):
        length = float(np.linalg.norm(network.points[end] - network.points[start]))
        names = network.names
        distances.append(ControlDistance(f"D{number}", names[start], names[end], "XYZ", length, 0.002))
    found = forecast(replace(block, distances=tuple(distances)))
    assert np.allclose(found.point_sd[network.rows], updated, rtol=1e-4)
    assert (updated < np.sqrt(network.covariance.diagonal()[network.of_points]) - 1e-6).any()


def test_photos_are_worth_at_most_what_a_forecast_with_them_says(block, network):
    """Their rays to points that few photos show, and some of the others, are not counted."""
    candidates, orientation = photo_candidates(network, 0, 60)
    lens = network.of_camera(0, "C")
    found = place_greedily(network.covariance, candidates, np.array([lens]), 2, "camera")
    chosen = orientation[list(found.chosen)]
    photos = tuple(Photo(f"N{number}", block.photos[0].camera) for number in range(2))
    more = with_rays(
        replace(
            block,
            photos=(*block.photos, *photos),
            photo_camera=np.zeros(len(block.photos) + 2, dtype=np.int64),
            photo_orientation=np.vstack([block.photo_orientation, chosen]),
        ),
        block.photo_points.error[0],
    )
    exact = forecast(more).camera_sd("C")
    assert exact <= found.value * 1.001
    assert found.value <= 1.3 * exact
    assert found.value < 0.9 * found.curve[0]


def test_an_adjusted_block_asks_for_its_own_points(tmp_path):
    folder = tmp_path / "drone"
    shutil.copytree(REPOSITORY / "sample_projects" / "drone_rtk", folder)
    assert orip(folder, "init").code == orip(folder, "measure").code == 0
    given = orip(folder, "plan", "place", "2", "--adjusted", "--places", "40", "--json").document
    assert given["value"] < given["curve"][0]
    distances = orip(
        folder, "plan", "place", "1", "--adjusted", "--places", "40", "--what", "distances", "--longest", "90", "--json"
    ).document["distances"]
    assert 0.0 < distances[0]["distance"] <= 90.0
    measured = (folder / "DRONE.MEA").read_text(encoding="utf-8")
    names = [point["name"] for point in given["points"]] + [distances[0]["start"], distances[0]["end"]]
    assert all(f" {name} " in f" {' '.join(measured.split())} " for name in names)


def test_a_free_network_has_no_control(block):
    free = replace(block, definition=replace(block.definition, datum="free"), stations=())
    solved = forecast(free).solved
    with pytest.raises(Exception, match="free network has no control points"):
        place_in_block(solved, Wanted("control", 1, "largest", 20, 0.01))
    found = place_in_block(solved, Wanted("distances", 1, "largest", 20, 0.001))
    assert found.placement.value <= found.placement.curve[0]
    assert len(found.distances) == 1
