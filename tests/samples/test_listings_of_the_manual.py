"""Every column that ORIPROGRAM's manual names for its displays and listings stands in a listing, with the right figure.

Menus 1.5.1 to 1.5.4 (measuring) and 1.6.1 to 1.6.4 (computing) of U.S. Geological Survey Open-File Report 89-482,
looked for in what the sample projects give. Figures are those of result.json, or computed here from what else is
listed: with the formulas of docs/conventions.md and the digits that are printed. docs/listings.md has the same list for
readers.
"""

from __future__ import annotations

import json
import shutil
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from cli.command_line import orip
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from support.listing_tables import ListedTable, listed_tables
from workflow.small_projects import REPOSITORY

Array = NDArray[np.float64]

SAMPLES = ("dcs260_calibration", "zurich_city_hall", "small_frame_block")
BLOCK = "small_frame_block"


class Adjusted(NamedTuple):
    """A sample project after `orip run` and `orip prelim`."""

    folder: Path
    toml: dict[str, Any]
    result: dict[str, Any]
    prelim: dict[str, Any]

    def tables(self, listing: str, section: str) -> list[ListedTable]:
        """Return the tables of a section of a listing."""
        text = (self.folder / listing).read_text(encoding="utf-8")
        return [table for table in listed_tables(text) if table.section == section]


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Adjusted]:
    """Return the sample project of a name; each is adjusted once."""
    made: dict[str, Adjusted] = {}

    def sample(name: str) -> Adjusted:
        if name not in made:
            folder = tmp_path_factory.mktemp("listings") / name
            shutil.copytree(REPOSITORY / "sample_projects" / name, folder)
            result = orip(folder, "run", "--no-report", "--json")
            assert result.code == 0, result.err
            # the listing that `run` leaves is that of the chain, where it needed the chain
            assert (folder / "PRELIM_RESULT.OUT").exists() == (name == BLOCK)
            toml = tomllib.loads((folder / "orip.toml").read_text(encoding="utf-8"))
            before = {path.name: path.read_bytes() for path in folder.glob("PRELIM_RESULT.OUT")}
            prelim = orip(folder, "prelim", "--json").document
            assert all((folder / name).read_bytes() == text for name, text in before.items())
            made[name] = Adjusted(folder, toml, result.document, prelim)
        return made[name]

    return sample


@pytest.fixture(params=SAMPLES)
def sample(request: pytest.FixtureRequest, samples: Callable[[str], Adjusted]) -> Adjusted:
    """Return each of the sample projects."""
    return samples(request.param)


@pytest.fixture
def block(samples: Callable[[str], Adjusted]) -> Adjusted:
    """Return the one on templates, with models."""
    return samples(BLOCK)


def half(text: str) -> float:
    """Return half a unit of a number's last digit: what it is rounded by."""
    mantissa, _, exponent = text.strip("()").partition("e")
    return 0.5000001 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def number(text: str) -> float:
    return float(text.strip("()"))


def numbers(row: dict[str, str], *columns: str) -> Array:
    return np.array([np.nan if row[column] == "-" else number(row[column]) for column in columns])


def is_printed(text: str, value: float | str | None) -> bool:
    """Tell whether a cell is a figure of result.json, to its last digit."""
    if value is None or isinstance(value, str):
        return text in {"constant", "-"} if value is None else text == value
    return abs(number(text) - value) <= half(text)


# ----------------------------------------------------------------- 1.5.1 template orientation, 1.5.2 photo orientation


def affine(measured: Array, given: Array) -> Array:
    """Return the six parameters (x0 a b, y0 c d) that fit best."""
    design = np.column_stack([np.ones(len(measured)), measured])
    return np.asarray(np.linalg.lstsq(design, given, rcond=None)[0].T)


def named(parameters: Array) -> dict[str, float]:
    """Return x0 y0 ro sk sx sy of an affine transformation, angles in degrees."""
    (x0, a, b), (y0, c, d) = parameters
    ro = np.arctan2(c, a)
    sk = np.arctan2(-b, d) - ro
    return {
        "x0": x0, "y0": y0, "ro": np.degrees(ro), "sk": np.degrees(np.remainder(sk + np.pi, 2 * np.pi) - np.pi),
        "sx": np.hypot(a, c), "sy": np.hypot(b, d),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("section", "given", "measured", "group", "record", "marks"),
    [
        ("TEMPLATE ORIENTATIONS", "template", "plate", "templates", "temtick", "ticks"),
        ("PHOTO ORIENTATIONS", "photo", "template", "photos", "camera", "fiducials"),
    ],
)
def test_orientation_by_marks(
    block: Adjusted, section: str, given: str, measured: str, group: str, record: str, marks: str
) -> None:
    tables = block.tables("INTERIOR_RESULT.OUT", section)
    points, parameters = tables[::2], tables[1::2]
    interior = block.result["interior"][group]
    assert len(points) == len(parameters) == len(interior) > 0
    places = {mark["name"]: (mark["x"], mark["y"]) for mark in block.toml[record][0][marks]}
    for table, (row,) in zip(points, (parameter.rows for parameter in parameters), strict=True):
        columns = (f"X-{given}", f"Y-{given}", f"X-{measured}", f"Y-{measured}", "VX", "VY")
        assert table.columns == ("Mark", *columns)
        values = np.array([numbers(row, *columns) for row in table.rows])
        assert {row["Mark"]: tuple(xy) for row, xy in zip(table.rows, values[:, :2].tolist(), strict=True)} == places
        fitted = affine(values[:, 2:4], values[:, :2])
        residuals = fitted[:, 0] + values[:, 2:4] @ fitted[:, 1:].T - values[:, :2]
        # measured template coordinates are printed to 0.05 micrometres, and residuals to less
        assert values[:, 4:] == pytest.approx(residuals, abs=1e-4)
        (name,) = (orientation for orientation in interior if f" {orientation}:" in table.caption)
        assert tuple(row)[:6] == ("x0", "y0", "ro", "sk", "sx", "sy")
        assert all(is_printed(row[key], interior[name][key]) for key in row if key and key != "Redundancy")
        # 0.05 micrometres at marks that are 20 mm and more from each other, and up to 100 mm from the origin
        for key, value in named(fitted).items():
            assert number(row[key]) == pytest.approx(value, abs=5e-4), key
        s0 = np.sqrt((residuals**2).sum() / (2 * len(residuals) - 6))
        assert number(row["s0"]) == pytest.approx(s0, abs=1e-4)
        assert int(row["Redundancy"]) == 2 * len(residuals) - 6


# ------------------------------------------------------------------------------------------ 1.5.3, 1.5.4 photo points


def template_coordinates(sample: Adjusted) -> dict[tuple[str, str], Array]:
    """Return where each photo point lies on its template, from the logs: pixels of cameras without marks."""
    template_of = {
        photo: template["name"] for template in sample.toml.get("template", ()) for photo in template["photos"]
    }
    ticks = {
        tick["name"]: np.array([tick["x"], tick["y"]]) for tick in sample.toml.get("temtick", [{}])[0].get("ticks", ())
    }
    found: dict[tuple[str, str], Array] = {}
    fitted: dict[str, Array] = {}
    for keyword, owner, names, measured in log_records(sample):
        if keyword == "TEMPLATE":
            fitted[owner] = affine(measured, np.array([ticks[name] for name in names]))
        elif keyword == "POINTS":
            mounted = fitted[template_of[owner]] if owner in template_of else np.eye(2, 3, 1)
            places = mounted[:, 0] + measured @ mounted[:, 1:].T
            found.update({(owner, name): xy for name, xy in zip(names, places, strict=True)})
    return found


def log_records(sample: Adjusted) -> Iterator[tuple[str, str, list[str], Array]]:
    """Yield keyword, template or photo, names and plate coordinates of each record of the logs."""
    records: list[tuple[str, str, list[list[str]]]] = []
    for path in sorted(sample.folder.glob("*.MEA")):
        for line in path.read_text(encoding="utf-8").splitlines():
            fields = line.split("!")[0].split()
            if fields and fields[0].isalpha() and fields[0].isupper() and not line.startswith(" "):
                records.append((fields[0], fields[2] if fields[0] == "POINTS" else fields[1], []))
            elif fields:
                records[-1][2].append(fields)
    for keyword, owner, rows in records:
        yield keyword, owner, [row[0] for row in rows], np.array([row[1:3] for row in rows], dtype=float)


def image(sample: Adjusted, photo: str, point: str) -> Array:
    """Return the photo coordinates of an adjusted point, with the adjusted values of result.json."""
    values = {
        group: {
            name: {kind: value["value"] for kind, value in one.items() if isinstance(value, dict)}
            for name, one in of.items()
        }
        for group, of in ((group, sample.result[group]) for group in ("cameras", "photos", "points"))
    }
    X0, Y0, Z0, *angles = values["photos"][photo].values()
    (camera,) = values["cameras"].values()
    U = (
        Rotation.from_euler("XYZ", angles, degrees=True)
        .inv()
        .apply(np.array([*values["points"][point].values()]) - [X0, Y0, Z0])
    )
    xy = -camera["C"] * U[:2] / U[2]
    r2 = float(xy @ xy)
    assert camera["A1"] == camera["A7"] == camera["P1"] == camera["P2"] == camera["B1"] == camera["B2"] == 0
    return np.asarray(xy * (1 + camera["A3"] * r2 + camera["A5"] * r2**2) + [camera["DX"], camera["DY"]])


def photo_coordinates(sample: Adjusted, photo: str, xy: Array) -> Array:
    """Return photo coordinates from template coordinates (through result.json's orientation) or pixels."""
    camera = sample.toml["camera"][0]
    if "sensor" in camera:
        sensor = camera["sensor"]
        counts, sizes = (np.array([sensor[key] for key in keys]) for keys in (("columns", "rows"), ("width", "height")))
        return np.asarray((xy - counts / 2) * sizes / counts * [1, -1])
    one = sample.result["interior"]["photos"][photo]
    ro, sk = np.radians([one["ro"], one["sk"]])
    matrix = np.array(
        [
            [one["sx"] * np.cos(ro), -one["sy"] * np.sin(ro + sk)],
            [one["sx"] * np.sin(ro), one["sy"] * np.cos(ro + sk)],
        ]
    )
    return np.asarray([one["x0"], one["y0"]] + matrix @ xy)


def test_photo_points(sample: Adjusted) -> None:
    columns = (
        "Point", "X-template", "Y-template", "WX", "WY", "X_residual", "Y_residual", "SD X", "SD Y", "X WF", "Y WF",
    )  # fmt: skip
    tables = sample.tables("BUNDLE_RESULT.OUT", "PHOTO RESIDUALS")
    assert len(tables) == len(sample.result["photos"])
    places = template_coordinates(sample)
    weights = {
        (observation["photo"], observation["point"], observation["component"]): observation["weight_factor"]
        for observation in sample.result["down_weighted"]
    }
    listed = json.loads(orip(sample.folder, "observations", "list", "--all", "--json").out)["observations"]
    of_commands = {(observation["photo"], observation["point"]): observation for observation in listed}
    seen = 0
    for table in tables:
        assert table.columns[: len(columns)] == columns
        photo = table.caption.split()[1].rstrip(":")
        for row in table.rows:
            seen += 1
            point = row["Point"]
            xy = places[photo, point]
            # the last digit of a coordinate that was transformed may fall to either side
            assert numbers(row, "X-template", "Y-template") == pytest.approx(xy, abs=5.1e-5)
            measured = photo_coordinates(sample, photo, xy)
            residual = image(sample, photo, point) - measured
            assert numbers(row, "X_residual", "Y_residual") == pytest.approx(
                residual, abs=half(row["X_residual"]) + 1e-7
            )
            wanted = [weights.get((photo, point, axis), 1.0) for axis in "xy"]
            factors = numbers(row, "X WF", "Y WF")
            if not np.isnan(factors).any():
                assert factors == pytest.approx(wanted, abs=0.005001)
                # the standard deviation of an adjusted observation, and the standard residual, by their definitions
                error, r = numbers(row, "WX", "WY"), numbers(row, "r X", "r Y")
                whole = factors == 1.0
                sd = sample.result["sigma0"] * error * np.sqrt(1 - r)
                spread = sample.result["sigma0"] * error * np.sqrt(np.clip(1 - r + 0.00501, 0, None)) - sd
                assert (np.abs(numbers(row, "SD X", "SD Y") - sd) <= spread + half(row["SD X"]))[whole].all()
                assert numbers(row, "SR X", "SR Y") == pytest.approx(np.abs(residual) / error, rel=1e-3, abs=0.0051)
            same = of_commands[photo, point]
            assert all(is_printed(row[f"W{axis}"], same["error"][k]) for k, axis in enumerate("XY"))
    assert seen == len(places)


# ----------------------------------------------------------------- 1.6 solve; 1.6.1 cameras, 1.6.2 photos, 1.6.3 points


def test_passes_and_key_figures(sample: Adjusted) -> None:
    (passes,) = sample.tables("BUNDLE_RESULT.OUT", "ITERATIONS")
    assert len(passes.rows) == len(sample.result["iterations"])
    for row, iteration in zip(passes.rows, sample.result["iterations"], strict=True):
        assert is_printed(row["ENP"], iteration["enp"])
        assert is_printed(row["sigma0"], iteration["sigma0"])
        assert (int(row["Down-weighted"]), int(row["Singular"])) == (iteration["down_weighted"], iteration["singular"])
    text = (sample.folder / "BUNDLE_RESULT.OUT").read_text(encoding="utf-8")
    (line,) = (line for line in text.splitlines() if "Standard error of unit weight (sigma0) " in line)
    assert is_printed(line.split("(sigma0)")[1].split()[0], sample.result["sigma0"])


def test_cameras(sample: Adjusted) -> None:
    tables = sample.tables("BUNDLE_RESULT.OUT", "CAMERAS")
    for table, (name, camera) in zip(tables, sample.result["cameras"].items(), strict=True):
        assert table.caption == f"Camera {name}"
        assert [row["Parameter"] for row in table.rows] == [
            kind for kind in camera if kind != "READOUT"
        ]  # none: not listed
        for row in table.rows:
            assert is_printed(row["Value"], camera[row["Parameter"]]["value"])
            assert is_printed(row["Standard deviation"], camera[row["Parameter"]]["sd"])


def test_photos(sample: Adjusted) -> None:
    (table,) = sample.tables("BUNDLE_RESULT.OUT", "PHOTOS")
    kinds = ("X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
    assert table.columns == ("Photo", *kinds)
    pairs = zip(table.rows[::2], table.rows[1::2], sample.result["photos"].items(), strict=True)
    for values, deviations, (name, photo) in pairs:
        assert values["Photo"] == name
        assert all(is_printed(values[kind], photo[kind]["value"]) for kind in kinds)
        assert all(is_printed(deviations[kind], photo[kind]["sd"]) for kind in kinds)


def test_points(sample: Adjusted) -> None:
    table = sample.tables("BUNDLE_RESULT.OUT", "POINTS")[0]
    assert table.columns == ("Point", "Kind", "Rays", "X", "Y", "Z", "sX", "sY", "sZ")
    for row, (name, point) in zip(table.rows, sample.result["points"].items(), strict=True):
        assert (row["Point"], row["Kind"], int(row["Rays"])) == (name, point["kind"], point["rays"])
        assert all(is_printed(row[axis], point[axis]["value"]) for axis in "XYZ")
        assert all(is_printed(row[f"s{axis}"], point[axis]["sd"]) for axis in "XYZ")


def test_warnings_and_errors(sample: Adjusted) -> None:
    text = (sample.folder / "BUNDLE_ERROR.OUT").read_text(encoding="utf-8")
    words = " ".join(text.split())
    assert all(warning["text"] in words for warning in sample.result["warnings"])
    assert all(
        f"{diagnosis['text']}" in words and diagnosis["remedy"] in words for diagnosis in sample.result["diagnosis"]
    )
    rows = [row for table in sample.tables("BUNDLE_ERROR.OUT", "DOWN-WEIGHTED OBSERVATIONS") for row in table.rows]
    assert len(rows) == len(sample.result["down_weighted"])
    for row, observation in zip(rows, sample.result["down_weighted"], strict=True):
        assert (row["Photo"], row["Point or name"], row["Component"]) == (
            observation["photo"],
            observation["point"],
            observation["component"],
        )
        assert is_printed(row["v"], observation["residual"])
        assert is_printed(row["WF"], observation["weight_factor"])


def test_surplus_control_is_a_warning(samples: Callable[[str], Adjusted], tmp_path: Path) -> None:
    shutil.copytree(samples("dcs260_calibration").folder, tmp_path / "surplus")
    with (tmp_path / "surplus" / "DCS260.PNT").open("a", encoding="utf-8") as file:
        file.write("\nFAR 1.0 2.0 3.0 0.1 0.1 0.1\n")
    assert orip(tmp_path / "surplus", "solve", "--no-report").code == 0
    assert "FAR" in (tmp_path / "surplus" / "BUNDLE_ERROR.OUT").read_text(encoding="utf-8")


# ------------------------------------------------------------------------------------------- 1.6.4 preliminary values


def test_relative_orientation_of_all_models(block: Adjusted) -> None:
    (table,) = block.tables("PRELIM_RESULT.OUT", "RELATIVE ORIENTATION")
    assert table.columns == ("Model", "Left", "Right", "npts", "its", "seuw", "mres")
    models = block.toml["bundle"][0]["model"]
    assert [(row["Model"], row["Left"], row["Right"]) for row in table.rows] == [
        (model["name"], model["left"], model["right"]) for model in models
    ]
    details = block.tables("PRELIM_RESULT.OUT", "RELATIVE ORIENTATION: POINTS AND PARAMETERS")
    for row, points, model in zip(table.rows, details[::2], models, strict=True):
        assert int(row["npts"]) == len(points.rows)
        assert int(row["its"]) > 0
        whole = [number(row["py"]) for row in points.rows if not row[""]]
        assert number(row["mres"]) == pytest.approx(np.abs(whole).max(), abs=half(row["mres"]) + 5e-6)
        assert f"row {model['row']}, column {model['column']}" in points.caption
        if len(whole) == len(points.rows):
            error = np.sqrt(2) * block.toml["bundle"][0]["measurement_precision"]
            seuw = np.sqrt((np.array(whole) ** 2).sum() / (len(whole) - 5)) / error
            assert number(row["seuw"]) == pytest.approx(seuw, abs=0.005)  # parallaxes of five decimals


def test_relative_orientation_of_one_model(block: Adjusted) -> None:
    tables = block.tables("PRELIM_RESULT.OUT", "RELATIVE ORIENTATION: POINTS AND PARAMETERS")
    places = template_coordinates(block)
    C = block.toml["camera"][0]["c"]
    for points, parameters in zip(tables[::2], tables[1::2], strict=True):
        assert points.columns == ("Point", "left X", "left Y", "right X", "right Y", "py", "spy")
        assert parameters.columns == ("bx", "by", "bz", "om", "phi", "kp")
        value, deviation = parameters.rows
        # mby mbz mo mf mk, in brackets; the longest component of the base fixes the scale
        base, base_sd = ([row[f"b{axis}"] for axis in "xyz"] for row in (value, deviation))
        assert [sd == "-" for sd in base_sd].index(True) == np.abs(list(map(number, base))).argmax()
        assert all(deviation[key].startswith("(") and number(deviation[key]) > 0 for key in ("om", "phi", "kp"))
        b = np.array(list(map(number, base)))
        R = Rotation.from_euler("XYZ", numbers(value, "om", "phi", "kp"), degrees=True).as_matrix()
        _, _, _, left_photo, _, _, _, right_photo, *_ = points.caption.split()
        for row in points.rows:
            left, right = (np.array([*numbers(row, f"{side} X", f"{side} Y"), -C]) for side in ("left", "right"))
            for photo, vector in ((left_photo, left), (right_photo, right)):
                expected = photo_coordinates(block, photo, places[photo, row["Point"]])
                assert vector[:2] == pytest.approx(expected, abs=5.1e-5)
            # Sampson (1982): the smallest shift of four coordinates that makes the rays meet, in two of them
            E = np.cross(np.eye(3), b) @ -R
            gradient = np.r_[(E @ right)[:2], (E.T @ left)[:2]]
            py = (left @ E @ right) * np.sqrt(2.0) / np.linalg.norm(gradient)
            # four coordinates to 0.05 micrometres, angles to 1e-5 degrees, base to 0.05 of 15 000
            assert abs(number(row["py"])) == pytest.approx(abs(py), abs=2e-4)
            assert number(row["spy"]) > 0


def model_coordinates(block: Adjusted, after: str) -> dict[str, dict[str, Array]]:
    """Return what `orip prelim show` lists: coordinates by system and point, mm."""
    systems = orip(block.folder, "prelim", "show", "--after", after, "--json").document["systems"]
    return {
        system["name"]: {point: 1000.0 * np.array(one["xyz"]) for point, one in system["points"].items()}
        for system in systems
    }


@pytest.mark.parametrize(
    ("section", "after", "moved"),
    [
        ("MODEL BRIDGING", "relative", "Model {} to model {}"),
        ("CONNECTION", "bridged", "Strip of model {} to strip of model {}"),
    ],
)
def test_bridging_and_connection(block: Adjusted, section: str, after: str, moved: str) -> None:
    (overview,) = block.tables("PRELIM_RESULT.OUT", section)
    assert overview.columns == ("From", "To", "Photo in both", "npts", "its", "seuw", "mres")
    details = block.tables("PRELIM_RESULT.OUT", f"{section}: POINTS AND PARAMETERS")
    systems = model_coordinates(block, after)
    photos = {model["name"]: {model["left"], model["right"]} for model in block.toml["bundle"][0]["model"]}
    for row, points, parameters in zip(overview.rows, details[::2], details[1::2], strict=True):
        assert points.caption.startswith(moved.format(row["From"], row["To"]))
        if section == "MODEL BRIDGING":
            assert {row["Photo in both"]} == photos[row["From"]] & photos[row["To"]]
            assert f"photo {row['Photo in both']} in both" in points.caption
        figures = points.caption.split(":")[-1].split()
        assert figures == ["pnt", row["npts"], "its", row["its"], "s0", row["seuw"]]
        sizes, whole = check_similarity(points, parameters, systems[row["From"]])
        # of a point that is marked as down-weighted some components may have their full weight
        mres = number(row["mres"])
        assert np.abs(sizes - mres).min() < half(points.rows[0]["sX"]) + half(row["mres"])
        assert mres >= sizes[whole].max() - half(points.rows[0]["sX"])


def check_similarity(
    points: ListedTable, parameters: ListedTable, moved: dict[str, Array]
) -> tuple[Array, NDArray[np.bool_]]:
    """Hold the residuals of a similarity against its parameters; return their sizes, and which have full weight."""
    value = check_parameters(points, parameters)
    R = Rotation.from_euler("XYZ", numbers(value, "om", "phi", "kp"), degrees=True)
    scale, shift = number(value["scale"]), numbers(value, "shift X", "shift Y", "shift Z")
    sizes = []
    for row in points.rows:
        xyz = moved[row["Point"]]
        residual = numbers(row, "sX", "sY", "sZ")
        expected = shift + scale * R.apply(xyz) - numbers(row, "X", "Y", "Z")
        # what the last digits of residual, coordinate and shift, of three angles and of the scale may add up to
        turned = np.radians(half(value["om"]) + half(value["phi"]) + half(value["kp"])) * scale
        rounding = 2 * half(row["sX"]) + half(value["shift X"]) + (turned + half(value["scale"])) * np.linalg.norm(xyz)
        assert residual == pytest.approx(expected, abs=rounding)
        sizes.append(np.abs(residual))
    return np.array(sizes), np.array([not row[""] for row in points.rows])


def check_parameters(points: ListedTable, parameters: ListedTable) -> dict[str, str]:
    """Look for the columns of a similarity, standard deviations in brackets; return the row of its parameters."""
    assert points.columns == ("Point", "X", "Y", "Z", "sX", "sY", "sZ")
    assert parameters.columns == ("scale", "shift X", "shift Y", "shift Z", "om", "phi", "kp")
    value, deviation = parameters.rows
    assert (value[""], deviation[""]) == ("value", "sd")
    assert all(deviation[key].startswith("(") and number(deviation[key]) > 0 for key in parameters.columns)
    return value


def test_absolute_orientation(block: Adjusted) -> None:
    points, parameters = block.tables("PRELIM_RESULT.OUT", "ABSOLUTE ORIENTATION")
    assert points.caption.startswith("Block of model 1-1 to the ground:")
    assert f"pnt {len(points.rows)} " in points.caption
    assert " its " in points.caption
    assert " s0 " in points.caption
    check_parameters(points, parameters)
    (system,) = orip(block.folder, "prelim", "show", "--json").document["systems"]
    on_ground = {name: np.array(one["xyz"]) for name, one in system["points"].items()}
    control = {
        fields[0]: np.array(fields[1:4], dtype=float)
        for fields in (line.split("!")[0].split() for line in (block.folder / "CLIFF.PNT").read_text().splitlines())
        if fields
    }
    for row in points.rows:
        given, residual = numbers(row, "X", "Y", "Z"), numbers(row, "sX", "sY", "sZ")
        assert given == pytest.approx(control[row["Point"]], abs=half(row["X"]))
        # points are intersected again when the block is on the ground: that moves them by less than 20 micrometres
        # at the scale of the photos, 1 : 2400
        assert given + residual == pytest.approx(on_ground[row["Point"]], abs=0.05)


def test_preliminary_photos_and_points(sample: Adjusted) -> None:
    (photos,) = sample.tables("PRELIM_RESULT.OUT", "PHOTOS")
    assert photos.columns == ("Photo", "X0", "Y0", "Z0", "OMEGA", "PHI", "KAPPA")
    for row, (name, photo) in zip(photos.rows, sample.prelim["photos"].items(), strict=True):
        assert row["Photo"] == name
        assert all(is_printed(row[kind], photo[kind]) for kind in photos.columns[1:])
    (points,) = sample.tables("PRELIM_RESULT.OUT", "POINTS")
    assert points.columns == ("Point", "X", "Y", "Z", "sX", "sY", "sZ")
    for row, (name, point) in zip(points.rows, sample.prelim["points"].items(), strict=True):
        assert row["Point"] == name
        assert all(is_printed(row[axis], point[axis]) for axis in "XYZ")
