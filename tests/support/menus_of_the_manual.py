"""The menus of ORIPROGRAM's manual (Dueholm 1989) with their keys."""

from __future__ import annotations

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
