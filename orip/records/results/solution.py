"""The solution of one bundle adjustment: all that is printed, stored and compared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from msgspec import Struct, field

from orip.records.camera import Projection
from orip.records.figures import FigureEstimate
from orip.records.results.tests import GroupTest, Status, VarianceComponent

if TYPE_CHECKING:  # the store's tables are made from these records, and `orip status` has no use for NumPy
    from orip.arrays import FloatArray, IntArray


class IterationPass(Struct, frozen=True):
    """What one iteration shows: its number, ENP, down-weighted components, singular unknowns, sigma0."""

    iteration: int
    enp: float
    sigma0: float
    down_weighted: int
    singular: int
    step_limited: bool = False


class SingularUnknown(Struct, frozen=True):
    """An unknown that the observations do not determine: group (CAMERA, PHOTO, POINT), name, kind, digits lost."""

    group: str
    name: str
    kind: str
    lost_digits: float


class Correlation(Struct, frozen=True):
    """Correlation coefficient of two unknowns, each named ``camera.C``."""

    a: str
    b: str
    r: float


class Blunder(Struct, frozen=True):
    """An observation found to be wrong, in the order it was found; size and sd in the observation's unit.

    `alternatives` names, separated by semicolons, what explains the same misfit nearly as well and was not left out.
    """

    order: int
    kind: str
    photo: str
    point: str
    component: str
    size: float
    sd: float
    statistic: float
    limit: float
    alternatives: str = ""


class Diagnosis(Struct, frozen=True):
    """A weakness of the block in the user's names, with what to do."""

    code: str
    where: str
    text: str
    remedy: str


class CheckPoint(Struct, frozen=True):
    """Adjusted minus given coordinates (ground unit); NaN where the coordinate is not given."""

    name: str
    dX: float
    dY: float
    dZ: float


class InteriorSummary(Struct, frozen=True):
    """Parameters of one plane transformation of the interior orientation (mm, degrees, unitless scales)."""

    group: Literal["templates", "photos"]
    name: str
    type: str
    x0: float
    y0: float
    ro: float
    sk: float
    sx: float
    sy: float
    s0: float
    redundancy: int


MOST_AS_TEXT = 100_000
"""Observation components up to which an adjustment writes residuals and points as text: listings of half a million
lines take longer than the adjustment, and nobody reads them."""


class Residuals(Struct, frozen=True):
    """One row per observation component; all arrays have length n.

    `residual` is adjusted minus observed; photo components in mm, ground components in ground units, angles in degrees.
    `weight_factor`, `redundancy_number` and `w` are NaN for a disregarded component; `w` also where the redundancy
    number is too small to tell.
    """

    kind: Sequence[str]
    photo: Sequence[str]
    point: Sequence[str]
    component: Sequence[str]
    observed: FloatArray
    residual: FloatArray
    a_priori: FloatArray
    standard_residual: FloatArray
    weight_factor: FloatArray
    redundancy_number: FloatArray
    w: FloatArray


class Reliability(Struct, frozen=True):
    """Reliability of n observation components, in the unit of each; NaN where nothing checks it.

    Parameters
    ----------
    minimal_detectable_bias : array (n,)
        Internal reliability: the smallest error found with probability 0.80 by a test with error probability 0.001.
    external : array (n,)
        Influence of such an error on the unknowns, in standard deviations.
    adjusted_sd : array (n,)
        Standard deviation of the adjusted observation.
    """

    minimal_detectable_bias: FloatArray
    external: FloatArray
    adjusted_sd: FloatArray


class CorrelatedReliability(Struct, frozen=True):
    """The reliability of an observation whose error is correlated with others; `row` is that of the residuals."""

    row: int
    minimal_detectable_bias: float
    external: float
    adjusted_sd: float


class Estimates(Struct, frozen=True):
    """Adjusted values of records of one group.

    Parameters
    ----------
    names : tuple of str, length n
    values, sd : arrays (n, k)
        In the order of `CAMERA_PARAMETERS`, `PHOTO_PARAMETERS` (degrees) or X, Y, Z. A standard deviation is NaN for a
        constant and infinite for an unknown that was removed because nothing determines it.
    """

    names: tuple[str, ...]
    values: FloatArray
    sd: FloatArray


class AdditionalEstimate(Struct, frozen=True):
    """An additional parameter of a camera's set; the standard deviation is infinite for one that was removed."""

    camera: str
    name: str
    value: float
    sd: float


class Exposure(Struct, frozen=True):
    """When and in which strip a photo with a station was taken; NaN and empty where that is not known."""

    photo: str
    strip: str
    time: float


class AntennaEstimate(Struct, frozen=True):
    """A parameter of an antenna, or a shift or drift of its stations.

    Parameters
    ----------
    strip : str
        Of a shift or drift of a strip; else empty.
    name : str
        See `orip.records.definition`.
    value, sd : float
        Ground unit, degrees, seconds, ground unit a second. The standard deviation is NaN for a constant, and infinite
        for one that was removed.
    """

    antenna: str
    strip: str
    name: str
    value: float
    sd: float


class RigEstimate(Struct, frozen=True):
    """A figure of the relative orientation of two cameras that move together.

    Parameters
    ----------
    first, second : str
        Cameras.
    instants : int
        At which both took a photo.
    name : str
        BX, BY, BZ: projection centre of the second camera in the system of the first, ground unit; OMEGA, PHI, KAPPA:
        rotation of the second camera against the first, degrees.
    value, sd : float
        Mean over the instants, and its standard deviation from the cofactors; NaN where all photos are constant. Where
        PHI is ±90 degrees, that of rotations about the axes of the first camera.
    scatter : float
        Standard deviation of one instant as the instants differ; of rotations about the axes of the first camera.
    """

    first: str
    second: str
    instants: int
    name: str
    value: float
    sd: float
    scatter: float


class MountingEstimate(Struct, frozen=True):
    """A parameter of a camera's mounting on a rig.

    Parameters
    ----------
    rig, camera, name : str
        See `orip.records.rig`.
    value, sd : float
        Ground unit, degrees. The standard deviation is NaN for a constant, and infinite for one that was removed.
    """

    rig: str
    camera: str
    name: str
    value: float
    sd: float


class ExposureEstimate(Struct, frozen=True):
    """An element of an exposure of a rig: X0, Y0, Z0 (ground unit), OMEGA, PHI, KAPPA (degrees), as of photos."""

    exposure: str
    rig: str
    name: str
    value: float
    sd: float


class PhotoMotion(Struct, frozen=True):
    """How a photo of a rolling shutter moved while it was exposed.

    Parameters
    ----------
    VX, VY, VZ : float
        Velocity along the project's axes, ground unit a second.
    WX, WY, WZ : float
        Angular rate about them, degrees a second.
    VX_sd, ... : float
        NaN where it follows from the neighbours and is no unknown, infinite where it was removed.
    pixels : float
        Root mean square of the motion of the photo's image points from the first to the last row.
    """

    photo: str
    VX: float
    VX_sd: float
    VY: float
    VY_sd: float
    VZ: float
    VZ_sd: float
    WX: float
    WX_sd: float
    WY: float
    WY_sd: float
    WZ: float
    WZ_sd: float
    pixels: float


class ZeroDirection(Struct, frozen=True):
    """The zero direction R of a set of theodolite directions and its standard deviation, degrees.

    R is the azimuth, clockwise from +Y, of a reading of 0; 0 to 360. The standard deviation is NaN for a constant, and
    infinite for one that was removed.
    """

    set: str
    value: float
    sd: float


class Remark(Struct, frozen=True):
    """A line that listings show with the key figures: what coordinates and rotations refer to."""

    text: str


def _no_correlations() -> FloatArray:
    import numpy as np

    return np.empty((0, 3))


def _no_photo_correlations() -> FloatArray:
    import numpy as np

    return np.empty((0, 15))


class Solution(Struct, frozen=True, weakref=True):
    """Everything that a bundle adjustment gives; see result.json for the meaning of the figures.

    `verdict` is the sentence that comes first where no gate failed.

    `projections` are those of `cameras`, in their order.

    `point_correlations` (n, 3) are the correlation coefficients XY, XZ, YZ of each point, `photo_correlations` (n, 15)
    those of X0, Y0, Z0, OMEGA, PHI, KAPPA: the lower triangle row by row, XY, XZ, YZ first. NaN where a value has no
    standard deviation; without rows they are not known.
    """

    project: str
    user: str
    bundle: str
    ground_unit: str
    run: str
    status: Status
    sigma0: float
    sigma0_all: float
    redundancy: int
    redundancy_used: float
    observations: int
    unknowns: int
    enp: float
    iterations: tuple[IterationPass, ...]
    cameras: Estimates
    photos: Estimates
    points: Estimates
    point_rays: IntArray
    point_kinds: Sequence[str]
    residuals: Residuals
    photo_rotation_sd_about_axes: tuple[bool, ...]
    singular: tuple[SingularUnknown, ...] = ()
    correlations: tuple[Correlation, ...] = ()
    blunders: tuple[Blunder, ...] = ()
    diagnosis: tuple[Diagnosis, ...] = ()
    check_points: tuple[CheckPoint, ...] = ()
    interior: tuple[InteriorSummary, ...] = ()
    inputs: tuple[tuple[str, str], ...] = ()
    warnings: tuple[tuple[str, str, str], ...] = ()
    additional: tuple[AdditionalEstimate, ...] = ()
    remarks: tuple[Remark, ...] = ()
    zero_directions: tuple[ZeroDirection, ...] = ()
    figures: tuple[FigureEstimate, ...] = ()
    antennas: tuple[AntennaEstimate, ...] = ()
    exposures: tuple[Exposure, ...] = ()
    rigs: tuple[RigEstimate, ...] = ()
    mountings: tuple[MountingEstimate, ...] = ()
    rig_exposures: tuple[ExposureEstimate, ...] = ()
    motions: tuple[PhotoMotion, ...] = ()
    verdict: str = ""
    projections: tuple[Projection, ...] = ()
    groups: tuple[GroupTest, ...] = ()
    variance_components: tuple[VarianceComponent, ...] = ()
    photo_correlations: FloatArray = field(default_factory=_no_photo_correlations)
    point_correlations: FloatArray = field(default_factory=_no_correlations)
    correlated: tuple[CorrelatedReliability, ...] = ()

    @property
    def is_large(self) -> bool:
        """Tell whether there are too many residuals to be written as text by every adjustment."""
        return len(self.residuals.kind) > MOST_AS_TEXT
