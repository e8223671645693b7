"""Which format a file of positions has, and its epochs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from orip.errors import Complaint
from orip.exchange.stations.dji_mrk import read_dji_mrk
from orip.exchange.stations.image_metadata import ENDINGS, image_files, read_images
from orip.exchange.stations.rtklib_pos import read_rtklib_pos
from orip.exchange.stations.sbet import read_sbet
from orip.exchange.stations.station_table import read_station_table
from orip.files.text.shown import Parsed
from orip.records.observations.epochs import Epochs, epochs

_SBET_ENDINGS = (".sbet", ".out")


def read_epochs(
    path: Path, shown: str, columns: Mapping[str, str] | None = None, deviations: Path | None = None
) -> Parsed[Epochs]:
    """Read a file, or the image files of a folder, by the ending of its name.

    ``.pos`` is RTKLIB, ``.mrk`` an image log of DJI, ``.sbet`` and ``.out`` an SBET, an image its own metadata;
    everything else a table with a heading.

    Parameters
    ----------
    path : Path
    shown : str
    columns : mapping of str to str, optional
        Headings of a table by key.
    deviations : Path, optional
        SMRMSG file beside an SBET.
    """
    ending = path.suffix.lower()
    if path.is_dir():
        try:
            images = image_files(path)
        except OSError as error:
            fault = Complaint(f"the folder cannot be read ({error.strerror})", shown)
            return Parsed(epochs(shown, np.zeros(0, dtype=np.int64)), (fault,))
        return read_images(images, shown)
    if ending in ENDINGS:
        return read_images([path], shown)
    if ending == ".pos":
        return read_rtklib_pos(path, shown)
    if ending == ".mrk":
        return read_dji_mrk(path, shown)
    if ending in _SBET_ENDINGS:
        return read_sbet(path, shown, deviations, "" if deviations is None else deviations.name)
    return read_station_table(path, shown, columns)
