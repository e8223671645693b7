"""Stages found by two-colouring the models."""

from __future__ import annotations

from orip.records.definition import StereoModel, plan_stages
from orip.records.photo import Photo, Stage, Template


def models(*pairs: str) -> list[StereoModel]:
    return [StereoModel(pair, pair[0], pair[1], 1, column) for column, pair in enumerate(pairs, start=1)]


def photos(names: str, template: str | None = None) -> list[Photo]:
    return [Photo(name, "CAM", template) for name in names]


def test_a_strip_alternates_and_begins_on_the_upper_stage() -> None:
    plan = plan_stages(photos("ABCD"), [], models("AB", "BC", "CD"))
    assert plan.stages == {"A": "UPPER", "B": "LOWER", "C": "UPPER", "D": "LOWER"}
    assert not plan.unsuited


def test_stages_that_are_set_stay_and_decide_for_the_rest() -> None:
    strip = [*photos("AB"), Photo("C", "CAM", stage="LOWER")]
    assert plan_stages(strip, [], models("AB", "BC")).stages == {"A": "LOWER", "B": "UPPER", "C": "LOWER"}


def test_the_photos_of_a_template_share_its_stage() -> None:
    block = [*photos("AC", "T1"), *photos("bd", "t2")]
    stages: dict[str, Stage] = {"A": "LOWER", "C": "LOWER", "B": "UPPER", "D": "UPPER"}
    plan = plan_stages(block, [Template("t1", "G"), Template("T2", "G", "UPPER")], models("AB", "bC", "Cd"))
    assert (plan.stages, plan.unsuited) == (stages, ())


def test_models_that_no_stages_suit_are_named() -> None:
    triangle = plan_stages(photos("ABC"), [], models("AB", "BC", "CA"))
    assert [model.name for model in triangle.unsuited] == ["BC"]
    one_template = plan_stages(photos("AB", "T"), [Template("T", "G")], models("AB"))
    assert [model.name for model in one_template.unsuited] == ["AB"]


def test_photos_of_no_model_have_no_stage() -> None:
    assert plan_stages(photos("A"), [], []).stages == {}
