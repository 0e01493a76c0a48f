"""Weather files for tests: a year of a site whose days are clear and overcast in turns, written as EPW."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from glpath.sky.sun_position import sun_of_hours

#: Changes one row of the file, a list of its fields, or leaves it out (None).
Change = Callable[[int, list[str]], list[str] | None]

_HEAD = """LOCATION,{site},-,-,synthetic,000000,{latitude},{longitude},{zone},{elevation}
DESIGN CONDITIONS,0
TYPICAL/EXTREME PERIODS,0
GROUND TEMPERATURES,0
HOLIDAYS/DAYLIGHT SAVINGS,{leap},0,0,0
COMMENTS 1,made by a test
COMMENTS 2,
DATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31
"""


def write_epw(
    path: Path,
    latitude: float = 47.5,
    longitude: float = 8.5,
    zone: float = 1.0,
    *,
    year: int = 2021,
    change: Change | None = None,
    head: dict[str, object] | None = None,
) -> Path:
    """A year of weather of a site. Every third day is overcast, the others are clear.

    change : of each row, before it is written
    head   : what the head says instead of the truth: latitude, longitude, zone; leap: "Yes" or "No"
    """
    begin = np.arange(
        np.datetime64(f"{year}-01-01T00"), np.datetime64(f"{year + 1}-01-01T00"), np.timedelta64(1, "h")
    )
    altitude = sun_of_hours(begin - np.timedelta64(round(3600 * zone), "s"), latitude, longitude).altitude
    height = np.sin(np.radians(np.maximum(altitude, 0.0)))
    clear = (np.arange(len(begin)) // 24) % 3 > 0
    # Haurwitz' clear day, and a sixth of its light under clouds.
    total = np.where(height > 0, 1098 * height * np.exp(-0.057 / np.maximum(height, 1e-3)), 0.0)
    direct = np.where(clear & (height > 0.02), 0.85 * total / np.maximum(height, 0.02), 0.0)
    diffuse = np.where(clear, total - direct * height, total / 6)
    total = direct * height + diffuse
    known = {"site": "Nowhere", "latitude": latitude, "longitude": longitude, "zone": zone, "elevation": 400}
    known["leap"] = "Yes" if len(begin) > 8760 else "No"
    lines = [_HEAD.format(**known | (head or {}))]
    for row, time in enumerate(begin):
        date = time.astype(object)
        fields = [str(x) for x in (date.year, date.month, date.day, date.hour + 1, 0)]
        fields += ["?", "10.0", "8.0", "70", "96000", "0", "0", "300"]
        fields += [f"{x:.2f}" for x in (total[row], direct[row], diffuse[row])]
        fields += ["999999"] * 3 + [
            "9999",
            "0",
            "1.0",
            "5",
            "5",
            "20",
            "7777",
            "9",
            "999999999",
            "15",
            "0.1",
            "0",
            "99",
        ]
        fields += ["0.2", "0", "1"]
        kept = fields if change is None else change(row, fields)
        if kept is not None:
            lines.append(",".join(kept) + "\n")
    path.write_text("".join(lines))
    return path
