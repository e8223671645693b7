"""All commands that write, each as it is killed; a command of orip that is not here has to be one that only reads."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

FILM, OPERATED, DRIVABLE, JOINED, EXCHANGED = "film", "operated", "drivable", "joined", "exchanged"
UPDATED, FIRST, FLOWN, PICTURED = "updated", "first", "flown", "pictured"
"""Projects to begin with: on film, with control of all kinds and texts changed since it was adjusted; half digitised;
adjusted, with templates and models to drive in; on film, of so many bundles that one connection cannot attach all of
their stores; adjusted, with what it is in another program, and an empty folder; on film, with an update that can be
undone; digital and adjusted, with what it is in another program and an empty folder; planned and partly flown;
a folder of images."""

MANY_BUNDLES = tuple(f"B{number:02d}" for number in range(12))
"""Those of the joined project; with the other stores it has seventeen."""

_CONTROL = {
    "points": ("T9 X=1 Y=2 Z=3 aX=1 aY=1 aZ=1", "1", "X=1012.5", "5"),
    "elements": ("right group=PHOTO kind=Z0 value=330 a=5", "left", "value=331", "right"),
    "distances": ("D9 from=3 to=4 code=XYZ distance=136.7 a=0.05", "D1", "distance=166.7", "D2"),
    "directions": ("S2 station=1 target=4 direction=51.5 a=0.02", "'S1 1 3'", "a=0.02", "'S1 1 4'"),
    "stations": ("third X=1190 Y=2075 Z=330 aX=5 aY=5 aZ=5", "left", "X=1070.5", "right"),
    "figures": ("LAKE kind=HEIGHT point=4 a=5", "'LAKE HEIGHT 1'", "a=4", "'LAKE HEIGHT 3'"),
    "differences": (
        "left second=third dX=120 dY=0 dZ=0 aX=5 aY=5 aZ=5",
        "'left right'",
        "dX=60.5",
        "'right third'",
    ),
    "preliminary": ("T9 X=1 Y=2 Z=3", "P1", "X=1102", ""),
}
"""Of each control text a line to add, one that is there, a change of it, and one that is disregarded."""

CONTROL_TEXTS = {
    "FIRST.ELE": "left PHOTO Z0 330 5\nright PHOTO Y0 2075 -5\n",
    "FIRST.LEN": "D1 1 2 XYZ 166.63 0.05\nD2 3 4 XYZ 136.7 -0.05\n",
    "FIRST.DIR": "S1 1 2 88.4352 0.01\nS1 1 3 1.1402 0.01\nS1 1 4 51.5 -0.02\n",
    "FIRST.CON": "LAKE HEIGHT 1 5\nLAKE HEIGHT 2 5\nLAKE HEIGHT 3 -5\n",
    "FIRST.STA": "left 1070 2075 330 5 5 5\nright 1130 2075 330 -5 -5 -5\n",
    "FIRST.REL": "left right 60 0 0 5 5 5\nright third 60 0 0 -5 -5 -5\n",
    "MAIN.PRE": "P1 1101 2083 107\n",
    "again.txt": "POINTS MAIN left\nP1 104.402 100.931\n",
    "flown.csv": "photo,X,Y,Z\nleft,1070.5,2075.2,330.1\nright,1130.1,2075.3,330.2\nthird,1190.0,2075.0,330.0\n",
    "EDITS.MEA": "DISREGARD POINT MAIN left 4\n",
}
"""Of the project on film; in FIRST.PNT point 5 is disregarded."""

_TICKS = 'ticks=[{name="1",x=1,y=2},{name="2",x=3,y=4},{name="3",x=3,y=9}]'
_RECORDS = {
    "camera": (FILM, "c=36", "C35", "c=35.3"),
    "temtick": (DRIVABLE, f"'{_TICKS}'", "SHEET", f"'{_TICKS}'"),
    "photo": (FILM, "camera=C35", "left", "X0=1071.5"),
    "template": (DRIVABLE, "temtick=SHEET stage=UPPER photos=[]", "LEFT", "stage=LOWER"),
    "bundle": (FILM, "", "MAIN", "measurement_precision=0.004"),
    "model": (DRIVABLE, "left=101 right=104 row=7 column=1", "1-1", "row=8"),
}
"""Of each kind of record a project, the values of a record to add, one that is there, and a change of it."""

_OTHERS = {
    FILM: (
        "init", "measure", "solve", "run", "prelim", "prelim update", "report",
        "update photos", "update points", "export-toml --output orip.toml --force", "load FIRST.PHO FIRST.dump",
        "init --sample small_frame_block sample", "init MINE mine", "new MINE mine --kind drone",
        "observations disregard point left P1", "observations include point left 4",
        "observations kill point left P1 --yes", "observations rename point left P1 P2",
        "observations edit point left P1 x=1 y=2",
        "observations remeasure again.txt", "stations import flown.csv --camera C35 --replace",
    ),
    OPERATED: (
        "digitise template RIGHT --link {} --simulate films/DAY1.MEA",
        "digitise photo 101 --again --link {} --simulate films/DAY1.MEA",
        "digitise points --list first.txt --link {} --simulate films/DAY1.MEA",
        "digitise ticks SHEET 1 2 3 4 --link {} --script panel.txt",
        "digitise fiducials REFLEX35 1 2 3 4 --link {} --script panel.txt",
    ),
    DRIVABLE: (
        "update cameras", "drive table", "drive download --link {}",
        "digitise ground 1103 --model 1-1 --to PRE --link {} --simulate DAY1.MEA",
        "digitise features LINE:RIDGE --link {} --script collected.txt",
        "restitute compute STEREO.STE", "restitute export dxf map.dxf",
    ),
    JOINED: (
        "init", "measure", "photo rename left OTHER", "photo delete left --with-referents --yes",
        "camera rename C35 OTHER", "bundle rename B03 OTHER", "bundle copy B03 NEW",
        "bundle delete B03 --with-referents --yes", "observations rename point left P1 P2 --bundle B03",
        "observations kill mark left '*' --yes",
    ),
    EXCHANGED: ("import colmap model imported", "import colmap model empty", "export colmap written", "adjust model"),
    UPDATED: ("update --undo",),
    FIRST: (
        "import colmap model imported", "import colmap model empty", "import micmac Ori-Z imported",
        "export colmap written", "export colmap empty", "export micmac written", "export opensfm written",
        "export bingo written", "export csv written", "export metashape written.xml", "export blocks written.xml",
        "export nvm written.nvm", "export bal written.txt", "export dxf written.dxf", "export geopackage written.gpkg",
        "adjust model", "solve", "bundle rename MAIN OTHER", "online",
    ),
    FLOWN: ("plan make --force", "plan show", "plan export dji drone.kmz", "plan flown --again AGAIN.PLAN"),
    PICTURED: ("photos images new", "detect board --print board.svg", "detect board --print board.pdf"),
}  # fmt: skip

ONLY_READING = frozenset(
    {
        "status", "results", "check", "compare", "dump", "prelim relative", "prelim bridge", "prelim connect",
        "prelim absolute", "prelim show", "camera plot", "observations list", "observations todo", "archive status",
        "archive diff", "restitute show", "plan forecast", "plan compare", "plan place", "plan clock",
        "plan follow", "imu noise",
        # these write what the plate processor holds, not what is in the project
        "drive goto", "drive where", "drive profile", "drive forward", "drive model", "drive next", "drive watch",
        "drive guide", "drive move", "drive lock", "drive prism", "drive foot", "drive key",
    }
    | {f"{kind} {verb}" for kind in _RECORDS for verb in ("list", "show")}
    | {f"control {kind} list" for kind in _CONTROL}
)  # fmt: skip

UNTIL_A_SIGNAL = frozenset({"drive emulate", "screen"})
"""Run until somebody ends them: killed in tests/link; what a screen has said is on the disk (tests/screen)."""

ONLINE = "".join(
    f'{{"do": "measure", "photo": "{photo}", "point": "K{n}", "x": {1500 + 9 * n}.25, "y": {1600 + 7 * n}.5}}\n'
    for n in range(4)
    for photo in ("left", "right")
)
"""What is told a session on stdin."""

OF_ARCHIVES = frozenset({"archive run", "archive report", "archive simulate"})
"""Write in many projects, or in a folder of results; killed in tests/archive/test_killed_archives.py."""


WHOLE_TEXTS = frozenset({"match", "detect tags", "detect sheet", "gnss positions", "gnss network", "imu smooth"})
"""Compute for long and write whole files in the end, as others do that are killed: `orip.files.text.atomic`; what
`match` keeps for its next run is tested with it."""


def _of_control() -> Iterator[str]:
    for kind, (added, there, change, disregarded) in _CONTROL.items():
        yield f"control {kind} add {added}"
        yield f"control {kind} insert {added} --before {there}"
        yield f"control {kind} edit {there} {change}"
        yield f"control {kind} kill {there} --yes"
        if disregarded:
            yield f"control {kind} disregard {there}"
            yield f"control {kind} include {disregarded}"
    yield "control points reject 2"


def _of_records() -> Iterator[tuple[str, str]]:
    for kind, (project, added, there, change) in _RECORDS.items():
        yield project, f"{kind} add NEW {added}"
        yield project, f"{kind} copy {there} NEW" + (" row=9" if kind == "model" else "")
        yield project, f"{kind} edit {there} {change}"
        yield project, f"{kind} rename {there} OTHER"
        yield project, f"{kind} delete {there} --with-referents --yes"


KILLED: Sequence[tuple[str, str]] = (
    *((project, words) for project, commands in _OTHERS.items() for words in commands),
    *((FILM, words) for words in _of_control()),
    *_of_records(),
)
"""The project and the words of each; {} stands for the URL of the plate processor."""
