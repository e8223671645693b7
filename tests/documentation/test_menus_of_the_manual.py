"""The page for those who know ORIPROGRAM has every menu of the manual (Dueholm 1989), and every key of each."""

from __future__ import annotations

import re

import pytest
from documentation.pages import DOCS

LIST = ("Insert", "Add", "Edit", "Kill")
MARKS = (
    "Re-Measure Point", "Re-Measure All", "Measure All", "Insert Point", "Disregard Point", "Include Point",
    "Add Point", "Edit Point", "Kill Point", "Kill All", "Transformation",
)  # fmt: skip
POINTS = (*(key for key in MARKS if key != "Transformation"), "Re-Measure Down Weighted")


def keys_of_list(what: str) -> tuple[str, ...]:
    return (*(f"{key} {what}" for key in LIST), "Kill All")


MENUS: dict[str, tuple[str, ...]] = {
    "1": (
        "Initialize Project", "Define Project", "Enter Control", "Measure Orientation", "Compute Bundle Adjustment",
        "Test Menu", "Print Results", "Stop Program",
    ),
    "1.1": (
        "Camera File", "Temtick File", "Project Files", "Control Files", "Project Name", "Users Name", "Plates Forward",
    ),
    "1.2": (),
    "1.3": ("Control Points", "Control Elements", "Control Distances", "Preliminary Values"),
    "1.3.1": keys_of_list("Point"),
    "1.3.2": keys_of_list("Element"),
    "1.3.3": keys_of_list("Distance"),
    "1.3.4": keys_of_list("Point"),
    "1.4": ("Camera Data", "Temtick Data", "Define Photo", "Define Template", "Define Bundle"),
    "1.4.1": (
        "Inspect File", "Camera Record Name", "Camera Constant (C)", "Principal Point (X, Y)",
        "Distortion, A1; A3; A5; A7", "Frame size in X and Y", "Fiducial Marks", "Constant/Unknown", "Distortion Curve",
        "Distortion ISP Parameters", "Down Load Distortion",
    ),
    "1.4.1.1": (*keys_of_list("Point"), "Transform Coordinates"),
    "1.4.1.2": ("Distortion, R0; A1; A2; A3", "Compute Parameters"),
    "1.4.1.3": (*keys_of_list("Point"), "Compute Parameters"),
    "1.4.2": ("Temtick Record Name", "Tick Marks", "Inspect File"),
    "1.4.2.1": keys_of_list("Point"),
    "1.4.3": (
        "Photo Record Name", "Camera Name", "Template Name", "Projection Center, X0; Y0; Z0",
        "Rotation, Omega; Phi; Kappa", "Constant/Unknown", "Inspect File",
    ),
    "1.4.4": ("Template Record Name", "Temtick Name", "List Photos", "Inspect File"),
    "1.4.4.1": keys_of_list("Photo"),
    "1.4.5": (
        "Bundle Adjustment Name", "Observation File Name", "Measurement Precision", "ENP-Stop",
        "Maximum Number of Iterations", "Start Down Weight", "Maximum Standard Residual",
        "Maximum Number of Lost Digits", "List Models", "Inspect File",
    ),
    "1.4.5.1": keys_of_list("Model"),
    "1.5": ("Template Orientation", "Photo Orientation", "Template Photos", "Bundle Mono", "Bundle Stereo"),
    "1.5.1": MARKS,
    "1.5.2": MARKS,
    "1.5.3": POINTS,
    "1.5.4": (
        *(key for key in POINTS if key != "Measure All"), "Measure Point All", "Next Model", "Change Model",
    ),
    "1.6": (
        "Solve Bundle", "Stop Solve", "Camera Results", "Photo Results", "Point Results", "Compute Preliminary Values",
        "Down Load Models",
    ),
    "1.6.1": ("Camera Name", "Update Preliminary Values"),
    "1.6.2": ("Photo Name", "Update Preliminary Values"),
    "1.6.3": ("Update Preliminary Values",),
    "1.6.4": (
        "Relative Orientation Model", "Bridge Models", "Connect Strips", "Relative Orientation All", "Bridge All",
        "Connect All", "Absolute Orientation", "Print Results", "Update Values", "Model Coordinates", "Next Model",
        "Change Model",
    ),
}  # fmt: skip
COMMON_KEYS = ("Help", "Main Menu", "Return", "DSR11")


def sections() -> dict[str, str]:
    """Return the sections of the page by the number of their menu."""
    text = (DOCS / "oriprogram.md").read_text(encoding="utf-8")
    return {body.split(maxsplit=1)[0]: body for body in re.split(r"^#+ ", text, flags=re.MULTILINE) if body}


def answers(section: str) -> dict[str, str]:
    """Return what is said of each key of a section."""
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", section, re.MULTILINE)
    return {key: answer for keys, answer in rows for key in (keys, *keys.split(", "))}


@pytest.mark.parametrize("menu", MENUS)
def test_every_key_has_an_answer(menu: str) -> None:
    found = answers(sections()[menu])
    assert [key for key in MENUS[menu] if not any(key == word or word.startswith(f"{key} (") for word in found)] == []


def test_no_menu_is_made_up() -> None:
    assert [number for number in sections() if number[0].isdigit()] == list(MENUS)


def test_keys_of_all_menus() -> None:
    assert set(COMMON_KEYS) <= {key.partition(" (")[0] for key in answers(sections()["Keys"])}
