"""RTKLIB, which does what is computed of phases: its settings, and its run in a process of its own.

pyrtklib5 (RTKLIB demo5) comes with the extra ``gnss``; without it, the program ``rnx2rtkp`` on PATH is used. A process
of its own, because RTKLIB keeps its settings for as long as a process lives, and may end it where a file is damaged.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from msgspec import Struct, field, json

from orip.errors import OripError
from orip.files.text.shown import shown_token

Way = Literal["static", "kinematic", "epochs"]
"""The receiver stands; it moves; it moves, and each epoch is computed by itself."""

SYSTEMS = {"G": 1, "R": 4, "E": 8, "J": 16, "C": 32, "I": 64, "S": 2}
"""Satellite systems by the letters of RINEX, and their bits in RTKLIB."""

_MODES: dict[Way, int] = {"static": 3, "kinematic": 2, "epochs": 2}
_CONTINUOUS, _INSTANTANEOUS = 1, 2


_FREE_VARIANCE = 1e4
"""m²: ambiguities of one epoch are fixed from positions of code alone, which are some metres off."""

_TIME_LIMIT_S = 3600.0
_RESIDUALS = 2
"""States and residuals are written."""


class Settings(Struct, frozen=True):
    """What RTKLIB is asked for.

    Parameters
    ----------
    way : Way
    backward : bool
        From the last epoch to the first.
    base : tuple of 3 float
        Geocentric coordinates of the mark of the base, m.
    rover_antenna, base_antenna : tuple of 3 float
        Of the reference point of the antenna above the mark: east, north, up, m.
    elevation : float
        Least of satellites, degrees.
    frequencies : int
        1 to 3.
    systems : str
        Letters of `SYSTEMS`.
    ratio : float
        Least of the second best to the best set of ambiguities (LAMBDA).
    precise : bool
        Precise orbits are among the files.
    antennas : tuple of 2 str
        Of rover and base, as calibrations name them; empty: none are applied.
    """

    way: Way
    base: tuple[float, float, float]
    backward: bool = False
    rover_antenna: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base_antenna: tuple[float, float, float] = (0.0, 0.0, 0.0)
    elevation: float = 15.0
    frequencies: int = 2
    systems: str = "GREJC"
    ratio: float = 3.0
    precise: bool = False
    antennas: tuple[str, str] = ("", "")

    @property
    def mask(self) -> int:
        """Return the bits of the satellite systems."""
        return sum(SYSTEMS[letter] for letter in set(self.systems))

    @property
    def ambiguities(self) -> int:
        """Return how RTKLIB treats them."""
        return _INSTANTANEOUS if self.way == "epochs" else _CONTINUOUS


class RtklibRequest(Struct, frozen=True):
    """What the process of pyrtklib5 reads: settings, and names of files."""

    settings: Settings
    output: str
    files: list[str] = field(default_factory=list)
    antex: str = ""


def engine() -> str:
    """Return what computes: ``pyrtklib5``, or the path of ``rnx2rtkp``.

    Raises
    ------
    OripError
        If neither is there.
    """
    if find_spec("pyrtklib5") is not None:
        return "pyrtklib5"
    program = shutil.which("rnx2rtkp")
    if program is None:
        message = (
            "RTKLIB is needed to compute positions and is not installed: pip install 'orip[gnss]', or, where that has "
            "no wheel for your platform, put RTKLIB's program rnx2rtkp on PATH"
        )
        raise OripError(message)
    return program


def run_rtklib(
    settings: Settings, texts: Sequence[tuple[str, bytes]], program: str, antex: bytes | None = None
) -> tuple[str, str]:
    """Return a solution as RTKLIB writes it (.pos), and what it says of satellites; empty where there is none.

    Parameters
    ----------
    texts : sequence of (str, bytes)
        Endings (``.obs``, ``.nav``, ``.sp3``) and contents of the files: rover, base, orbits.
    program : str
        What `engine` returned.
    antex : bytes, optional
        Calibrations of antennas.

    Raises
    ------
    OripError
        If RTKLIB broke off, or took longer than an hour.
    """
    with tempfile.TemporaryDirectory(prefix="orip-gnss-") as folder:
        files = []
        for number, (ending, text) in enumerate(texts):
            path = Path(folder, f"{number}{ending}")
            path.write_bytes(text)
            files.append(str(path))
        output, calibrations = Path(folder, "solution.pos"), Path(folder, "antennas.atx")
        if antex is not None:
            calibrations.write_bytes(antex)
        request = RtklibRequest(settings, str(output), files, "" if antex is None else str(calibrations))
        _run(request, output, program)
        return _text_of(output), _text_of(Path(f"{output}.stat"))


def _text_of(path: Path) -> str:
    return path.read_text(encoding="ascii", errors="replace") if path.exists() else ""


def _run(request: RtklibRequest, output: Path, program: str) -> None:
    if program == "pyrtklib5":
        command, given = [sys.executable, "-m", "orip.stations.gnss.rtklib_process"], json.encode(request)
    else:
        options = output.with_suffix(".conf")
        options.write_text(_options(request), encoding="ascii")
        command, given = [program, "-k", str(options), "-o", str(output), *request.files], b""
    try:
        done = subprocess.run(command, input=given, capture_output=True, check=False, timeout=_TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        message = f"RTKLIB has not ended after {_TIME_LIMIT_S / 60:.0f} minutes; give it fewer epochs at a time"
        raise OripError(message) from None
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["it said nothing"]
        message = (
            f"RTKLIB broke off (exit {done.returncode}: {shown_token(last[0])}); a file of observations or orbits is "
            "probably damaged: give the files as the receiver wrote them"
        )
        raise OripError(message)


def _options(request: RtklibRequest) -> str:
    """Return the text of options of rnx2rtkp (RTKLIB 2.4.3 manual, appendix C)."""
    settings = request.settings
    rover, base = settings.rover_antenna, settings.base_antenna
    lines: dict[str, object] = {
        "pos1-posmode": _MODES[settings.way],
        "pos1-frequency": settings.frequencies,
        "pos1-soltype": int(settings.backward),
        "pos1-elmask": settings.elevation,
        "pos1-dynamics": 0,
        "pos1-ionoopt": 1,
        "pos1-tropopt": 1,
        "pos1-sateph": int(settings.precise),
        "pos1-navsys": settings.mask,
        "pos2-armode": settings.ambiguities,
        "pos2-arthres": settings.ratio,
        "out-solformat": 1,
        "out-timesys": 0,
        "out-timeform": 0,
        "out-outstat": _RESIDUALS,
        "ant1-antdele": rover[0],
        "ant1-antdeln": rover[1],
        "ant1-antdelu": rover[2],
        "ant2-postype": 1,
        "ant2-pos1": f"{settings.base[0]:.4f}",
        "ant2-pos2": f"{settings.base[1]:.4f}",
        "ant2-pos3": f"{settings.base[2]:.4f}",
        "ant2-antdele": base[0],
        "ant2-antdeln": base[1],
        "ant2-antdelu": base[2],
    }
    if request.antex:
        lines |= {"ant1-anttype": settings.antennas[0], "ant2-anttype": settings.antennas[1]}
        lines |= {"file-rcvantfile": request.antex, "file-satantfile": request.antex}
        lines["pos1-posopt1"] = lines["pos1-posopt2"] = int(settings.precise)
    return "".join(f"{name:<18}={value}\n" for name, value in lines.items())


def compute(request: RtklibRequest) -> int:
    """Call RTKLIB in this process, with what it calls 0 for done; for `orip.stations.gnss.rtklib_process` alone."""
    import pyrtklib5

    settings, process, output = request.settings, pyrtklib5.prcopt_default, pyrtklib5.solopt_default
    process.mode, process.modear = _MODES[settings.way], settings.ambiguities
    process.soltype, process.nf = int(settings.backward), settings.frequencies
    process.elmin = settings.elevation * pyrtklib5.D2R
    process.navsys = settings.mask
    # a movement that is predicted makes demo5 give standard deviations of 0, and keeps epochs that cannot be judged
    process.dynamics = 0
    process.ionoopt, process.tropopt = pyrtklib5.IONOOPT_BRDC, pyrtklib5.TROPOPT_SAAS
    process.sateph = pyrtklib5.EPHOPT_PREC if settings.precise else pyrtklib5.EPHOPT_BRDC
    process.thresar[0], process.thresar[1] = settings.ratio, _FREE_VARIANCE
    process.refpos = pyrtklib5.POSOPT_POS_XYZ
    for axis in range(3):
        process.rb[axis] = settings.base[axis]
        process.antdel[0, axis], process.antdel[1, axis] = settings.rover_antenna[axis], settings.base_antenna[axis]
    output.posf, output.timef, output.times = pyrtklib5.SOLF_XYZ, 0, pyrtklib5.TIMES_GPST
    paths = pyrtklib5.filopt_t()
    if request.antex:
        for number, antenna in enumerate(settings.antennas):
            for at, letter in enumerate(antenna):
                process.anttype[number, at] = letter
        for at, letter in enumerate(request.antex):
            paths.rcvantp[at] = paths.satantp[at] = letter
        process.posopt[0] = process.posopt[1] = int(settings.precise)
    output.sstat = _RESIDUALS
    always = pyrtklib5.gtime_t()
    files = request.files
    return int(
        pyrtklib5.postpos(always, always, 0.0, 0.0, process, output, paths, files, len(files), request.output, "", "")
    )
