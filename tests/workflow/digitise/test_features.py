"""Points, lines and areas collected at an emulated plate processor, across the models of the block."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from support.sample_projects import sample
from workflow.commands import initialise, write_drive_table
from workflow.digitise.digitising_bench import Bench
from workflow.quiet import run_quietly

from orip.errors import InputError, OripError, UsageError
from orip.files.log.stereo import read_stereo
from orip.multimodel.digitising.features import FeatureCode, FeaturesChoice, digitise_features, feature_codes

ROAD, TREE, HOUSE = FeatureCode("LINE", "ROAD"), FeatureCode("POINT", "TREE"), FeatureCode("AREA", "HOUSE")
FILE = Path("STEREO.STE")


@pytest.fixture(scope="module")
def solved_cliff(tmp_path_factory):
    folder = sample(tmp_path_factory.mktemp("cliff"), "small_frame_block")
    run_quietly(folder)
    write_drive_table(folder, None)
    return folder


@pytest.fixture
def cliff(solved_cliff, tmp_path):
    folder = Path(shutil.copytree(solved_cliff, tmp_path / "cliff"))
    return Bench(folder, (folder / "MAIN.DRV").read_bytes())


def collected(bench, script, *codes, **choice):
    return digitise_features(bench.means(script), None, FeaturesChoice(codes, FILE, **choice))


def features(bench):
    read = read_stereo(bench.folder / FILE, "STEREO.STE", is_growing=True)
    assert not read.complaints
    return {
        f"{one.kind} {one.code} {one.name}": [(vertex.left, vertex.right) for vertex in one.vertices]
        for one in read.value
    }


def test_a_line_goes_on_from_model_to_model(cliff):
    found = collected(
        cliff, "FOOT RIGHT;MOVE 14 0;FOOT RIGHT;MOVE 14 0;FOOT RIGHT;KEY ENTER;FOOT RIGHT;MOVE 0 1;FOOT RIGHT;KEY ZERO",
        ROAD,
    )  # fmt: skip
    assert found.ending == "ended by the operator"
    assert features(cliff) == {
        "LINE ROAD 1": [("101", "102"), ("101", "102"), ("102", "103")],
        "LINE ROAD 2": [("102", "103"), ("102", "103")],
    }
    assert [entry.owner for entry in found.entries] == ["1-1", "1-1", "1-2", "1-2", "1-2"]
    assert orip(cliff.folder, "restitute", "compute", "STEREO.STE").code == 0
    shown = json.loads(orip(cliff.folder, "restitute", "show", "--json").out)
    (road, across) = shown["features"]
    # the mark is moved in the object by what was asked; Y is the depth, and 1e-4 mm in a photo are millimetres of it
    assert road["length"] == pytest.approx(28.0, abs=5e-3)
    assert across["length"] == pytest.approx(1.0, abs=5e-3)


def test_codes_are_chosen_by_keys_and_points_are_numbered(cliff):
    script = "KEY 2;FOOT RIGHT;MOVE 1 0;FOOT RIGHT;KEY 3;FOOT RIGHT;MOVE 1 0;FOOT RIGHT;MOVE 0 1;FOOT RIGHT;KEY ENTER"
    collected(
        cliff, f"{script};NAME BARN;FOOT RIGHT;MOVE 0 1;FOOT RIGHT;MOVE 1 0;FOOT RIGHT;KEY ZERO", ROAD, TREE, HOUSE
    )
    pair = ("101", "102")
    assert features(cliff) == {
        "POINT TREE 1": [pair], "POINT TREE 2": [pair], "AREA HOUSE 1": [pair] * 3, "AREA HOUSE BARN": [pair] * 3
    }  # fmt: skip


def test_what_lacks_vertices_is_not_left_and_goes_on_later(cliff):
    found = collected(cliff, "FOOT RIGHT;KEY ENTER;KEY ZERO", ROAD)
    assert sum("has 1 of at least 2 vertices" in said for said in cliff.said) == 2
    assert (found.ending, [warning.code for warning in found.warnings]) == ("no further input", ["unfinished"])
    with pytest.raises(OripError, match="has 1 of at least 2 vertices"):
        collected(cliff, "KEY ZERO", TREE)
    collected(cliff, "MOVE 1 0;FOOT RIGHT;KEY ZERO", TREE, ROAD)
    assert features(cliff) == {"LINE ROAD 1": [("101", "102")] * 2}
    assert any(said.startswith("going on with LINE ROAD 1, vertex 2") for said in cliff.said)


def test_the_left_foot_takes_the_last_vertex_back(cliff):
    found = collected(cliff, "FOOT LEFT;FOOT RIGHT;MOVE 1 0;FOOT RIGHT;FOOT LEFT;MOVE 0 1;FOOT RIGHT;KEY ZERO", ROAD)
    assert features(cliff) == {"LINE ROAD 1": [("101", "102")] * 2}
    assert [entry.outcome for entry in found.entries] == ["digitised", "digitised", "skipped", "digitised"]
    assert any("nothing that was measured in this run is left" in said for said in cliff.said)


def test_it_begins_in_the_model_that_is_named(cliff):
    collected(cliff, "FOOT RIGHT;KEY ZERO", TREE, model="2-3", first="T5")
    assert features(cliff) == {"POINT TREE T5": [("203", "204")]}
    before = np.array(cliff.line.station.state.plates)
    with pytest.raises(UsageError, match="no model 9-9"):
        collected(cliff, "FOOT RIGHT", TREE, model="9-9")
    assert np.array_equal(cliff.line.station.state.plates, before)


def test_nothing_is_collected_without_a_table(tmp_path):
    folder = sample(tmp_path / "new", "small_frame_block")
    initialise(folder)
    with pytest.raises(OripError):
        collected(Bench(folder), "FOOT RIGHT", TREE)
    assert not (folder / FILE).exists()


@pytest.mark.parametrize("words", [["ROAD"], ["LINE:"], ["CURVE:ROAD"], ["LINE:ROAD"] * 10, ["LINE:A B"], []])
def test_codes_that_are_none_are_refused(words):
    with pytest.raises(UsageError, match="name one to 9, each as POINT:CODE, LINE:CODE, AREA:CODE"):
        feature_codes(words)
    assert feature_codes(["line:ROAD"]) == (ROAD,)


def test_a_bundle_without_models_is_refused(cliff):
    assert orip(cliff.folder, "model", "delete", "--all", "--yes").code == 0
    with pytest.raises(InputError, match="has no models to see in stereo"):
        collected(cliff, "FOOT RIGHT", TREE)
