"""Plural forms, counted nouns and lists of names of messages and listings."""

import pytest

from orip.wording import agreeing, counted, counted_names, first_names, joined, listed_names


@pytest.mark.parametrize(("number", "text"), [(0, "0 photos"), (1, "1 photo"), (2, "2 photos")])
def test_noun_agrees_with_its_number(number: int, text: str) -> None:
    assert counted(number, "photo") == text


def test_verb_agrees_with_its_number() -> None:
    assert [agreeing(number, "is", "are") for number in range(3)] == ["are", "is", "are"]


@pytest.mark.parametrize(
    ("words", "text"), [([], ""), (["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_words_are_joined(words: list[str], text: str) -> None:
    assert joined(words) == text


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["101"], "photo 101"),
        (["101", "102"], "photos 101 and 102"),
        (["101", "102", "103"], "photos 101, 102 and 103"),
        (["101", "102", "103", "104"], "photos 101, 102, 103 and 1 more"),
    ],
)
def test_names_stand_after_their_noun(names: list[str], text: str) -> None:
    assert counted_names("photo", names) == text


def test_long_lists_of_names_end_with_their_number() -> None:
    assert first_names(["a", "b", "c"], 3) == "a, b, c"
    assert first_names(["a", "b", "c", "d", "e"], 3) == "a, b, c and 2 more"


def test_known_names_may_be_none_or_many() -> None:
    assert listed_names([]) == "none"
    assert listed_names(str(k) for k in range(100)).endswith("18, 19 and 80 more")
