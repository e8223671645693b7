"""The project file: defaults, every key, and what is said of each kind of fault."""

from __future__ import annotations

import json
import random
import tomllib
from pathlib import Path
from typing import Any

import pytest
from files.full_project import FULL
from hypothesis import given, settings
from hypothesis import strategies as st
from workflow.small_projects import REPOSITORY

from orip.files.project.reader import parse_project, read_project
from orip.files.project.records import project_document, project_text
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark, Sensor
from orip.records.definition import BundleDefinition, Precision, ProjectDefinition, StereoModel
from orip.records.photo import Photo, Scan, Template, Temtick

PROJECT = '[project]\nname = "Z"\n'  # lines 1 and 2
OTHER = '[[camera]]\nname = "U"\n'  # two lines
CAMERA = '[[camera]]\nname = "O"\nc = 8.5\n'  # three lines

ONE_FIDUCIAL = "fiducials = [{ name = '1', x = 1, y = 1 }]\n"
SENSOR = "sensor = { columns = 1, rows = 1, width = 1, height = 1 }\n"


def complaints(text: str) -> list[str]:
    return [str(complaint) for complaint in parse_project(text).complaints]


def definition(text: str) -> ProjectDefinition:
    parsed = parse_project(text)
    assert not parsed.complaints
    assert parsed.value is not None
    return parsed.value.definition


def test_the_defaults() -> None:
    project = definition(f'{PROJECT}{CAMERA}[[photo]]\nname = "P"\ncamera = "o"\n[[bundle]]\nname = "M"\n')
    assert project == ProjectDefinition(
        name="Z",
        user="",
        camera_file="CAMERAS.CAM",
        temtick_file="TEMTICKS.TIK",
        project_files="Z",
        control_files="Z",
        measurement_files=("*.MEA",),
        ground_unit="m",
        crs=None,
        cameras=(Camera("O", (8.5, *[0.0] * 12)),),
        photos=(Photo("P", "o"),),
        bundles=(BundleDefinition("M"),),
    )
    (bundle,) = project.bundles
    assert (bundle.measurement_precision, bundle.enp_stop, bundle.max_iterations) == (Precision(0.005), 4, 60)
    assert (bundle.start_down_weight, bundle.max_standard_residual, bundle.max_lost_digits) == (2, 5, 12)
    assert bundle.datum == "control"


def test_every_key() -> None:
    project = definition(FULL)
    assert (project.user, project.camera_file, project.temtick_file) == ("K. Dueholm", "../CAMERAS.CAM", "T.TIK")
    assert (project.project_files, project.control_files) == ("ZP", "ZC")
    assert project.measurement_files == ("S*.MEA", "EDITS.MEA")
    assert (project.ground_unit, project.crs) == ("US survey foot", "EPSG:2056")
    assert project.gates == ("sigma0<=1.5", "singular==0")
    film, digital, curve = project.cameras
    assert film == Camera(
        "FILM",
        (152, -0.1905, 0.9305, 1e-3, 2, 3, 4, 9, 5, 6, 7, 8, 0),
        distortion_at="measured",
        frame=(24, 36),
        fiducials=(Mark("1", -12, 18), Mark("2", 12, 18)),
        unknown=("C", "A1"),
        additional_set="EBNER",
        projection="equidistant",
    )
    assert digital.distortion_isp == (10.0, 1e-4, 0.0, 0.0)
    assert digital.parameters[CAMERA_PARAMETERS.index("A1")] == 0
    assert digital.sensor == Sensor(1280, 1024, 8.245, 6.6)
    assert curve.distortion_curve == ((0.0, 0.0), (5.0, 0.001), (10.0, 0.002), (12.0, 0.001), (15.0, -0.003))
    assert project.temticks == (Temtick("GRID", (Mark("1", 10, 220),)),)
    assert project.photos[2] == Photo("P3", "CURVE", stage="LOWER", scan=Scan((0.02, 0.02)))
    assert project.bundles == (
        BundleDefinition(
            "MAIN", Precision(0.004), 3, 30, 30, 4, 10, "free", ("1", "2"), (StereoModel("M1", "P1", "P2", 1, 2),)
        ),
    )


def test_photos_and_templates_name_each_other_whichever_side_the_text_has() -> None:
    project = definition(FULL)
    assert project.templates == (
        Template("T1", "grid", "UPPER", ("P1",), Scan((0.0127, 0.013), "centre")),
        Template("T2", "GRID", None, ("P2",)),
    )
    assert [photo.template for photo in project.photos] == ["T1", "T2", None]
    assert project.photos[0].orientation == (1, None, None, None, None, 90.5)


def test_records_have_their_lines() -> None:
    records = parse_project(FULL).value
    assert records is not None
    assert records.lines["project", ""] == 1
    assert records.lines["camera", "DIGITAL"] == 27
    assert records.lines["photo", "P2"] == 60
    assert records.lines["model", "MAIN M1"] == 82


def test_precision_in_pixels_where_all_photos_have_sensor_or_scan() -> None:
    sensor = 'sensor = { columns = 10, rows = 10, width = 1, height = 1 }\n[[photo]]\nname = "P"\ncamera = "O"\n'
    text = f'{PROJECT}{CAMERA}{sensor}[[bundle]]\nname = "M"\nmeasurement_precision = "0.5px"\n'
    assert definition(text).bundles[0].measurement_precision == Precision(0.5, "px")
    (complaint,) = complaints(text + '[[camera]]\nname = "F"\nc = 1\n[[photo]]\nname = "Q"\ncamera = "F"\n')
    assert complaint.startswith("orip.toml:12: bundle 'M' has its measurement_precision in pixels, but photo 'Q' has")


def test_c_and_a1_may_both_be_unknown() -> None:
    assert definition(f'{PROJECT}{CAMERA}unknown = ["C", "A1"]\n').cameras[0].unknown == ("C", "A1")


def test_a_model_whose_photos_share_a_stage_is_a_warning() -> None:
    text = FULL.replace('temtick = "GRID"\n', 'temtick = "GRID"\nstage = "UPPER"\n')
    (warning,) = parse_project(text).warnings
    assert str(warning).startswith("orip.toml:83: photos 'P1' and 'P2' of model 'M1' are both on the UPPER stage")
    assert warning.code == "shared-stage"
    assert parse_project(FULL).warnings == ()


def test_marks_that_look_alike_are_a_warning() -> None:
    text = f'{PROJECT}{CAMERA}fiducials = [{{ name = "1", x = 1, y = 1 }}, {{ name = "01", x = 2, y = 1 }}]\n'
    (warning,) = parse_project(text).warnings
    assert (warning.code, warning.where) == ("similar-names", "orip.toml:6")


@pytest.mark.parametrize(("unit", "known"), [("Meter", "m"), ("M", "m"), ("FEET", "foot"), ("foot", ""), ("ell", "")])
def test_a_unit_in_other_words_is_a_warning(unit: str, known: str) -> None:
    warnings = parse_project(f'project = {{ name = "P", ground_unit = "{unit}" }}\n').warnings
    assert [one.where for one in warnings] == ["orip.toml:1"] * bool(known)
    assert all(f'write ground_unit = "{known}"' in one.text for one in warnings)


@pytest.mark.parametrize("key", ["", "readout = 0.03", "readout = 0.0", 'unknown = ["READOUT"]'])
def test_a_direction_of_rows_without_their_readout_is_a_warning(key: str) -> None:
    sensor = "sensor = { columns = 10, rows = 10, width = 1, height = 1 }"
    warnings = parse_project(f'{PROJECT}{CAMERA}{sensor}\nreadout_direction = "right"\n{key}\n').warnings
    assert [(one.code, one.where) for one in warnings] == ([] if key else [("no-readout", "orip.toml:7")])


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "there is no [project] table; write [project] and below it"),
        ("[project]\n", 1, "[project] has no name; it is required, write for example name = \"ZURICH\""),
        ('[project]\nname = "123456789012345678901"\n', 2, "a text of at most 20 characters is required"),
        ('[project]\nname = ""\n', 2, "a text that is not empty is required"),
        ('[project]\nname = 7\n', 2, "name of [project] is 7, but a text in quotes is required"),
        ('[project]\nname = "Z"\nuser = "123456789012345678901"\n', 3, "at most 20 characters"),
        ('[project]\nname = "Z"\nuser = "a\\nb"\n', 3, "cannot be printed on the listings"),
        (f"{PROJECT}usr = 1\n", 3, "[project] has the unknown key 'usr'; did you mean 'user'?"),
        (f"{PROJECT}measurement_files = \"*.MEA\"\n", 3, "a list in brackets is required"),
        (f'{PROJECT}project_files = "a/b"\n', 3, "project_files 'a/b' has /, which file names cannot have"),
        (f'{PROJECT}temtick_file = "CAMERAS.CAM"\n', 3, "does not end in .TIK, as this store does"),
        ('[project]\nname = "MY BLOCK"\ncontrol_files = "C"\n', 2, 'or set project_files to "MY_BLOCK"'),
        (f"{PROJECT}[plan]\nheight = 9\nsidelap = 60\n", 5, "strips are forward and side, in percent"),
        (f"{PROJECT}[cameras]\n", 3, "the project has the unknown key 'cameras'; did you mean 'camera'?"),
        (f"{PROJECT}epsg = 25832\n", 3, "did you mean 'crs'?"),
        (f'{PROJECT}[[camera]]\nname = "O"\nfocal_length = 8\n', 5, "did you mean 'c'?"),
        (f"{PROJECT}{CAMERA}unknown = ['K1']\n", 6, "'K1' is not a parameter; did you mean 'A3'?"),
        (f"{PROJECT}{CAMERA}unknown = ['cx']\n", 6, "'cx' is not a parameter; did you mean 'DX'?"),
        (f"{PROJECT}{CAMERA}distortion = {{ K2 = 1 }}\n", 6, "did you mean 'A5'? Allowed: A1, A3"),
        (f'{PROJECT}[[bundle]]\nname = "M"\nmeasurement_precision = "0.5 pix"\n', 5, "written; write 0.5px"),
        (f'{PROJECT}[[bundle]]\nname = "M"\nmeasurement_precision = "0.5 px"\n', 5, "written; write 0.5px"),
        (f'{PROJECT}[[bundle]]\nname = "M"\nmeasurement_precision = "5 µm"\n', 5, "written; write 0.005 (mm)"),
        (f'{PROJECT}[camera]\nname = "O"\nc = 1\n', 3, "write each as [[camera]]"),
        ('project = 3\n', 1, "[project] is 3, but a table is required"),
        (f"{PROJECT}[check]\ngates = [1]\n", 4, "gates number 1 of [check] is 1, but a text in quotes is required"),
        (f'{PROJECT}[[camera]]\nname = "O"\n', 3, "camera 'O' has no c; it is required, write for example c = 8.595"),
        (f"{PROJECT}[[camera]]\nc = 8\n", 3, "camera number 1 has no name"),
        (f'{PROJECT}[[camera]]\nname = "O"\nc = 0\n', 5, "c of camera 'O' is 0, but a number above 0 is required"),
        (f'{PROJECT}[[camera]]\nname = "O"\nc = nan\n', 5, "a finite number is required"),
        (f'{PROJECT}[[camera]]\nname = "O"\nc = true\n', 5, "c of camera 'O' is true, but a number is required"),
        (f'{PROJECT}[[camera]]\nname = "O"\nc = "8,5"\n', 5, 'is "8,5", but a number is required'),
        (f'{PROJECT}[[camera]]\nname = "O P"\nc = 1\n', 4, "'O P' has a blank"),
        (f"{PROJECT}{CAMERA}principal_point = [1]\n", 6, "is a list of 1, but a list of 2 elements is required"),
        (f"{PROJECT}{CAMERA}distortion = {{ A2 = 1 }}\n", 6, "distortion of camera 'O' has the unknown key 'A2'"),
        (
            f"{PROJECT}{CAMERA}distortion = {{ A3 = 1.0, P1 = 1.0 }}\ndistortion_isp = {{}}\n",
            7,
            "has distortion_isp and A3 of distortion; give the radial distortion in one form",
        ),
        (
            f"{PROJECT}{CAMERA}distortion_isp = {{}}\ndistortion_curve = [[1,0],[2,0],[3,0],[4,0]]\n",
            7,
            "has distortion_isp and distortion_curve; give the radial distortion in one form",
        ),
        (f"{PROJECT}{CAMERA}distortion_curve = [[1,1],[2,1],[3,1],[3,1]]\n", 6, "has 3 different radii above 0"),
        (f"{PROJECT}{CAMERA}distortion_curve = [[0,0],[2,1],[3,1],[4,1]]\n", 6, "3 different radii above 0; give"),
        (f"{PROJECT}{CAMERA}distortion_curve = [[1,1],[2,1],[3,1],[4,1],\n[-3,1]]\n", 7, "has the radius -3; write 0"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "o"\nc = 8.5\n', 9, "has c, but its lens is that of camera 'o'"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "O"\ndistortion = {{A3 = 1.0}}\n', 9, "has A3 of distortion, but"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "O"\ndistortion_isp = {{}}\n', 9, "has distortion_isp, but its lens"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "O"\ndistortion_at = "measured"\n', 9, "has distortion_at, but its"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "O"\nunknown = ["C", "DX"]\n', 9, "has C unknown, but its lens is"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "O"\nset = "EBNER"\n', 8, "and a set cannot be adjusted for both"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "U"\n', 8, "names the camera itself"),
        (f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "V"\n', 8, "names camera 'V', which is not defined"),
        (
            f'{PROJECT}{CAMERA}{OTHER}same_lens_as = "O"\n[[camera]]\nname = "V"\nsame_lens_as = "u"\n',
            11,
            "names camera 'u', which has the lens of 'O'; name 'O'",
        ),
        (f'{PROJECT}{CAMERA}distortion_at = "Ideal"\n', 6, "but 'ideal' or 'measured' is required"),
        (PROJECT + CAMERA.replace("8.5", "1e9"), 5, "no lens has more than 100000: write it in mm"),
        (f"{PROJECT}{CAMERA}frame = [24, 0]\n", 6, "frame number 2 of camera 'O' is 0, but a number above 0"),
        (f"{PROJECT}{CAMERA}set = \"BROWN\"\n", 6, "but 'EBNER' or 'GRUEN' is required"),
        (f"{PROJECT}{CAMERA}unknown = [\n'C',\n'c']\n", 8, "'c' is not a parameter; did you mean 'C'?"),
        (f"{PROJECT}{CAMERA}unknown = ['C', 'C']\n", 6, "'C' comes twice"),
        (
            f"{PROJECT}{CAMERA}fiducials = [\n{{ name = '1', x = 1, y = 1 }},\n{{ name = '1', x = 1, y = 2 }}]\n",
            8,
            "'1' is already given on line 7",
        ),
        (f"{PROJECT}{CAMERA}fiducials = [{{ name = '-', x = 1, y = 1 }}]\n", 6, "'-' is not allowed as a name"),
        (f"{PROJECT}{CAMERA}fiducials = [{{ name = 1, x = 1, y = 1 }}]\n", 6, "name of fiducials number 1 of camera"),
        (f"{PROJECT}{CAMERA}{ONE_FIDUCIAL}{SENSOR}", 7, "camera 'O' has both sensor and fiducials"),
        (f"{PROJECT}{CAMERA}sensor = {{ columns = 1.5, rows = 1, width = 1, height = 1 }}\n", 6, "a whole number"),
        (f"{PROJECT}{CAMERA}[[camera]]\nname = 'O'\nc = 1\n", 7, "camera 'O' is already defined on line 4"),
        (f"{PROJECT}{CAMERA}[[camera]]\nname = 'o'\nc = 1\n", 7, "differs from 'O' on line 4 only in case"),
        (f"{PROJECT}[[bundle]]\nname = 'a/b'\n", 4, "bundle 'a/b' has /, which file names cannot have"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\n[[bundle]]\nname = 'Prelim'\n", 6, "PRELIM_RESULT.OUT of another step"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nstart_down_weight = 61\n", 5, "above its max_iterations 60"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nstart_down_weight = 1\n", 5, "a number above 1 is required"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nmax_standard_residual = 0\n", 5, "a number above 0 is required"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nmeasurement_precision = '5um'\n", 5, "write 0.005 (mm)"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nmeasurement_precision = '0.5'\n", 5, "a text such as '0.5px' is allowed"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nmeasurement_precision = -1\n", 5, "a precision is above 0"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nmeasurement_precision = inf\n", 5, "only a number (mm)"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\ndatum_points = ['1']\n", 5, "they belong to a free datum"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\ndatum = 'free'\ndatum_points = ['1', '1']\n", 6, "'1' comes twice"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\ndatum = 'free'\ndatum_points = ['a b']\n", 6, "'a b' has a blank"),
        (f"{PROJECT}[[bundle]]\nname = 'M'\nmodel = 3\n", 5, "write each as [[bundle.model]]"),
        (f"{PROJECT}[[camera]]\nname = 8,5\n", 4, "a number has a decimal comma; write a decimal point"),
    ],
)  # fmt: skip
def test_one_fault(text: str, line: int, words: str) -> None:
    (complaint,) = complaints(text)
    assert complaint.startswith(f"orip.toml:{line}:")
    assert words in complaint


BLOCK = f"""{PROJECT}{CAMERA}[[camera]]
name = "D"
c = 1
sensor = {{ columns = 1, rows = 1, width = 1, height = 1 }}
[[temtick]]
name = "G"
[[template]]
name = "T"
temtick = "G"
scan = {{ pixel = 0.01 }}
photos = ["A"]
[[photo]]
name = "A"
camera = "O"
[[photo]]
name = "B"
camera = "O"
"""  # photos at lines 17 and 20, the text ends with line 22


@pytest.mark.parametrize(
    ("added", "line", "words"),
    [
        ('camera_ = 1\n', 23, "photo 'B' has the unknown key 'camera_'; did you mean 'camera'?"),
        ('[[photo]]\nname = "C"\ncamera = "P"\n', 25, "photo 'C' names camera 'P', which is not defined"),
        ('template = "T2"\n', 23, "photo 'B' names template 'T2', which is not defined; did you"),
        ('stage = "up"\n', 23, "but 'UPPER' or 'LOWER' is required"),
        ('template = "T"\nstage = "UPPER"\n', 24, "photo 'B' has a stage but is on template 'T'"),
        ('template = "T"\nscan = { pixel = 0.02 }\n', 24, "another scan than its template 'T' on line 15"),
        ("scan = { pixel = 0 }\n", 23, "only a number above 0 (mm) or two of them, [px, py], are allowed"),
        ("scan = { pixel = [1, 2, 3] }\n", 23, "pixel of scan of photo 'B' is a list of 3"),
        ('scan = { pixel = 1, origin = "center" }\n', 23, "but 'corner' or 'centre' is required"),
        ('constant = ["X0", "KAPA"]\n', 23, "'KAPA' is not a parameter; did you mean 'KAPPA'?"),
        ("PHI = inf\n", 23, "a finite number is required"),
        ("PHI = 0.0\nOMEGA = 400.0\n", 24, "has OMEGA = 400; angles are in degrees"),
        ("KAPPA = -4000.0\n", 23, "photo 'B' has KAPPA = -4000; angles are in degrees, from -360 to 360"),
        ('[[photo]]\nname = "C"\ncamera = "D"\ntemplate = "T"\n', 26, "but its camera 'D' has a sensor"),
        ('[[photo]]\nname = "C"\ncamera = "D"\nscan = { pixel = 1 }\n', 26, "has a scan, but its camera 'D'"),
        ('[[template]]\nname = "U"\ntemtick = "H"\n', 25, "template 'U' names temtick 'H', which is not defined"),
        ('[[template]]\nname = "U"\ntemtick = "G"\nphotos = ["Q"]\n', 26, "template 'U' names photo 'Q'"),
        ('[[template]]\nname = "U"\ntemtick = "G"\nphotos = ["a"]\n', 26, "listed by template 'T' on line 16 already"),
        ('[[template]]\nname = "U"\n', 23, "template 'U' has no temtick; it is required"),
        ('template = "T"\n[[template]]\nname = "U"\ntemtick = "G"\nphotos = ["B"]\n', 27, "on line 23 the photo is on"),
        ('[[temtick]]\nname = "H"\nticks = [{ name = "1", x = 1 }]\n', 25, "ticks number 1 of temtick 'H' has no y"),
    ],
)  # fmt: skip
def test_one_fault_of_a_photo_or_template(added: str, line: int, words: str) -> None:
    assert not complaints(BLOCK)
    (complaint,) = complaints(BLOCK + added)
    assert complaint.startswith(f"orip.toml:{line}: ")
    assert words in complaint


@pytest.mark.parametrize(
    ("model", "line", "words"),
    [
        ('name = "N"\nleft = "A"\nright = "a"\nrow = 2\ncolumn = 1', 34, "photo 'A' both left and right"),
        ('name = "N"\nleft = "A"\nright = "Q"\nrow = 2\ncolumn = 1', 34, "model 'N' names photo 'Q'"),
        ('name = "m"\nleft = "A"\nright = "B"\nrow = 2\ncolumn = 1', 32, "differs from 'M' on line 26 only in case"),
        ('name = "N"\nleft = "A"\nright = "B"\nrow = 1\ncolumn = 1', 35, "row 1, column 1 like model 'M' on line 29"),
        ('name = "N"\nleft = "A"\nright = "B"\nrow = 0\ncolumn = 1', 35, "a number of at least 1 is required"),
        ('name = "N"\nleft = "A"\nright = "B"\nrow = 2', 31, "model 'N' of bundle 'MAIN' has no column"),
    ],
)  # fmt: skip
def test_one_fault_of_a_model(model: str, line: int, words: str) -> None:
    first = '[[bundle.model]]\nname = "M"\nleft = "A"\nright = "B"\nrow = 1\ncolumn = 1\n'
    text = f'{BLOCK}[[bundle]]\nname = "MAIN"\n{first}[[bundle.model]]\n{model}\n'
    (complaint,) = complaints(text)
    assert complaint.startswith(f"orip.toml:{line}: ")
    assert words in complaint


def test_models_of_different_bundles_may_share_name_and_place() -> None:
    bundle = '[[bundle]]\nname = "{}"\n[[bundle.model]]\nname = "M"\nleft = "A"\nright = "B"\nrow = 1\ncolumn = 1\n'
    assert len(definition(BLOCK + bundle.format("ONE") + bundle.format("TWO")).bundles) == 2


def test_equal_scans_of_photo_and_template_agree() -> None:
    definition(BLOCK + 'template = "T"\nscan = { pixel = [0.01, 0.01] }\n')


def test_all_faults_come_at_once_and_a_faulty_record_is_not_called_missing() -> None:
    text = (
        f"{PROJECT}usr = 1\n[[camera]]\nname = 'O'\nc = -1\n[[photo]]\nname = 'P'\ncamera = 'O'\nconstant = ['Q']\n"
        "[[photo]]\nname = 'P Q'\ncamera = 'none'\n[[bundle]]\nname = 'M'\nenp_stop = 'x'\n"
        "[[bundle.model]]\nname = '1'\nleft = 'P'\nright = 'R'\nrow = 1\ncolumn = 1\n"
    )
    assert [complaint.split(" ")[0] for complaint in complaints(text)] == [
        "orip.toml:3:",
        "orip.toml:6:",
        "orip.toml:10:",
        "orip.toml:12:",
        "orip.toml:13:",
        "orip.toml:16:",
        "orip.toml:20:",
    ]


@pytest.mark.parametrize(
    ("line", "column", "words"),
    [
        ("name = Z", 8, 'a text needs quotation marks; write "Z"'),
        ("name = “Z”", 8, "typographic quotation marks"),
        ('name = "Z', 10, "a quotation mark is missing at the end of the text"),
        ('name = "C:\\Users"', 13, "a text has a backslash; write /"),
        ('name = "Z"\nname = "Y"', 11, "this key is written twice"),
        ('name = "Z" ! a comment', 12, "no comment begins so here; write '#'"),
        ("// a comment", 1, "no comment begins so here; write '#'"),
        ('name = "Z";', 11, "no ';' ends a line here"),
        ('name: "Z"', 5, "a key and its value are separated by '='"),
        ("a = 35,5", 7, "a number has a decimal comma"),
        ("a = .5", 5, "a number begins with a digit"),
        ("a = True", 5, "in small letters"),
        ("a = 35.0 mm", 10, "'mm' follows a value; remove it (numbers have no unit), or begin a comment with '#'"),
        ("a = 90°", 7, "'°' follows a value; remove it"),
        ("a = 35.0,", 9, "no comma ends a line here; remove it"),
        ("a = 35.0\u00a0", 9, "this is a blank of a word processor; write an ordinary one"),
        ("a\u00a0= 35.0", 2, "this is a blank of a word processor"),
        ("a = # later", 5, "a value is missing after '='"),
        ("a =", 4, "a value is missing after '='"),
        ("a = null", 5, "there is no such value; leave the key out"),
        ("name = 007", 9, 'a number does not begin with 0; write 7, or "007" if it is a name'),
        ("a = [1 2]", 8, "a comma between two items, or the closing bracket, is missing"),
        ('{ "name": 7 }', 1, "this is JSON; write for example [project]"),
        ("{", 1, "this is JSON"),
        ("name 7", 6, "a line is KEY = VALUE or a [table]; correct it, or begin a remark with '#'"),
        ("<<<<<<< HEAD", 1, "git could not merge two versions here"),
    ],
)
def test_what_was_probably_meant_by_a_text_that_is_no_toml(line: str, column: int, words: str) -> None:
    (complaint,) = complaints(f"[project]\n{line}\n")
    last = 2 + line.count("\n")
    assert complaint.startswith(f"orip.toml:{last}:{column}: this is not TOML: ")
    assert words in complaint


def test_text_that_is_no_toml_is_refused_with_line_and_column(tmp_path: Path) -> None:
    (complaint,) = complaints("[project]\nname = Z\n")
    assert complaint.startswith("orip.toml:2:8: this is not TOML: ")
    assert complaints("[project]\nname = '''Z\n")[0].startswith("orip.toml:3: this is not TOML: ")
    (tmp_path / "orip.toml").write_bytes(b"[project]\nname = '\xff'\n")
    (undecodable,) = read_project(tmp_path / "orip.toml").complaints
    assert str(undecodable).startswith("orip.toml:2:9: byte 0xFF is not UTF-8")


def test_windows_text_with_byte_order_mark_is_read(tmp_path: Path) -> None:
    (tmp_path / "orip.toml").write_bytes(b"\xef\xbb\xbf" + FULL.replace("\n", "\r\n").encode())
    parsed = read_project(tmp_path / "orip.toml")
    assert not parsed.complaints
    assert parsed.value == parse_project(FULL).value


def test_a_missing_project_file_is_named(tmp_path: Path) -> None:
    (complaint,) = read_project(tmp_path / "orip.toml").complaints
    assert str(complaint).startswith("orip.toml: there is no such file")


def toml_of(value: Any) -> str:
    """Write a value of a TOML document inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml_of(part)}" for key, part in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_of, value)) + "]"
    return json.dumps(value, ensure_ascii=False).replace("NaN", "nan").replace("Infinity", "inf").replace("\x7f", "")


def change_somewhere(value: Any, chance: random.Random) -> Any:
    """Replace, remove or rename one thing at any depth."""
    if not isinstance(value, (dict, list)) or not value or chance.random() < 0.1:
        odd = [0, -1, 10**400, True, "", "P1", "x y", "\x1b", "0.5px", "é" * 300, [], [1], {}, {"name": 1}]
        return chance.choice([*odd, float("nan"), float("inf"), 1.5, [[1, 2]] * 4, "FILM", "t1"])
    copy: Any = value.copy()
    key: Any = chance.choice(list(copy) if isinstance(copy, dict) else range(len(copy)))
    what = chance.random()
    if what < 0.1:
        del copy[key]
    elif what < 0.2 and isinstance(copy, dict):
        copy[chance.choice(["name", "x", "nmae", "scan", "photos", ""])] = copy.pop(key)
    elif what < 0.3 and isinstance(copy, list):
        copy.append(copy[key])
    else:
        copy[key] = change_somewhere(copy[key], chance)
    return copy


@given(st.integers(0, 2**32), st.integers(1, 8))
@settings(max_examples=150, deadline=None)
def test_documents_of_any_values_are_read_or_complained_of(seed: int, changes: int) -> None:
    chance = random.Random(seed)
    document: Any = tomllib.loads(FULL)
    for _ in range(changes):
        document = change_somewhere(document, chance)
    if not isinstance(document, dict):
        document = {"project": document}
    parsed = parse_project("".join(f"{json.dumps(key)} = {toml_of(part)}\n" for key, part in document.items()))
    assert (parsed.value is None) == bool(parsed.complaints)
    for complaint in parsed.complaints:
        assert complaint.line is not None
        assert complaint.message.isprintable()
        assert "not TOML" not in complaint.message or "integer" in complaint.message


def test_a_camera_with_the_lens_of_another_has_its_distance_and_distortion() -> None:
    text = (
        f'{PROJECT}{CAMERA}distortion = {{ A3 = 1e-5, P1 = 2e-6 }}\ndistortion_at = "measured"\nunknown = ["C", "DX"]\n'
    )
    project = definition(f'{text}{OTHER}same_lens_as = "o"\nprincipal_point = [0.1, 0.2]\nunknown = ["DY"]\n')
    lens, other = project.cameras
    assert other.parameters == (8.5, 0.1, 0.2, *lens.parameters[3:])
    assert (other.distortion_at, other.unknown) == ("measured", ("C", "DY"))
    again = project_text(project_document(project))
    assert definition(again) == project
    assert again.count("c = 8.5") == 1


def test_a_table_in_place_of_a_list_of_tables_is_one_complaint(tmp_path: Path) -> None:
    """Photos that name the camera are not told that it is missing."""
    path = tmp_path / "orip.toml"
    text = Path(REPOSITORY, "sample_projects", "small_frame_block", "orip.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("[[camera]]", "[camera]"), encoding="utf-8")
    found = read_project(path, "orip.toml").complaints
    assert [complaint.message for complaint in found] == [
        "camera is one table or value, but may come several times; write each as [[camera]]"
    ]


@pytest.mark.parametrize(
    ("keys", "reduces"),
    [
        ({}, True),
        ({"start_down_weight": 19}, True),
        ({"start_down_weight": 20}, False),
        ({"max_iterations": 9, "start_down_weight": 9}, False),
    ],
)
def test_down_weighting_is_off_where_it_would_begin_with_the_last_iteration(
    keys: dict[str, int], reduces: bool
) -> None:
    # 20 iterations were the most by default: texts that say 20 alone mean never
    lines = "".join(f"{key} = {value}\n" for key, value in keys.items())
    project = definition(f"{PROJECT}[[bundle]]\nname = 'M'\n{lines}")
    assert project.bundles[0].reduces_weights is reduces
