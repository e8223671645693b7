"""A text of orip.toml that says all that can be said."""

FULL = """\
[project]
name = "ZURICH"
user = "K. Dueholm"
camera_file = "../CAMERAS.CAM"
temtick_file = "T.TIK"
project_files = "ZP"
control_files = "ZC"
measurement_files = ["S*.MEA", "EDITS.MEA"]
ground_unit = "US survey foot"
crs = "EPSG:2056"

[check]
gates = ["sigma0<=1.5", "singular==0"]

[[camera]]
name = "FILM"
c = 152
principal_point = [-0.1905, 0.9305]
distortion = { A1 = 1e-3, A3 = 2, A5 = 3, A7 = 4, A9 = 9, P1 = 5, P2 = 6, B1 = 7, B2 = 8 }
distortion_at = "measured"
projection = "equidistant"
frame = [24, 36.0]
fiducials = [ { name = "1", x = -12.0, y = 18.0 }, { name = "2", x = 12, y = 18 } ]
unknown = ["C", "A1"]
set = "EBNER"

[[camera]]
name = "DIGITAL"
c = 8.595
distortion_isp = { R0 = 10.0, A1 = 1e-4 }
sensor = { columns = 1280, rows = 1024, width = 8.245, height = 6.6 }

[[camera]]
name = "CURVE"
c = 9
distortion_curve = [[0, 0], [5, 0.001], [10, 0.002], [12, 0.001], [15, -0.003]]

[[temtick]]
name = "GRID"
ticks = [ { name = "1", x = 10.0, y = 220.0 } ]

[[template]]
name = "T1"
temtick = "grid"
stage = "UPPER"
photos = ["p1"]
scan = { pixel = [0.0127, 0.013], origin = "centre" }

[[template]]
name = "T2"
temtick = "GRID"

[[photo]]
name = "P1"
camera = "film"
X0 = 1
KAPPA = 90.5
constant = ["X0"]

[[photo]]
name = "P2"
camera = "FILM"
template = "t2"

[[photo]]
name = "P3"
camera = "CURVE"
stage = "LOWER"
scan = { pixel = 0.02 }

[[bundle]]
name = "MAIN"
measurement_precision = 0.004
enp_stop = 3
max_iterations = 30
start_down_weight = 30
max_standard_residual = 4
max_lost_digits = 10
datum = "free"
datum_points = ["1", "2"]

[[bundle.model]]
name = "M1"
left = "P1"
right = "P2"
row = 1
column = 2

[report]
title = "Town hall"
client = "City of Zurich"
contractor = "Photogrammetry Ltd"
author = "K. Dueholm"
order = "117"
location = "Zurich"
flown = "1988-07-04"
date = "July 1989"
equipment = "Wild P31"
remarks = ["Of four photos.", "Without signals."]
"""
