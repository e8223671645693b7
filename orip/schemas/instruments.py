"""Types of the documents of pictures, receivers and inertial units: targets, tie points, positions, trajectories."""

from __future__ import annotations

from typing import Literal

from orip.schemas.project import Part, Warned


class RejectedTarget(Part, frozen=True):
    """What was not measured in a picture, and why; its name, where it is known by its place; pixels."""

    name: str
    column: float
    row: float
    reason: str


class DetectedPhoto(Part, frozen=True):
    """How many marks were measured in a picture; `fault`: why none."""

    photo: str
    image: str
    marks: int
    fault: str
    rejected: list[RejectedTarget]


class Detect(Part, frozen=True):
    """Targets of pictures, and the files that they were, or would be, written to; or the board that was drawn."""

    command: Literal["detect"]
    file: str
    photos: list[DetectedPhoto]
    files: list[str]
    dry_run: bool


class MatchedPhoto(Part, frozen=True):
    """A photo of which tie points were measured."""

    name: str
    features: int
    rays: int


class Match(Part, frozen=True):
    """Tie points that were measured in the images of the photos, and the rays that were rejected, by the reason."""

    command: Literal["match"]
    file: str
    photos: list[MatchedPhoto]
    pairs: int
    compared_pairs: int
    tracks: int
    contradictory_tracks: int
    points: int
    rays: int
    rejected_rays: dict[str, int]
    error_factor: float | None
    warnings: list[Warned]


class DoubtedEpochs(Part, frozen=True):
    """Successive epochs that are not to be trusted: seconds since 1980-01-06, GPS time, and why."""

    begin: float
    end: float
    epochs: int
    why: str


class SatelliteUsed(Part, frozen=True):
    """A satellite: epochs, residuals of its phases (RMS, m), cycle slips."""

    name: str
    epochs: int
    residual: float
    slips: int


class Gnss(Part, frozen=True):
    """Positions of a receiver: m, m², geocentric; place, covariance and closure of one that stands, else null."""

    command: Literal["gnss positions"]
    file: str
    dry_run: bool
    way: Literal["static", "kinematic", "epochs"]
    engine: str
    base: list[float]
    epochs: int
    epochs_in_common: int
    events: int
    fixed: int
    floating: int
    place: list[float] | None
    covariance: list[list[float]] | None
    closure: list[float] | None
    satellites: list[SatelliteUsed]
    doubted: list[DoubtedEpochs]
    warnings: list[Warned]


class NoiseFactors(Part, frozen=True):
    """By which the standard deviations given of the unit's white noise, positions and velocities were multiplied."""

    gyro: float
    accelerometer: float
    position: float
    velocity: float


class Imu(Part, frozen=True):
    """A smoothed trajectory: seconds since 1980-01-06, m, radians; medians of standard deviations east, north, up.

    `forward`: of the filter alone. `innovations`: positions less predicted ones, in standard deviations (RMS).
    """

    command: Literal["imu smooth"]
    forward: bool
    standing: int
    innovations: float | None
    files: list[str]
    dry_run: bool
    time_system: str
    begin: float
    end: float
    positions: int
    residual_rms: list[float]
    factors: NoiseFactors
    place_sd: list[float]
    angle_sd: list[float]
    gyro_bias: list[float]
    accelerometer_bias: list[float]
    warnings: list[Warned]


class SensorNoise(Part, frozen=True):
    """Of one axis: random walk per root of s, bias instability, random walk of the bias; Allan deviations."""

    random_walk: float
    instability: float
    bias_walk: float
    tau: list[float]
    deviation: list[float]


class ImuNoise(Part, frozen=True):
    """Noise of an inertial unit that stood: rad/s, m/s², s, along forward, right, down; and the values of `noise`."""

    command: Literal["imu noise"]
    file: str
    duration: float
    gyro: list[SensorNoise]
    accelerometer: list[SensorNoise]
    gyro_mean: list[float]
    force_mean: list[float]
    noise: list[float]


class NetworkMark(Part, frozen=True):
    """A mark: geocentric, m, and in the project's coordinates with standard deviations."""

    name: str
    place: list[float]
    X: float
    Y: float
    Z: float
    error: list[float]


class NetworkLine(Part, frozen=True, rename={"first": "from", "second": "to"}):
    """A baseline; the residual is adjusted less observed, geocentric, m."""

    first: str
    second: str
    fixed: bool
    residual: list[float]
    wrong: bool


class GnssNetwork(Part, frozen=True):
    """A network of baselines with one mark held; covariances of all marks, geocentric, m²."""

    command: Literal["gnss network"]
    files: list[str]
    dry_run: bool
    held: str
    marks: list[NetworkMark]
    baselines: list[NetworkLine]
    sigma0: float | None
    redundancy: int
    covariance: list[list[float]]
    warnings: list[Warned]
