"""Precise orbits made of broadcast ones (IS-GPS-200, table 20-IV), as SP3; calibrations of antennas that are known."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

GPS_START = datetime(1980, 1, 6)
MU, EARTH_RATE = 3.986005e14, 7.2921151467e-5


def broadcast(text: str) -> dict[int, list[np.ndarray]]:
    """Return the orbits of a RINEX 2 navigation file by satellite: clock (4) with its time, then 28 numbers."""
    body = text.partition("END OF HEADER")[2].splitlines()[1:]
    found: dict[int, list[np.ndarray]] = {}
    for at in range(0, len(body) - 7, 8):
        first = body[at]
        words = [int(first[3 * n + 2 : 3 * n + 5]) for n in range(5)]
        time = (datetime(2000 + words[0], *words[1:]) - GPS_START).total_seconds() + float(first[17:22])
        numbers = [first[22:41], first[41:60], first[60:79]]
        for line in body[at + 1 : at + 8]:
            numbers += [line[3:22], line[22:41], line[41:60], line[60:79]]
        values = [float(word.replace("D", "E")) if word.strip() else 0.0 for word in numbers]
        found.setdefault(int(first[:2]), []).append(np.array([time, *values]))
    return found


def place_and_clock(orbit: np.ndarray, time: float) -> tuple[np.ndarray, float]:
    """Return where a satellite is, geocentric, m, and its clock without relativity, s."""
    clock_time, a0, a1, a2 = orbit[:4]
    _, crs, dn, m0, cuc, e, cus, root_a, toe, cic, omega0, cis, i0, crc, omega, rate, idot = orbit[4:21]
    week = orbit[22]
    t = time - (week * 604_800.0 + toe)
    mean = m0 + (np.sqrt(MU) / root_a**3 + dn) * t
    anomaly = mean
    for _ in range(20):
        anomaly = mean + e * np.sin(anomaly)
    true = np.arctan2(np.sqrt(1.0 - e * e) * np.sin(anomaly), np.cos(anomaly) - e)
    phi = true + omega
    two = np.array([np.sin(2.0 * phi), np.cos(2.0 * phi)])
    u = phi + two @ [cus, cuc]
    r = root_a**2 * (1.0 - e * np.cos(anomaly)) + two @ [crs, crc]
    i = i0 + two @ [cis, cic] + idot * t
    node = omega0 + (rate - EARTH_RATE) * t - EARTH_RATE * toe
    x, y = r * np.cos(u), r * np.sin(u)
    place = np.array([
        x * np.cos(node) - y * np.cos(i) * np.sin(node), x * np.sin(node) + y * np.cos(i) * np.cos(node), y * np.sin(i)
    ])  # fmt: skip
    dt = time - clock_time
    return place, a0 + a1 * dt + a2 * dt * dt


def _orbits(text: str, begin: float, end: float) -> dict[int, np.ndarray]:
    """Return one broadcast orbit of each satellite, so that there is no step."""
    middle = (begin + end) / 2.0
    return {number: min(rows, key=lambda row: abs(row[0] - middle)) for number, rows in broadcast(text).items()}


def clocks(text: str, begin: float, end: float, step: float = 30.0, wrong: float = 0.0) -> str:
    """Return clocks as RINEX clock 3.00; those of even and odd satellites wrong by seconds of opposite sign."""
    lines = [f"{'     3.00           C':<60}RINEX VERSION / TYPE", f"{'':60}END OF HEADER"]
    orbits = sorted(_orbits(text, begin, end).items())
    for time in np.arange(begin, end + 1.0, step):
        when = GPS_START + timedelta(seconds=time)
        for number, orbit in orbits:
            clock = place_and_clock(orbit, time)[1] + wrong * (-1) ** number
            lines.append(f"AS G{number:02d}  {when:%Y %m %d %H %M} {when.second:9.6f}  1   {clock:19.12E}")
    return "\n".join([*lines, ""])


def sp3(text: str, begin: float, end: float, step: float = 300.0, *, has_clocks: bool = True) -> str:
    """Return orbits and clocks as SP3-c."""
    orbits = _orbits(text, begin, end)
    numbers = sorted(orbits)
    times = np.arange(begin, end + 1.0, step)
    week, seconds = divmod(begin, 604_800.0)
    names = [f"G{number:02d}" for number in numbers] + ["  0"] * (85 - len(numbers))
    lines = [f"#cP{_date(begin)} {len(times):7d} ORBIT IGb00 FIT TEST",
             f"## {week:4.0f} {seconds:15.8f} {step:14.8f} {51544:5d} 0.0000000000000"]  # fmt: skip
    lines += [
        f"+   {len(numbers) if not row else '':>2}   {''.join(names[17 * row : 17 * row + 17])}" for row in range(5)
    ]
    lines += [f"++       {'  0' * 17}"] * 5
    lines += ["%c G  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc"] * 2
    lines += ["%f  1.2500000  1.025000000  0.00000000000  0.000000000000000"] * 2
    lines += ["%i    0    0    0    0      0      0      0      0         0"] * 2 + ["/* made of broadcast orbits"] * 4
    for time in times:
        lines.append(f"*  {_date(time)}")
        for number in numbers:
            place, clock = place_and_clock(orbits[number], time)
            x, y, z = place / 1000.0
            known = clock * 1e6 if has_clocks else 999_999.999999
            lines.append(f"PG{number:02d}{x:14.6f}{y:14.6f}{z:14.6f}{known:14.6f}")
    return "\n".join([*lines, "EOF", ""])


def _date(time: float) -> str:
    when = GPS_START + timedelta(seconds=time)
    return f"{when.year:4d} {when.month:2d} {when.day:2d} {when.hour:2d} {when.minute:2d} {when.second:11.8f}"


def antex(offsets: dict[str, tuple[float, float, float]]) -> str:
    """Return calibrations: of each type of antenna the phase centre north, east, up of its reference point, m."""

    def line(text: str, label: str) -> str:
        return f"{text:<60}{label}\n"

    found = (
        line("     1.4            M", "ANTEX VERSION / SYST")
        + line("A", "PCV TYPE / REFANT")
        + line("", "END OF HEADER")
    )
    for name, (north, east, up) in offsets.items():
        found += line("", "START OF ANTENNA") + line(f"{name:<20}", "TYPE / SERIAL NO") + line("     0.0", "DAZI")
        found += line("     0.0  90.0   5.0", "ZEN1 / ZEN2 / DZEN") + line("     2", "# OF FREQUENCIES")
        for frequency in ("G01", "G02"):
            values = "".join(f"{1000.0 * value:10.2f}" for value in (north, east, up))
            found += line(f"   {frequency}", "START OF FREQUENCY") + line(values, "NORTH / EAST / UP")
            found += "   NOAZI" + "    0.00" * 19 + "\n" + line(f"   {frequency}", "END OF FREQUENCY")
        found += line("", "END OF ANTENNA")
    return found
