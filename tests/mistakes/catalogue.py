"""The likeliest mistakes: how each is made in a sample project, and what the first line of orip has to tell."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mistakes.edits import SAMPLES, in_control, in_logs, in_photo, in_toml, number, only_photos
from msgspec import Struct

CLIFF = "small_frame_block"
ZURICH = "zurich_city_hall"
DCS = "dcs260_calibration"

SOME_PHOTOS = {"st1", "st2", "st3", "st4", "st5", "st6", "st7"}
"""Photos of Zurich that show a mistake as well as all of them, and in half the time."""


class Mistake(Struct, frozen=True):
    """A mistake.

    Attributes
    ----------
    title : str
    sample : str
    make : callable
        Makes it in a folder with the texts of the sample.
    tells : tuple of str
        Words of the first line: what is concerned, and what is wrong.
    upto : str
        The command that says it: "measure" (after "init") where it is seen before anything is adjusted, else "run".
    listed : bool
        In the documentation; a variant of another one is not.
    """

    title: str
    sample: str
    make: Callable[[Path], None]
    tells: tuple[str, ...]
    upto: str
    listed: bool = True


MISTAKES: dict[str, Mistake] = {}


def mistake(
    title: str, sample: str, *tells: str, upto: str = "run", listed: bool = True
) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    """Enter a function that makes a mistake into the catalogue, under its name."""

    def enter(make: Callable[[Path], None]) -> Callable[[Path], None]:
        MISTAKES[make.__name__] = Mistake(title, sample, make, tells, upto, listed)
        return make

    return enter


def truth() -> dict[str, dict[str, list[float]]]:
    """Return what the block of small frames was simulated from."""
    found: dict[str, dict[str, list[float]]] = json.loads((SAMPLES / CLIFF / "truth.json").read_text(encoding="utf-8"))
    return found


# ------------------------------------------------------------------------------------------------- photos and cameras


@mistake(
    "Wrong camera on a photo", CLIFF, "photo 103", "camera REFLEX35", "not with TELE50",
)  # fmt: skip
def wrong_camera(folder: Path) -> None:
    text = (folder / "orip.toml").read_text(encoding="utf-8")
    record = re.search(r"\[\[camera\]\].*?\n\]\n", text, re.DOTALL)
    assert record
    other = record[0].replace('"REFLEX35"', '"TELE50"').replace("c = 35.0 ", "c = 50.0 ")
    other = re.sub(r"unknown = .*\n", "", other)
    (folder / "orip.toml").write_text(text.replace(record[0], f"{record[0]}\n{other}"), encoding="utf-8")
    in_photo(folder, "103", lambda part: part.replace("REFLEX35", "TELE50"))


@mistake(
    "Principal distance of another lens", CLIFF, "camera REFLEX35", "C = 50 mm does not fit", "35.",
)  # fmt: skip
def other_lens(folder: Path) -> None:
    in_toml(folder, ("c = 35.0 ", "c = 50.0 "), ('unknown = ["C", "DX", "DY", "A3", "A5"]', 'unknown = ["A3", "A5"]'))


@mistake(
    "Focal length as the equivalent for 35 mm film", ZURICH, "camera OLYMPUS", "C = 36 mm", "equivalent for 35 mm film",
)  # fmt: skip
def equivalent_focal_length(folder: Path) -> None:
    only_photos(folder, SOME_PHOTOS)
    in_toml(folder, ("c = 8.595 ", "c = 36.0 "))


@mistake(
    "Principal distance in pixels", ZURICH, "error: camera OLYMPUS", "in pixels", "write c = 8.59503",
)  # fmt: skip
def principal_distance_in_pixels(folder: Path) -> None:
    in_toml(folder, ("c = 8.595 ", "c = 1334.34 "))


@mistake(
    "Sensor size of another camera", ZURICH, "camera OLYMPUS", "C = 8.595 mm does not fit", "the size of the sensor",
)  # fmt: skip
def sensor_size(folder: Path) -> None:
    only_photos(folder, SOME_PHOTOS)
    in_toml(folder, ("width = 8.245", "width = 36.0"), ("height = 6.6", "height = 28.8"))


@mistake(
    "Width and height of the sensor exchanged", ZURICH, "camera OLYMPUS", "pixels are square", "width and height",
    upto="measure",
)  # fmt: skip
def sensor_turned(folder: Path) -> None:
    in_toml(folder, ("width = 8.245, height = 6.6", "width = 6.6, height = 8.245"))


@mistake(
    "Distortion of the opposite sign", CLIFF, "camera REFLEX35", "distortion", "opposite sign",
)  # fmt: skip
def distortion_sign(folder: Path) -> None:
    distortion = "distortion = { A3 = 3.1e-5, A5 = -3.2e-8 }"
    in_toml(folder, ('unknown = ["C", "DX", "DY", "A3", "A5"]', f'{distortion}\nunknown = ["C", "DX", "DY"]'))


# ------------------------------------------------------------------------------------------------ measuring the photos


@mistake(
    "Pixel rows counted upwards", ZURICH, "camera OLYMPUS", "rows seem to count upwards", "1024 - row",
)  # fmt: skip
def rows_upwards(folder: Path) -> None:
    in_logs(folder, lambda _, words: [*words[:2], number(words[2], -1.0, 1024.0)])


@mistake(
    "Pixel rows counted upwards, plane object", DCS, "other side of the plane", "rows may count upwards",
    listed=False,
)  # fmt: skip
def rows_upwards_on_a_plane(folder: Path) -> None:
    in_logs(folder, lambda _, words: [*words[:2], number(words[2], -1.0, 1024.0)])


@mistake(
    "Row before column", ZURICH, "camera OLYMPUS", "lie outside", "column first",
    upto="measure",
)  # fmt: skip
def row_before_column(folder: Path) -> None:
    in_logs(folder, lambda _, words: [words[0], words[2], words[1]])


TURNED = {"1": "3", "3": "1", "2": "4", "4": "2", "5": "7", "7": "5", "6": "8", "8": "6"}
QUARTER = {"1": "2", "2": "3", "3": "4", "4": "1", "5": "6", "6": "7", "7": "8", "8": "5"}
TURNED_OVER = {"1": "2", "2": "1", "3": "4", "4": "3", "5": "5", "6": "8", "7": "7", "8": "6"}
"""Name by position of each mark of the cliff's camera and sheets, on film that lies so."""


@mistake(
    "A scan turned by 180°, fiducial marks named by their position in it",
    CLIFF, "photo 103", "turned by 180°", "3 is 1",
    upto="measure",
)  # fmt: skip
def turned_scan(folder: Path) -> None:
    in_logs(folder, lambda header, words: [TURNED[words[0]], *words[1:]] if header[:2] == ["PHOTO", "103"] else words)


@mistake(
    "Fiducial marks named from another corner", CLIFF, "photo 103", "turned by 90°", "2 is 1",
    upto="measure",
)  # fmt: skip
def other_corner(folder: Path) -> None:
    in_logs(folder, lambda header, words: [QUARTER[words[0]], *words[1:]] if header[:2] == ["PHOTO", "103"] else words)


@mistake(
    "Film scanned emulsion up, marks named by their position in the scan",
    CLIFF, "photos 101, 102, 103 and 9 more", "upside down",
    upto="measure",
)  # fmt: skip
def emulsion_up(folder: Path) -> None:
    in_logs(
        folder,
        lambda header, words: [
            words[0] if header[0] == "POINTS" else TURNED_OVER[words[0]], number(words[1], -1.0), words[2]
        ],
    )  # fmt: skip


@mistake(
    "Film scanned emulsion up, marks named as on the film", CLIFF, "templates LEFT and RIGHT", "mirror image",
    upto="measure",
)  # fmt: skip
def emulsion_up_named(folder: Path) -> None:
    in_logs(folder, lambda _, words: [words[0], number(words[1], -1.0), words[2]])


@mistake(
    "A template mounted upside down, tick marks named by their position", CLIFF, "template LEFT", "turned by 180°",
    upto="measure",
)  # fmt: skip
def template_upside_down(folder: Path) -> None:
    second_day = {"201", "203", "205"}
    first = (folder / "DAY1.MEA").read_text(encoding="utf-8")

    def turned(header: list[str], words: list[str]) -> list[str]:
        if header[:2] == ["TEMPLATE", "LEFT"]:
            return [TURNED[words[0]], *(number(word, -1.0) for word in words[1:])]
        return [words[0], *(number(word, -1.0) for word in words[1:])] if header[-1] in second_day else words

    in_logs(folder, turned)
    (folder / "DAY1.MEA").write_text(first, encoding="utf-8")


@mistake(
    "Two photos exchanged", ZURICH, "photos st3 and st8", "exchanged",
)  # fmt: skip
def exchanged_photos(folder: Path) -> None:
    other = {"st3": "st8", "st8": "st3"}
    in_logs(folder, lambda _, words: words, lambda header: [*header[:2], other.get(header[2], header[2])])


@mistake(
    "Two photos on a template exchanged", CLIFF, "photo 102", "photo 104", "exchanged",
    upto="measure",
)  # fmt: skip
def exchanged_on_a_template(folder: Path) -> None:
    other = {"102": "104", "104": "102"}
    in_logs(
        folder,
        lambda _, words: words,
        lambda header: [*header[:2], other.get(header[2], header[2])] if header[0] == "POINTS" else header,
    )


@mistake(
    "The same photo under two names", CLIFF, "photo 113", "photo 103", "one photo",
)  # fmt: skip
def photo_twice(folder: Path) -> None:
    text = (folder / "DAY1.MEA").read_text(encoding="utf-8")
    parts = re.split(r"(?m)^(?=TEMPLATE|PHOTO|POINTS|! )", text)
    again = [part.replace(" 103", " 113", 1) for part in parts if re.match(r"(PHOTO|POINTS MAIN) 103", part)]
    (folder / "DAY1.MEA").write_text(f"{text}\n{''.join(again)}", encoding="utf-8")
    record = '[[photo]]\nname = "{}"\ncamera = "REFLEX35"\n'
    in_toml(
        folder,
        (record.format("104"), f"{record.format('113')}\n{record.format('104')}"),
        ('"103", "105", "201"', '"103", "113", "105", "201"'),
    )


@mistake(
    "A photo that is measured, but is not in the project", ZURICH, "ZURICH.MEA:137", "photo st10 is not defined",
)  # fmt: skip
def unknown_photo(folder: Path) -> None:
    in_logs(folder, lambda _, words: words, lambda header: [*header[:2], header[2].replace("st9", "st10")])


@mistake(
    "One number for two points", CLIFF, "point 1401", "one number for two points",
)  # fmt: skip
def one_number_for_two_points(folder: Path) -> None:
    in_logs(folder, lambda _, words: [re.sub("^1102$", "1401", words[0]), *words[1:]])


@mistake(
    "A point measured under another number", CLIFF, "photo 204", "point 1301", "probably 1302",
)  # fmt: skip
def another_number(folder: Path) -> None:
    in_logs(
        folder,
        lambda header, words: (
            {"1301": None, "1302": ["1301", *words[1:]]}.get(words[0], words)
            if header == ["POINTS", "MAIN", "204"]
            else words
        ),
    )


@mistake(
    "One number twice in a photo", ZURICH, "ZURICH.MEA:10", "'101' is measured twice",
)  # fmt: skip
def number_twice_in_a_photo(folder: Path) -> None:
    in_logs(
        folder, lambda header, words: ["101", *words[1:]] if header[-1] == "st1" and words[0] == "121" else words
    )  # fmt: skip


@mistake(
    "A point measured in the wrong place", CLIFF, "104", "point 1308", "does not fit",
)  # fmt: skip
def mispointed(folder: Path) -> None:
    in_logs(
        folder,
        lambda header, words: (
            [words[0], number(words[1], 1.0, 0.2), words[2]]
            if header == ["POINTS", "MAIN", "104"] and words[0] == "1308"
            else words
        ),
    )


# ------------------------------------------------------------------------------------------------------------- control


@mistake(
    "North, east in place of east, north", CLIFF, "X and Y of the control are exchanged", "north, east",
)  # fmt: skip
def north_east(folder: Path) -> None:
    in_control(folder, lambda words: [words[0], words[2], words[1], *words[3:]])


@mistake(
    "North, east in place of east, north; orientations are given", ZURICH, "X and Y are exchanged", "north, east",
    listed=False,
)  # fmt: skip
def north_east_against_orientations(folder: Path) -> None:
    in_control(folder, lambda words: [words[0], words[2], words[1], *words[3:]])


def in_feet(words: list[str]) -> list[str]:
    return [words[0], *(number(word, 1.0 / 0.3048) for word in words[1:4]), *words[4:]]


@mistake(
    "Control in feet, distances in metres", CLIFF, "distances", "metres, and the control in feet",
)  # fmt: skip
def feet(folder: Path) -> None:
    in_control(folder, in_feet)


@mistake(
    "Control in feet, orientations in metres", ZURICH, "0.3048", "feet", "orientations in metres",
    listed=False,
)  # fmt: skip
def feet_against_orientations(folder: Path) -> None:
    in_control(folder, in_feet)


@mistake(
    "Heights in feet, X and Y in metres", CLIFF, "Z seems to be in feet",
)  # fmt: skip
def heights_in_feet(folder: Path) -> None:
    in_control(folder, lambda words: [*words[:3], number(words[3], 1.0 / 0.3048), *words[4:]])


@mistake(
    "Longitude and latitude in place of projected coordinates", CLIFF, "longitude and latitude in degrees",
)  # fmt: skip
def longitude_and_latitude(folder: Path) -> None:
    def degrees(words: list[str]) -> list[str]:
        latitude = 60.7 + float(words[2]) / 111195.0
        longitude = -45.9 + float(words[1]) / (111195.0 * np.cos(np.radians(latitude)))
        return [words[0], f"{longitude:.8f}", f"{latitude:.8f}", *words[3:]]

    in_control(folder, degrees)


@mistake(
    "0 for an unknown height", CLIFF, "control point CP3", "Z = 0", "value is not known",
)  # fmt: skip
def placeholder_height(folder: Path) -> None:
    in_control(folder, lambda words: [*words[:3], "0", *words[4:]] if words[0] == "CP3" else words)


@mistake(
    "0 for an unknown height, control constant", ZURICH, "control point 121", "Z = 0", "value is not known",
    listed=False,
)  # fmt: skip
def placeholder_height_held(folder: Path) -> None:
    in_control(folder, lambda words: [*words[:3], "0", *words[4:]] if words[0] == "121" else words)


@mistake(
    "Two digits exchanged in a coordinate", CLIFF, "control point CP4", "probably 194.989", "two digits",
)  # fmt: skip
def exchanged_digits(folder: Path) -> None:
    in_control(folder, lambda words: [words[0], "149.989", *words[2:]] if words[0] == "CP4" else words)


@mistake(
    "Missing minus", CLIFF, "control point CP1", "probably -2.615", "sign",
)  # fmt: skip
def missing_minus(folder: Path) -> None:
    in_control(folder, lambda words: [*words[:2], "2.615", *words[3:]] if words[0] == "CP1" else words)


@mistake(
    "Missing minus, control constant", DCS, "control point 11", "probably -0.101895", "sign",
    listed=False,
)  # fmt: skip
def missing_minus_held(folder: Path) -> None:
    in_control(folder, lambda words: [words[0], "0.101895", *words[2:]] if words[0] == "11" else words)


@mistake(
    "Two control points exchanged", CLIFF, "control points CP1 and CP2", "exchanged",
)  # fmt: skip
def exchanged_control(folder: Path) -> None:
    other = {"CP1": "CP2", "CP2": "CP1"}
    in_control(folder, lambda words: [other.get(words[0], words[0]), *words[1:]])


@mistake(
    "A control point given twice", CLIFF, "CLIFF.PNT:4", "'CP1' is already on line 3",
)  # fmt: skip
def control_twice(folder: Path) -> None:
    in_control(folder, lambda words: [words[0].replace("CP2", "CP1"), *words[1:]])


@mistake(
    "Heights above the ellipsoid beside heights above the geoid", CLIFF, "check points", "in Z", "height system",
)  # fmt: skip
def two_height_systems(folder: Path) -> None:
    in_control(
        folder, lambda words: [*words[:3], number(words[3], 1.0, 46.7), *words[4:]] if words[0][1] == "K" else words
    )  # fmt: skip


@mistake(
    "Decimal comma", CLIFF, "CLIFF.PNT:3:6", "'72,012' has a decimal comma", "72.012",
)  # fmt: skip
def decimal_comma(folder: Path) -> None:
    in_control(folder, lambda words: [words[0], *(word.replace(".", ",") for word in words[1:])])


# ------------------------------------------------------------------------------------- a-priori errors, units of angles


@mistake(
    "A-priori errors of control in mm", CLIFF, "control points fit", "seem to be in mm",
)  # fmt: skip
def control_errors_in_mm(folder: Path) -> None:
    in_control(folder, lambda words: [*words[:4], *(number(word, 1e3) for word in words[4:])])


@mistake(
    "Measurement precision in pixels", DCS, "measurement_precision = 1 mm", "205 pixels", "'1px'",
)  # fmt: skip
def precision_in_pixels(folder: Path) -> None:
    in_toml(folder, ("measurement_precision = 0.005 ", "measurement_precision = 1 "))


@mistake(
    "Measurement precision in micrometres", CLIFF, "measurement_precision = 2.2 mm", "write 0.0022",
    listed=False,
)  # fmt: skip
def precision_in_micrometres(folder: Path) -> None:
    in_toml(folder, ("measurement_precision = 0.0022 ", "measurement_precision = 2.2 "))


@mistake(
    "Measurement precision in metres", CLIFF, "measurement_precision = 2.2e-06", "metres", "0.0022",
    listed=False,
)  # fmt: skip
def precision_in_metres(folder: Path) -> None:
    in_toml(folder, ("measurement_precision = 0.0022 ", "measurement_precision = 2.2e-6 "))


@mistake(
    "Preliminary angles in gon", CLIFF, "OMEGA, PHI and KAPPA", "gon", "by 0.9",
)  # fmt: skip
def orientations_in_gon(folder: Path) -> None:
    for name, (*centre, omega, phi, kappa) in truth()["photos"].items():
        values = [*centre, *(round(angle) / 0.9 for angle in (omega, phi, kappa))]
        keys = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
        lines = "".join(f"{key} = {value:.4f}\n" for key, value in zip(keys, values, strict=True))
        camera = 'camera = "REFLEX35"\n'
        in_photo(folder, name, lambda part, new=camera + lines, old=camera: part.replace(old, new))


@mistake(
    "Preliminary angles in radians", ZURICH, "OMEGA, PHI and KAPPA", "radians", "57.29",
    listed=False,
)  # fmt: skip
def orientations_in_radians(folder: Path) -> None:
    path = folder / "orip.toml"
    text = path.read_text(encoding="utf-8")
    angle = re.compile(r"(?m)^(OMEGA|PHI|KAPPA) = (.*)$")
    path.write_text(angle.sub(lambda found: f"{found[1]} = {np.radians(float(found[2])):.6f}", text), encoding="utf-8")


@mistake(
    "Theodolite directions in gon", CLIFF, "theodolite directions", "gon", "by 0.9",
)  # fmt: skip
def directions_in_gon(folder: Path) -> None:
    points = truth()["points"]
    random = np.random.default_rng(1989)
    station = np.array([120.0, -90.0, 30.0])
    lines = []
    for name in ("CP1", "CP2", "1102", "1205", "1307", "2110", "2207", "2409"):
        x, y, z = np.array(points[name]) - station
        direction, zenith = np.degrees([np.arctan2(x, y), np.arctan2(np.hypot(x, y), z)]) + random.normal(0, 0.003, 2)
        lines.append(f"S1 ST {name} {(direction + 40.0) / 0.9:.4f} 0.003 {zenith / 0.9:.4f} 0.003\n")
    (folder / "CLIFF.DIR").write_text("".join(lines), encoding="utf-8")
    with (folder / "CLIFF.PNT").open("a", encoding="utf-8") as control:
        control.write("  ST 120.01 -90.01 30.01 0.02 0.02 0.02\n")


@mistake(
    "Distances in feet", CLIFF, "distances", "0.3048", "feet, and the control in metres",
    listed=False,
)  # fmt: skip
def distances_in_feet(folder: Path) -> None:
    in_control(folder, lambda words: [*words[:4], number(words[4], 1.0 / 0.3048), words[5]], "LEN")


# -------------------------------------------------------------------------------- files as other programs write them


@mistake(
    "Fields separated by commas", CLIFF, "CLIFF.PNT:3", "separate fields by blanks or tabs, not by ','",
)  # fmt: skip
def separated_by_commas(folder: Path) -> None:
    in_control(folder, lambda words: [",".join(words)])


@mistake(
    "A heading above the columns", CLIFF, "CLIFF.PNT:1", "no numbers", "begin a heading with !",
)  # fmt: skip
def heading(folder: Path) -> None:
    path = folder / "CLIFF.PNT"
    path.write_text(f"name X Y Z aX aY aZ\n{path.read_text(encoding='utf-8')}", encoding="utf-8")


@mistake(
    "A text saved as UTF-16 (Windows: Unicode)", CLIFF, "CLIFF.PNT:1", "the file is UTF-16",
)  # fmt: skip
def saved_as_utf_16(folder: Path) -> None:
    path = folder / "CLIFF.PNT"
    path.write_text(path.read_text(encoding="utf-8"), encoding="utf-16")


@mistake(
    "A file called .PNT.txt (Windows hides the end)", CLIFF, "CLIFF.PNT.txt", "called CLIFF.PNT; rename it",
)  # fmt: skip
def hidden_extension(folder: Path) -> None:
    (folder / "CLIFF.PNT").rename(folder / "CLIFF.PNT.txt")


@mistake(
    "A measurement file in small letters", CLIFF, "day1.mea", "not read", "*.MEA; rename it",
    upto="measure", listed=False,
)  # fmt: skip
def small_letters(folder: Path) -> None:
    (folder / "DAY1.MEA").rename(folder / "day1.mea")


@mistake(
    "Typographic quotation marks in orip.toml", CLIFF, "orip.toml:4:8", "typographic quotation marks",
)  # fmt: skip
def typographic_quotes(folder: Path) -> None:
    in_toml(folder, ('name = "CLIFF"', "name = “CLIFF”"))


@mistake(
    "No quotation marks in orip.toml", CLIFF, "orip.toml:4:8", 'quotation marks; write "CLIFF"',
    listed=False,
)  # fmt: skip
def no_quotes(folder: Path) -> None:
    in_toml(folder, ('name = "CLIFF"', "name = CLIFF"))


@mistake(
    "Control is missing", CLIFF, "12 of 12 photos", "no control point is in the block, 3 are needed",
)  # fmt: skip
def no_control(folder: Path) -> None:
    (folder / "CLIFF.PNT").unlink()


@mistake(
    "Principal distance in metres", CLIFF, "error: camera REFLEX35", "is that of no lens", "write c = 35",
)  # fmt: skip
def principal_distance_in_metres(folder: Path) -> None:
    in_toml(folder, ("c = 35.0 ", "c = 0.035 "))


@mistake(
    "Size of a pixel in place of the sensor's", ZURICH, "error: camera OLYMPUS", "the size of a pixel in mm",
    "width = 8.24",
)  # fmt: skip
def pixel_as_sensor(folder: Path) -> None:
    in_toml(folder, ("width = 8.245, height = 6.6", "width = 0.00644, height = 0.00644"))


@mistake(
    "Control in centimetres, distances in metres", CLIFF, "distances", "by 100", "the control in centimetres",
    listed=False,
)  # fmt: skip
def control_in_centimetres(folder: Path) -> None:
    in_control(folder, lambda words: [words[0], *(number(word, 100.0) for word in words[1:])])
