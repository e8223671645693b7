"""Every genuine file of another program: its published figures, there and back, and not a byte changed.

One table has all of them. A file of the folder that is in no row is a failure, and so is a row without a file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from exchange.imported import read_well, reprojected
from exchange.samples import sample_figures as figures
from exchange.samples import sample_sources as sources
from exchange.samples.round_trip import comes_back, local_through_orip, returns, unchanged_files, with_sizes
from msgspec import Struct
from reference.published_data import data_set

from orip.errors import UsageError
from orip.exchange.colmap.reader import read_model
from orip.exchange.colmap.writer import write_model
from orip.exchange.conversion.ground import in_local_ground, local_ground
from orip.exchange.conversion.poses import orip_poses
from orip.exchange.formats import format_named, guessed_source
from orip.exchange.metashape.sensors import read_lens_file
from orip.exchange.opensfm.control_marks import read_control_list
from orip.exchange.photomodeler import read_photomodeler
from orip.exchange.sources.text import Faults
from orip.files.control.stations_text import read_stations, stations_text
from orip.files.exif import exposure_of, image_tags
from orip.files.image_cameras import station_of
from orip.records.control import Station
from orip.records.exchanged import ExchangedProject
from orip.stations.imported import read_epochs

SCEAUX_9 = {
    "photos": "9", "points": "6319", "rays": "25548", "f": "2971.08", "k": "-0.16078",
    "rms": "0.82689", "mean": "0.64605", "stated": "0.61935", "off the stated by less than 0.0055": "1",
}  # fmt: skip
# the list of samples prints 0.79785; a few lines of NumPy without orip give 0.797844 for the same numbers
SCEAUX_11 = {
    "photos": "11", "points": "7862", "rays": "37123", "f": "2971.7121131949616", "k": "-0.16422363658183442",
    "rms": "0.797844", "stated": "0.604344", "off the stated by less than 0.0055": "1",
}  # fmt: skip
SCEAUX_NVM = {"photos": "11", "points": "7817", "rays": "36854", "rms": "1.678", "median": "0.759"}
BERLIN = {
    "photos": "3", "points": "1430", "rays": "3082", "with 2 rays": "1208", "with 3 rays": "222",
    "focal": "0.8696658484855359", "k1": "0.0885146", "k2": "-0.2324428",
    "rms": "2.46476", "mean": "1.32011", "largest": "37.12",
    "X0": "-2.93985", "Y0": "-4.57762", "Z0": "31.04024", "omega": "117.45776", "phi": "-31.28350", "kappa": "15.98081",
    "control": "2", "rays of 0": "2", "rays of 1": "2", "rays of 3": "1",
}  # fmt: skip
# u-of-You is measured in three photos and has no ground coordinates: 16 of 19. With the camera that reproduces the
# file's own pairs to 7e-13 px these have an RMS of 1.433 px; the 15 and 8.105 of the list of samples are not theirs.
PENTAX = {
    "photos": "4", "control": "9", "rays": "19", "rays with ground": "16", "rms": "1.433",
    "omega": "29.09720", "phi": "79.09597", "kappa": "149.13890", "off its own pairs by less than 1e-12": "1",
}  # fmt: skip
MMVII = {
    "photos": "4", "IMGP4167.JPG": "0.053", "IMGP4168.JPG": "0.026", "IMGP4169.JPG": "0.0062", "IMGP4170.JPG": "0.0075",
}  # fmt: skip
# the list of samples prints phi as -0.33322; the matrix in the file has asin(-0.00581754884797473961)
PIX4D = {
    "omega": "2.21488", "phi": "-0.33332", "kappa": "-38.37981",
    "off pmatrix by less than 1e-6": "1", "off position by less than 1e-6": "1",
}  # fmt: skip
IGN = {
    "photos": "7", "ties": "7", "rays of ties": "17", "control": "3", "rays of control": "7",
    "sigma of ties": "0.205", "sigma of control": "0.242",
}  # fmt: skip


class Row(Struct, frozen=True):
    """Files of the folder, as patterns, with what has to be shown of them.

    `shows` asserts the figures. `returns` imports, exports, imports again and compares; its last word is the format in
    which the way back goes. `unchanged`, where the format keeps ids, are the source and the name of the format.
    """

    files: tuple[str, ...]
    shows: Callable[[Path], None]
    returns: Callable[[Path], None]
    unchanged: tuple[Callable[[Path], Path], str] | None = None


def require_printed(found: Mapping[str, float], printed: Mapping[str, str]) -> None:
    """Require figures to be equal to all digits that are printed."""
    for name, text in printed.items():
        digits = len(text.partition(".")[2])
        assert f"{found[name]:.{digits}f}" == text, (name, found[name])


def project_row(
    files: str,
    source: Callable[[Path], Path],
    names: str,
    figures_of: figures.FiguresOf,
    printed: Mapping[str, str],
    with_figures: Callable[[Path], Path] | None = None,
) -> Row:
    """Return the row of a project; names are the format that is read, and that of the way back where it is another."""
    reader, back = names.split(maxsplit=1)[0], names.rsplit(maxsplit=1)[-1]

    def shows(folder: Path) -> None:
        read, place = format_named(reader).read, (with_figures or source)(folder)
        assert read is not None
        require_printed(figures_of(with_sizes(read_well(read, place)), place), printed)

    def there_and_back(folder: Path) -> None:
        given = source(folder / "given")
        ways = [False] if reader != back or reader == "nvm" else [False, True]
        for copies in ways:
            target = folder / ("copy" if copies else "new")
            target.mkdir()
            comes_back(target, given, reader, back, copies=copies)

    unchanged = (source, back) if reader == back and reader != "nvm" else None
    return Row(tuple(files.split()), shows, there_and_back, unchanged)


def own_row(
    files: str,
    project: Callable[[Path], ExchangedProject],
    back: str,
    shows: Callable[[ExchangedProject], None],
    compares: Callable[[ExchangedProject, ExchangedProject], None],
) -> Row:
    """Return the row of files that are no project by themselves: one is made of them."""

    def there_and_back(folder: Path) -> None:
        given = project(folder / "given")
        ground = local_ground(given)
        before = given if ground is None else in_local_ground(given, ground)
        (folder / "new").mkdir()
        compares(before, returns(folder / "new", before, back))

    return Row(tuple(files.split()), lambda folder: shows(project(folder)), there_and_back)


def same_control(before: ExchangedProject, after: ExchangedProject) -> None:
    assert len(before.control) > 0
    expected, found = ({point.name: point.coordinates for point in one.control} for one in (before, after))
    assert found.keys() == expected.keys()
    for name, place in expected.items():
        assert found[name] == pytest.approx(place, abs=1e-9)


def same_cameras(_before: ExchangedProject, after: ExchangedProject) -> None:
    """Cameras and poses have been compared."""
    assert len(after.cameras) == 1


# ---- files that are no projects ----


def _shows_copr(project: ExchangedProject) -> None:
    folder = data_set("exchange") / "odm" / "copr"
    assert len(project.rays.photo) == 27
    assert {point.coordinates[2] for point in project.control} == {0.0}
    assert {point.name for point in project.control} >= {"gcp02"}
    assert project.control_crs.startswith("+proj=utm +zone=11")
    for name, said in (
        ("gcp_list_nocoord.txt", "names no coordinate system"),
        ("gcp_list_noimg.txt", "a field is missing"),
    ):
        faults = Faults(name)
        read_control_list(folder / name, faults)
        assert any(said in complaint.message for complaint in faults.complaints), faults.complaints
    # means of positions without a height
    assert any("Z" in str(one) for one in read_epochs(folder / "GPS_average.txt", "GPS_average.txt").complaints)


def _shows_targets(project: ExchangedProject) -> None:
    assert (len(project.photos), len(project.cameras), len(project.control)) == (8, 2, 4)
    first = project.rays.image[0].tolist()
    assert first == [1003.5037, 3859.1558]
    assert project.control[0].coordinates == (49.6488, 192.0875, 71.7466)


def _shows_twins(project: ExchangedProject) -> None:
    """The lens is its twin of OpenCV with all pixels half a pixel further: their origins differ."""
    folder = data_set("exchange") / "metashape" / "icepy4d"
    camera = read_lens_file(folder / "35mm_280722_selfcal_all_metashape.xml", Faults("lens"))
    assert camera is not None
    assert project.cameras[0].parameters == camera.parameters
    difference = figures.pixels_beside_opencv(camera, folder / "35mm_280722_selfcal_all_opencv.xml")
    # twelve digits of 9263 px in the one file, nine of the coefficients in the other
    assert difference.mean(axis=0) == pytest.approx([0.5, 0.5], abs=5e-7)
    assert np.ptp(difference, axis=0).max() < 2.5e-8
    words, colmap = ((folder / name).read_text() for name in ("p1.txt", "p1_colmap.txt"))
    assert float(colmap.split(",")[0]) == float(words.split()[2])


def _shows_24mm(project: ExchangedProject) -> None:
    """Its twin "of OpenCV" is in truth a file of Agisoft, too."""
    twin = data_set("exchange") / "metashape" / "icepy4d" / "24mm_280722_selfcal_all_opencv.xml"
    camera = read_lens_file(twin, Faults("lens"))
    assert camera is not None
    assert camera.columns == project.cameras[0].columns


def _lens(name: str) -> Callable[[Path], ExchangedProject]:
    return lambda _: sources.photo_of_lens(data_set("exchange") / "metashape" / "icepy4d" / name)


def trajectory_row(files: str, name: str, printed: Mapping[str, str], deviations: str = "") -> Row:
    """Return the row of a trajectory; the way back goes through the text of exposure stations."""

    def read(_: Path) -> figures.Epochs:
        beside = data_set("exchange") / deviations if deviations else None
        parsed = read_epochs(data_set("exchange") / name, name, deviations=beside)
        assert parsed.complaints == ()
        return parsed.value

    def there_and_back(folder: Path) -> None:
        given = [station for station in figures.stations_of(read(folder)) if station.has_position]
        (folder / "a.STA").write_text("CRS EPSG:4979\n" + stations_text(given, is_geographic=True), encoding="utf-8")
        again = read_stations(folder / "a.STA", "a.STA")
        assert again.complaints == ()
        _require_same_stations(given, again.value)

    return Row(tuple(files.split()), lambda _: require_printed(figures.of_epochs(read(_)), printed), there_and_back)


def _require_same_stations(given: list[Station], again: tuple[Station, ...]) -> None:
    assert [station.photo for station in again] == [station.photo for station in given]
    places, found = (np.array([station.position for station in one]) for one in (given, again))
    # ten decimals of a degree, and four of a metre
    assert np.abs(found[:, :2] - places[:, :2]).max() < 1e-9
    assert np.abs(found[:, 2] - places[:, 2]).max() < 1e-4
    errors, those_read = (np.array([station.position_error for station in one]) for one in (given, again))
    assert np.abs(those_read - errors).max() < 1e-4


def _deviations_row() -> Row:
    """Deviations belong to a trajectory that the folder has not: they are compared with their print."""
    folder = "sbet"

    def shows(_: Path) -> None:
        records = np.fromfile(data_set("exchange") / folder / "smrmsg.smrmsg", dtype="<f8").reshape(-1, 10)
        assert len(records) == 21_902
        text = (data_set("exchange") / folder / "smrmsg-first50.txt").read_text().splitlines()[1:]
        rows = np.array([line.split(",") for line in text if line], dtype=float)
        assert rows == pytest.approx(records[: len(rows)], abs=6e-7)

    def there_and_back(folder_of_test: Path) -> None:
        given = figures.stations_with_deviations(folder_of_test, data_set("exchange") / folder / "smrmsg.smrmsg")
        (folder_of_test / "a.STA").write_text("CRS EPSG:4979\n" + stations_text(given, is_geographic=True))
        _require_same_stations(given, read_stations(folder_of_test / "a.STA", "a.STA").value)

    return Row(("sbet/smrmsg.smrmsg", "sbet/smrmsg-first50.txt"), shows, there_and_back)


def _photo_row(path: str) -> Row:
    """Return the row of an image with a position; the way back goes through the text of exposure stations."""

    def stations() -> list[Station]:
        return list(station_of("a", exposure_of(image_tags(data_set("exchange") / path))))

    def shows(_: Path) -> None:
        assert stations()[0].position[:2] == pytest.approx((13.1953889, 55.6981667), abs=1e-7)

    def there_and_back(folder: Path) -> None:
        (folder / "a.STA").write_text("CRS EPSG:4979\n" + stations_text(stations(), is_geographic=True))
        _require_same_stations(stations(), read_stations(folder / "a.STA", "a.STA").value)

    return Row((path,), shows, there_and_back)


def _refused(path: str) -> Row:
    def shows(_: Path) -> None:
        with pytest.raises(UsageError, match="looks like none of the formats"):
            guessed_source(data_set("exchange") / path)[0]

    return Row((path,), shows, shows)


SAISIES = ("micmac", "MMVII-TestDir", "Input", "Saisies-MMV1")
MMVII_FOLDER = "/".join((*SAISIES, "MMVII-PhgrProj"))

ROWS: dict[str, Row] = {
    "COLMAP text": project_row(
        "colmap/sceaux-9-text/*", sources.unpacked("colmap", "sceaux-9-text"), "colmap", figures.of_colmap, SCEAUX_9
    ),
    "COLMAP binary": project_row(
        "colmap/sceaux-11-binary/*", sources.unpacked("colmap", "sceaux-11-binary"), "colmap", figures.of_colmap,
        SCEAUX_11,
    ),
    "COLMAP 4 text": project_row(
        "colmap/sceaux-9-colmap4/text/*", sources.colmap4_text, "colmap", figures.of_colmap, SCEAUX_9
    ),
    "COLMAP 4 binary": project_row(
        "colmap/sceaux-9-colmap4/binary/*", sources.unpacked("colmap", "sceaux-9-colmap4", "binary"), "colmap",
        figures.of_colmap, SCEAUX_9,
    ),
    "VisualSFM": project_row(
        "colmap/visualsfm/sceaux.nvm", sources.in_place("colmap", "visualsfm", "sceaux.nvm"), "nvm", figures.of_nvm,
        SCEAUX_NVM,
    ),
    "Meshroom's BAF is no format of orip": _refused("colmap/visualsfm/meshroom_example.baf"),
    "OpenSfM": project_row(
        "opensfm/berlin/*", sources.berlin, "opensfm", figures.of_opensfm, BERLIN, sources.berlin_with_control
    ),
    "OpenDroneMap's ground control": own_row("odm/copr/*.txt", sources.copr, "blocks", _shows_copr, same_control),
    "Metashape": project_row(
        "metashape/geograypher/camera.xml", sources.in_place("metashape", "geograypher", "camera.xml"), "metashape",
        figures.of_metashape, {"photos": "1", "k4": "-0.0761413904"},
    ),
    "Agisoft's lens of 35 mm": own_row(
        "metashape/icepy4d/35mm* metashape/icepy4d/p1*", _lens("35mm_280722_selfcal_all_metashape.xml"), "metashape",
        _shows_twins, same_cameras,
    ),
    "Agisoft's lens of 24 mm": own_row(
        "metashape/icepy4d/24mm*", _lens("24mm_280722_selfcal_all_metashape.xml"), "metashape", _shows_24mm,
        same_cameras,
    ),
    "tables of targets": own_row("icepy4d-targets/*", sources.targets, "blocks", _shows_targets, same_control),
    "MicMac radial": project_row(
        "/".join((*SAISIES, "*.xml")) + " " + "/".join((*SAISIES, "Ori-Ground_mm3d", "*")),
        sources.in_place(*SAISIES, "Ori-Ground_mm3d"), "micmac", figures.of_micmac, PENTAX,
    ),
    "MicMac Fraser, and a fisheye that is refused": project_row(
        "micmac/MMVII-TestDir/Input/Ori-MMV1/*", sources.in_place("micmac", "MMVII-TestDir", "Input", "Ori-MMV1"),
        "micmac", figures.of_micmac_cameras, {"photos": "7", "off by less than 2e-11": "1"},
    ),
    "MMVII": project_row(
        f"{MMVII_FOLDER}/Ori/toto/* {MMVII_FOLDER}/PointsMeasure/Saisies_MMVII/*",
        sources.in_place(*SAISIES, "MMVII-PhgrProj"), "micmac", figures.of_mmvii, MMVII,
    ),
    "IGN": project_row("opk-ign/*", sources.in_place("opk-ign"), "ign blocks", figures.of_ign, IGN),
    "Pix4D": project_row("pix4d/example*", sources.in_place("pix4d"), "pix4d colmap", figures.of_pix4d, PIX4D),
    "RTKLIB": trajectory_row(
        "rtklib/demo5_b34f_f.pos", "rtklib/demo5_b34f_f.pos",
        {"latitude": "40.097025378", "longitude": "-105.147247371", "height": "1578.8456", "sd north": "1.4193",
         "lines": "4545"},
    ),
    "RTKLIB in Python": trajectory_row(
        "rtklib/py_0315f.pos", "rtklib/py_0315f.pos", {"lines": "4522", "sd north": "1.8441"}
    ),
    "SBET": trajectory_row(
        "sbet/2-points.sbet", "sbet/2-points.sbet",
        {"records": "2", "time": "151631.002836", "latitude in radians": "0.568021",
         "longitude in radians": "-2.041654", "height": "107.715"},
    ),
    "SMRMSG": _deviations_row(),
    "EXIF": _photo_row("exif/lund_01.jpg"),
}  # fmt: skip

LONG = {title: [pytest.mark.long] if title.startswith("COLMAP") else [] for title in ROWS}
NOT_DATA = ("LICENSE", "license", "README", "readme")


def test_no_file_of_the_folder_is_left_out() -> None:
    folder = data_set("exchange")
    files = {path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(NOT_DATA)}
    assert files
    of_rows = {title: {path for pattern in row.files for path in folder.glob(pattern)} for title, row in ROWS.items()}
    assert [title for title, found in of_rows.items() if not found] == []
    assert sorted(str(path) for path in files - set().union(*of_rows.values())) == []


@pytest.mark.parametrize("title", ROWS)
def test_a_sample_has_its_published_figures(tmp_path: Path, title: str) -> None:
    data_set("exchange")
    ROWS[title].shows(tmp_path / "sample")


@pytest.mark.parametrize("title", [pytest.param(title, marks=LONG[title]) for title in ROWS])
def test_a_sample_comes_back(tmp_path: Path, title: str) -> None:
    data_set("exchange")
    ROWS[title].returns(tmp_path)


@pytest.mark.parametrize(
    "title",
    [pytest.param(title, marks=LONG[title]) for title, row in ROWS.items() if row.unchanged and title != "MMVII"],
)
def test_a_copy_of_a_sample_changes_no_byte(tmp_path: Path, title: str) -> None:
    unchanged = ROWS[title].unchanged
    assert unchanged is not None
    source, name = unchanged
    found = unchanged_files(source(tmp_path / "sample"), name)
    assert found
    assert [file for file, is_same in found.items() if not is_same] == []


def test_photomodeler_comes_back_through_colmap_with_corrected_measurements(tmp_path: Path) -> None:
    """Distortion that takes measurements to ideal places has no exact form in COLMAP: `--exact-distortion`."""
    path = data_set("dbat-camcal-selfcal") / "models" / "camcal-pmexport.txt"
    before = with_sizes(read_well(read_photomodeler, path))
    for file, data in write_model(local_through_orip(before, "colmap", corrects=True), None).items():
        (tmp_path / file).write_bytes(data)
    after = read_well(read_model, tmp_path)
    assert len(after.rays.photo) == len(before.rays.photo) == 2074
    expected, found = (orip_poses(one.photos, one.readings[0]) for one in (before, after))
    for values, again in zip(expected, found, strict=True):
        assert again == pytest.approx(values, abs=1e-9)
    first, again = (reprojected(one)[0].rms for one in (before, after))
    # the same directions; a pixel of the one camera is a pixel of the other but for the change of the distortion
    assert again == pytest.approx(first, rel=0.03)
