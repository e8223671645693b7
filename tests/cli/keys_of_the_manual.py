"""Keys of ORIPROGRAM's manual that define a project, its control and its measurements: command and effect.

The project that they are carried out in is the sample `small_frame_block`, measured; photos 101, 102 and 103 have an
observed Z0, and the points E1 and E2 preliminary coordinates.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple


class Key(NamedTuple):
    """A key, the command or the commands for it, a command that shows what it has done, and what that has to show.

    `shown`: the names of a list in their order, or values of a record (of a list: of the record with that name).
    """

    menu: str
    key: str
    words: str
    look: str
    shown: tuple[str, ...] | dict[str, Any]


_MARKS = ("1", "2", "3", "4", "5", "6", "7", "8")
_PHOTOS = tuple(f"{strip}0{number}" for strip in (1, 2) for number in range(1, 7))
_MODELS = tuple(f"{row}-{column}" for row in (1, 2) for column in range(1, 6))
_CURVE = "[[5,0.010],[8,0.018],[11,0.030],[14,0.040],[17,0.055]]"

CAMERA = (
    Key("1.4.1", "Inspect File", "camera rename REFLEX35 F3", "camera list", ("F3",)),
    Key("1.4.1", "Inspect File", "camera copy REFLEX35 F3", "camera list", ("REFLEX35", "F3")),
    Key("1.4.1", "Camera Record Name", "camera add F3 c=50", "camera show F3", {"c": 50.0}),
    Key("1.4.1", "Camera Constant (C)", "camera edit REFLEX35 c=35.2", "camera show REFLEX35", {"c": 35.2}),
    Key(
        "1.4.1", "Principal Point (X, Y)", "camera edit REFLEX35 principal_point=0.012,-0.034", "camera show REFLEX35",
        {"principal_point": [0.012, -0.034]},
    ),
    *(
        Key(
            "1.4.1", "Distortion, A1; A3; A5; A7", f"camera edit REFLEX35 distortion.{name}=-2e-9",
            "camera show REFLEX35", {f"distortion.{name}": -2e-9},
        )
        for name in ("A1", "A3", "A5", "A7")
    ),
    Key(
        "1.4.1", "Frame size in X and Y", "camera edit REFLEX35 frame=32,20.5", "camera show REFLEX35",
        {"frame": [32.0, 20.5]},
    ),
    Key(
        "1.4.1", "Constant/Unknown", "camera edit REFLEX35 unknown=C,A3", "camera show REFLEX35",
        {"unknown": ["C", "A3"]},
    ),
    Key(
        "1.4.1", "Distortion Curve", f"camera edit REFLEX35 distortion= distortion_curve={_CURVE}",
        "camera show REFLEX35", {"distortion_curve": json.loads(_CURVE)},
    ),
    Key(
        "1.4.1", "Distortion ISP Parameters",
        "camera edit REFLEX35 distortion_isp='{R0=14,A1=1e-6,A2=-2e-9,A3=1e-12}'", "camera show REFLEX35",
        {"distortion_isp.R0": 14.0, "distortion_isp.A3": 1e-12},
    ),
    Key(
        "1.4.1.1", "Insert Point", "camera edit REFLEX35 fiducials.9='{x=0.0,y=1.5}'", "camera show REFLEX35",
        {"fiducials.9.x": 0.0, "fiducials.9.y": 1.5, "fiducials.8.x": -18.05},
    ),
    Key(
        "1.4.1.1", "Add Point", "camera edit REFLEX35 fiducials.N.x=1 fiducials.N.y=2", "camera show REFLEX35",
        {"fiducials.N.x": 1.0, "fiducials.N.y": 2.0},
    ),
    Key(
        "1.4.1.1", "Edit Point", "camera edit REFLEX35 fiducials.5.x=0.5", "camera show REFLEX35",
        {"fiducials.5.x": 0.5, "fiducials.5.y": -12.029},
    ),
    Key(
        "1.4.1.1", "Kill Point", "camera edit REFLEX35 fiducials.5=", "camera show REFLEX35",
        {"fiducials.5.x": None, "fiducials.5.y": None, "fiducials.6.x": 18.051},
    ),
    Key(
        "1.4.1.1", "Kill All", "camera edit REFLEX35 fiducials=", "camera show REFLEX35",
        {f"fiducials.{name}.x": None for name in _MARKS},
    ),
    *(
        Key(
            "1.4.1.2", "Distortion, R0; A1; A2; A3",
            f"camera add ISP c=35 distortion_isp='{{R0=14,A1=1e-6,A2=2e-9,A3=1e-12}}' distortion_isp.{name}=1.5e-13",
            "camera show ISP", {f"distortion_isp.{name}": 1.5e-13},
        )
        for name in ("R0", "A1", "A2", "A3")
    ),
    *(
        Key(
            "1.4.1.3", key,
            f"camera add CURVE c=35 distortion_curve={_CURVE}; camera edit CURVE distortion_curve{change}",
            "camera show CURVE", {"distortion_curve": json.loads(points) if points else None},
        )
        for key, change, points in (
            ("Insert Point", ".6.5=0.013", _CURVE.replace("[8,", "[6.5,0.013],[8,")),
            ("Add Point", ".18=0.06", _CURVE.replace("]]", "],[18,0.06]]")),
            ("Edit Point", ".8=0.019", _CURVE.replace("0.018", "0.019")),
            ("Kill Point", ".8=", _CURVE.replace("[8,0.018],", "")),
            ("Kill All", "=", ""),
        )
    ),
)  # fmt: skip

TEMTICK = (
    Key("1.4.2", "Temtick Record Name", "temtick add GRID ticks.1='{x=10,y=220}'", "temtick list", ("SHEET", "GRID")),
    Key(
        "1.4.2", "Tick Marks", "temtick edit SHEET ticks='[{name=\"A\",x=1,y=2},{name=\"B\",x=3,y=4}]'",
        "temtick show SHEET", {"ticks.A.x": 1.0, "ticks.B.y": 4.0, "ticks.1.x": None},
    ),
    Key("1.4.2", "Inspect File", "temtick rename SHEET GRID", "temtick list", ("GRID",)),
    Key("1.4.2", "Inspect File", "temtick copy SHEET GRID", "temtick list", ("SHEET", "GRID")),
    Key(
        "1.4.2.1", "Insert Point", "temtick edit SHEET ticks.5='{x=10.0,y=220.0}'", "temtick show SHEET",
        {"ticks.5.x": 10.0, "ticks.5.y": 220.0, "ticks.4.x": -104.993},
    ),
    Key(
        "1.4.2.1", "Add Point", "temtick edit SHEET ticks.N.x=1 ticks.N.y=2", "temtick show SHEET",
        {"ticks.N.x": 1.0, "ticks.N.y": 2.0},
    ),
    Key(
        "1.4.2.1", "Edit Point", "temtick edit SHEET ticks.3.y=105.5", "temtick show SHEET",
        {"ticks.3.x": 105.009, "ticks.3.y": 105.5},
    ),
    Key(
        "1.4.2.1", "Kill Point", "temtick edit SHEET ticks.3=", "temtick show SHEET",
        {"ticks.3.x": None, "ticks.4.x": -104.993},
    ),
    Key("1.4.2.1", "Kill All", "temtick edit SHEET ticks=", "temtick show SHEET", {"ticks.1.x": None}),
)  # fmt: skip

PHOTO = (
    Key("1.4.3", "Photo Record Name", "photo add 107 camera=REFLEX35", "photo list", (*_PHOTOS, "107")),
    Key("1.4.3", "Camera Name", "photo add 107 camera=REFLEX35", "photo show 107", {"camera": "REFLEX35"}),
    Key("1.4.3", "Template Name", "photo edit 101 template=RIGHT", "photo show 101", {"template": "RIGHT"}),
    *(
        Key("1.4.3", "Projection Center, X0; Y0; Z0", f"photo edit 101 {name}=12.5", "photo show 101", {name: 12.5})
        for name in ("X0", "Y0", "Z0")
    ),
    *(
        Key("1.4.3", "Rotation, Omega; Phi; Kappa", f"photo edit 101 {name}=-2.5", "photo show 101", {name: -2.5})
        for name in ("OMEGA", "PHI", "KAPPA")
    ),
    Key(
        "1.4.3", "Constant/Unknown", "photo edit 101 X0=1 Y0=2 Z0=3 constant=X0,Z0", "photo show 101",
        {"constant": ["X0", "Z0"]},
    ),
    Key("1.4.3", "Inspect File", "photo rename 101 099", "photo show 099", {"camera": "REFLEX35"}),
    Key("1.4.3", "Inspect File", "photo copy 101 099", "photo show 099", {"template": "LEFT"}),
    Key("1.4.3", "Inspect File", "photo delete 101 --with-referents --yes", "photo list", _PHOTOS[1:]),
)  # fmt: skip

TEMPLATE = (
    Key(
        "1.4.4", "Template Record Name", "template add THIRD temtick=SHEET", "template list",
        ("LEFT", "RIGHT", "THIRD"),
    ),
    Key("1.4.4", "Temtick Name", "template add THIRD temtick=SHEET", "template show THIRD", {"temtick": "SHEET"}),
    Key("1.4.4", "List Photos", "template edit LEFT photos=101,103", "template show LEFT", {"photos": ["101", "103"]}),
    Key("1.4.4", "Inspect File", "template rename LEFT L", "template list", ("L", "RIGHT")),
    Key("1.4.4", "Inspect File", "template copy LEFT L", "template list", ("LEFT", "RIGHT", "L")),
    Key(
        "1.4.4.1", "Insert Photo", "photo add 107 camera=REFLEX35 template=LEFT", "template show LEFT",
        {"photos": ["101", "103", "105", "201", "203", "205", "107"]},
    ),
    Key(
        "1.4.4.1", "Add Photo", "photo add 107 camera=REFLEX35 template=LEFT X0=1 KAPPA=2", "photo show 107",
        {"template": "LEFT", "X0": 1.0, "KAPPA": 2.0},
    ),
    Key("1.4.4.1", "Edit Photo", "photo edit 103 Z0=88", "photo show 103", {"Z0": 88.0, "template": "LEFT"}),
    Key(
        "1.4.4.1", "Kill Photo", "photo edit 103 template=", "template show LEFT",
        {"photos": ["101", "105", "201", "203", "205"]},
    ),
    Key("1.4.4.1", "Kill All", "template edit LEFT photos=", "template show LEFT", {"photos": None}),
)  # fmt: skip

BUNDLE = (
    Key("1.4.5", "Bundle Adjustment Name", "bundle add SECOND", "bundle list", ("MAIN", "SECOND")),
    Key("1.4.5", "Inspect File", "bundle rename MAIN FIRST", "bundle list", ("FIRST",)),
    Key("1.4.5", "Inspect File", "bundle copy MAIN SECOND", "bundle list", ("MAIN", "SECOND")),
    Key("1.4.5", "Inspect File", "bundle delete MAIN --with-referents --yes", "bundle list", ()),
    *(
        Key("1.4.5", key, f"bundle edit MAIN {name}={value}", "bundle show MAIN", {name: value})
        for key, name, value in (
            ("Measurement Precision", "measurement_precision", 0.004),
            ("ENP-Stop", "enp_stop", 5.0),
            ("Maximum Number of Iterations", "max_iterations", 33),
            ("Start Down Weight", "start_down_weight", 4),
            ("Maximum Standard Residual", "max_standard_residual", 3.5),
            ("Maximum Number of Lost Digits", "max_lost_digits", 11),
        )
    ),
    Key("1.4.5", "List Models", "bundle list", "model list", _MODELS),
    Key(
        "1.4.5.1", "Insert Model", "model add M --before 1-2 left=101 right=104 row=7 column=1", "model list",
        ("1-1", "M", *_MODELS[1:]),
    ),
    Key("1.4.5.1", "Add Model", "model add M left=101 right=104 row=7 column=1", "model list", (*_MODELS, "M")),
    Key("1.4.5.1", "Edit Model", "model edit 1-2 column=9", "model show 1-2", {"column": 9, "left": "102"}),
    Key(
        "1.4.5.1", "Kill All", "; ".join(f"model delete {name} --yes" for name in _MODELS), "model list", (),
    ),
    Key("1.4.5.1", "Kill Model", "model delete 1-2 --yes", "model list", ("1-1", *_MODELS[2:])),
)  # fmt: skip

POINT, ELEMENT = "X=1 Y=2 Z=3 aX=0.1 aY=0.1 aZ=0.1", "group=PHOTO kind=Z0 value=80 a=0.5"
DISTANCE, PRELIMINARY = "from=2110 to=1115 code=XY distance=61.5 a=0.1", "X=1 Y=2 Z=3"
_POINTS = ("CP1", "CP2", "CP3", "CP4", "CP5", "CK1", "CK2", "CK3")


def _of_control(
    menu: str, what: str, group: str, there: tuple[str, ...], values: str, name: str, edit: str, after: dict[str, Any]
) -> tuple[Key, ...]:
    """Return the keys that every list of control has."""
    look, of = f"control {group} list", f"control {group}"
    return (
        Key(
            menu, f"Insert {what}", f"{of} insert {name} --before {there[1]} {values}", look,
            (there[0], name, *there[1:]),
        ),
        Key(menu, f"Add {what}", f"{of} add {name} {values}", look, (*there, name)),
        Key(menu, f"Edit {what}", f"{of} edit {there[1]} {edit}", look, {"name": there[1], **after}),
        Key(menu, f"Kill {what}", f"{of} kill {there[1]} --yes", look, (there[0], *there[2:])),
        Key(menu, "Kill All", f"{of} kill --all --yes", look, ()),
    )  # fmt: skip


CONTROL = (
    *_of_control("1.3.1", "Point", "points", _POINTS, POINT, "N", "Z=8.5", {"Z": 8.5, "X": 189.98}),
    *_of_control(
        "1.3.2", "Element", "elements", ("101", "102", "103"), ELEMENT, "104", "value=81", {"value": 81.0, "a": 0.5}
    ),
    *_of_control(
        "1.3.3", "Distance", "distances", ("T1", "T2", "T3"), DISTANCE, "T9", "distance=61.5",
        {"distance": 61.5, "code": "XYZ"},
    ),
    *_of_control("1.3.4", "Point", "preliminary", ("E1", "E2"), PRELIMINARY, "E3", "Z=7", {"Z": 7.0, "X": 1.0}),
)  # fmt: skip

HERE = (*CONTROL, *CAMERA, *TEMTICK, *PHOTO, *TEMPLATE, *BUNDLE)


class Edit(NamedTuple):
    """A key that edits measurements, its command, and what is measured then.

    `left`: of the template's ticks, the photo's marks or its point, those that take part and those that are
    disregarded, of those that `names` has.
    """

    menu: str
    key: str
    words: str
    names: tuple[str, ...]
    left: tuple[tuple[str, ...], tuple[str, ...]]


def _of_marks(menu: str, what: str, owner: str) -> tuple[Edit, ...]:
    names, of = ("1", "2", "3", "4"), f"{what} {owner}"
    return (
        Edit(menu, "Disregard Point", f"disregard {of} 3", names, (("1", "2", "4"), ("3",))),
        Edit(menu, "Include Point", f"disregard {of} 3; include {of} 3", names, (names, ())),
        Edit(menu, "Kill Point", f"kill {of} 3 --yes", names, (("1", "2", "4"), ())),
        Edit(menu, "Kill All", f"kill {of} '*' --yes", names, ((), ())),
    )


def _of_points(menu: str) -> tuple[Edit, ...]:
    names = ("1103", "1104", "NEW")
    return (
        Edit(menu, "Disregard Point", "disregard point 101 1103", names, (("1104",), ("1103",))),
        Edit(
            menu, "Include Point", "disregard point 101 1103; include point 101 1103", names, (("1103", "1104"), ())
        ),
        Edit(menu, "Kill Point", "kill point 101 1103 --yes", names, (("1104",), ())),
        Edit(menu, "Kill All", "kill point 101 '*' --yes", names, ((), ())),
        Edit(menu, "Edit Point", "rename point 101 1103 NEW", names, (("1104", "NEW"), ())),
        Edit(menu, "Edit Point", "edit point 101 1103 x=50.5 y=60.25 name=NEW", names, (("1104", "NEW"), ())),
    )  # fmt: skip


EDITS = (
    *_of_marks("1.5.1", "tick", "LEFT"),
    *_of_marks("1.5.2", "mark", "101"),
    *_of_points("1.5.3"),
    *_of_points("1.5.4"),
)
