"""Write tables of the documentation that are made from code and measurements: python .ci/tables.py [--check].

The variants of shaders, options of shafts, curves of glass, CIE 171 and speeds, from `benchmarks/results`.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.benches.mitsuba_scenes import RULE, VERDICTS  # noqa: E402
from glpath.gl.variants import VALUES, VARIANTS  # noqa: E402
from glpath.radiosity.shafts.options import ShaftOptions  # noqa: E402
from glpath.scene.slab import GLAZING_IOR, Float64, inside_of, slab  # noqa: E402

_CONDITION = re.compile(r"^\s*#\s*(?:ifdef|ifndef|if|elif)\b(.*?)(?://|$)", re.MULTILINE)
_NAME = re.compile(r"^\s+([A-Za-z_]\w*)\s*$|defined\s*\(?\s*(\w+)")


def asked_for() -> dict[str, set[str]]:
    """Which shader files ask for each name."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "shaders").rglob("*.*")):
        for condition in _CONDITION.findall(path.read_text()):
            for alone, inside in _NAME.findall(condition):
                found.setdefault(alone or inside, set()).add(path.relative_to(ROOT / "shaders").as_posix())
    return found


def variants() -> str:
    """Of shaders, and the values in their text."""
    files = asked_for()
    rows = ["| variant | meaning | set by | read by |", "|---|---|---|---|"]
    for name, variant in VARIANTS.items():
        read = sorted({Path(file).parent.as_posix() for file in files.get(name, ())})
        set_by = variant.set_by if variant.set_by == "shaders" else f"`glpath.{variant.set_by}`"
        rows.append(f"| `{name}` | {variant.meaning} | {set_by} | {', '.join(read)} |")
    rows += ["", "| value | meaning |", "|---|---|"]
    rows += [f"| `{name}` | {meaning} |" for name, meaning in VALUES.items()]
    return "\n".join(rows) + "\n"


def shaft_options() -> str:
    """What each does and when it pays, from the docstring."""
    rows = ["| option | default | what it does, and when it pays |", "|---|---|---|"]
    described = re.findall(r"^(\w+) +: (.*(?:\n +.*)*)", inspect.getdoc(ShaftOptions) or "", re.MULTILINE)
    meanings = {name: " ".join(text.split()) for name, text in described}
    for each in fields(ShaftOptions):
        default = {"True": "yes", "False": "no", "None": "none"}.get(str(each.default), each.default)
        rows.append(f"| `{each.name}` | {default} | {meanings[each.name]} |")
    return "\n".join(rows) + "\n"


def glazing() -> str:
    """What window glass and glTF's thin glass let through by the angle, both 0.8 at normal incidence."""
    transmittance, inside = 0.8, inside_of(0.8, GLAZING_IOR)

    def schlick(cosine: Float64) -> Float64:
        return transmittance * (1 - (1 - cosine) ** 5)  # one face: 1 - F over 1 - F0

    u, weight = np.polynomial.legendre.leggauss(64)
    cosine = (u + 1) / 2
    rows = ["| angle to the normal | `glazing` | thin `principled` | ratio |", "|---|---|---|---|"]
    for angle in (0, 40, 60, 70, 80):
        at = np.array(np.cos(np.radians(angle)))
        rows.append(_compared(str(angle), float(slab(at, GLAZING_IOR, inside)[1]), float(schlick(at))))
    everywhere = [
        float((weight * cosine * curve).sum()) for curve in (slab(cosine, GLAZING_IOR, inside)[1], schlick(cosine))
    ]
    rows.append(_compared("from everywhere", *everywhere))
    return "\n".join(rows) + "\n"


def _compared(what: str, ours: float, other: float) -> str:
    return f"| {what} | {ours:.3f} | {other:.3f} | {other / ours:.2f} |"


RESULTS = ROOT / "benchmarks" / "results"

#: By the file in `benchmarks/results`: what was rendered.
_GATHERS = {
    "gather-box-256": "`cornell-box-36`, 256 x 256",
    "gather-room-256": "`room`, 256 x 256",
}


def result(name: str) -> dict[str, Any]:
    """The report of a bench, as `--json` has written it."""
    found: dict[str, Any] = json.loads((RESULTS / f"{name}.json").read_text())
    return found


def speed() -> str:
    """Of the README: seconds to an error, of the gather and of paths beside Mitsuba."""
    rows = ["| what | glpath | peer | glpath is faster by |", "|---|---|---|---|"]
    for engine, what in (("gather", "all bounces (gather)"), ("path", "all bounces without bias (`path`)")):
        for name, picture in _GATHERS.items():
            measured = result(name)["measured"]
            ours, theirs = measured[f"{engine}_s"], measured["mitsuba_s"]
            seconds = f"{ours:.2g} s | Mitsuba {theirs:.2g} s | {theirs / ours:.1f}"
            rows.append(f"| {what}, {picture}, relMSE 1e-3 | {seconds} |")
    return "\n".join(rows) + "\n"


def parallel_rays() -> str:
    """Of each number of triangles and points: microseconds of the processor for a point and direction."""
    head = "| triangles | points | ray, us | ray, points unsorted, us | scan, us | scan / ray | agreement |"
    rows = [head, "|---|---|---|---|---|---|---|"]
    for row in result("parallel-rays")["rows"]:
        times = " | ".join(f"{1e6 * row[name]:.2g}" for name in ("ray_s", "unsorted_s", "scan_s"))
        ratio, agreement = row["scan_s"] / row["ray_s"], 100 * row["agreement"]
        rows.append(f"| {row['triangles']:,} | {row['points']:,} | {times} | {ratio:.2g} | {agreement:.4g} % |")
    return "\n".join(rows) + "\n"


def cie171() -> str:
    """Of the page on CIE 171: by case, how far the values are off, and which do not pass."""
    rows = [
        "| case | scenes | skies | values | off by at most, % | standard error at most, % | do not pass |",
        "|---|---|---|---|---|---|---|",
    ]
    of_cases: dict[str, list[dict[str, Any]]] = {}
    for row in result("cie171")["rows"]:
        of_cases.setdefault(row["case"], []).append(row)
    for case, found in of_cases.items():
        scenes, skies = (len({row[key] for row in found} - {""}) for key in ("variant", "sky"))
        values, missed = (sum(row[key] for row in found) for key in ("values", "missed"))
        off, error = (max(row[key] for row in found) for key in ("off, %", "error, %"))
        rows.append(f"| {case} | {scenes} | {skies or ''} | {values} | {off:.2f} | {error:.2f} | {missed} |")
    return "\n".join(rows) + "\n"


#: By case, variant, point and sky: what the report prints, as other validations quote it.
_MISPRINTED = {
    ("5.9", "4 x 4 m", "A", 5): 46.74,
    ("5.9", "4 x 4 m", "G", 13): 42.07,
    ("5.11", "4 x 3 m", "A", 14): 9.65,
    ("5.11", "4 x 3 m", "G", 14): 10.48,
    ("5.13", "overhang 1 m", "F", 1): 7.64,
}


def cie171_misprints() -> str:
    """Of the page on CIE 171: printed values that are wrong, beside the exact ones."""
    found = {(row["case"], row["variant"], row["sky"]): row for row in result("cie171")["rows"]}
    rows = ["| case | point | sky | printed | exact |", "|---|---|---|---|---|"]
    for (case, variant, point, sky), printed in _MISPRINTED.items():
        row = found[case, variant, sky]
        rows.append(
            f"| {case}, {variant} | {point} | {sky} | {printed} | {row['exact'][row['names'].index(point)]:.2f} |"
        )
    return "\n".join(rows) + "\n"


def leaky_rooms() -> str:
    """Bias of the defaults in rooms that leak, before and after elements were split, in percent."""
    rows = [
        "| room | `auto` before | `auto` | which is | `gather` | lightmap | probes by `gather` | solution, mean |",
        "|---|---|---|---|---|---|---|---|",
    ]
    before, now = (
        {(row["room"], row["product"]): row for row in result(name)["rows"]}
        for name in ("leaky-rooms-before", "leaky-rooms")
    )
    for room in dict.fromkeys(room for room, product in now if product == "auto"):
        cells = [_bias(before[room, "auto"]), _bias(now[room, "auto"]), f"`{now[room, 'auto']['chosen']}`"]
        cells += [_bias(now[room, product]) for product in ("gather", "lightmap", "probes")]
        cells.append(_bias(now[room, "solution"]).split(";")[0])
        rows.append(f"| {room} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _bias(row: dict[str, Any]) -> str:
    """The mean with its standard error, and by how much the worst block is off beyond its noise."""
    return f"{100 * row['mean']:+.1f} ± {100 * row['mean_error']:.1f}; {100 * row['worst_beyond']:.1f}"


def leaky_lookups() -> str:
    """Methods of looking up the light of a solution: bias in percent, and the noise of 256 path sets."""
    rows = ["| method | room | elements | mean | worst block | noise |", "|---|---|---|---|---|---|"]
    for row in result("leaky-lookups")["rows"]:
        numbers = f"{row['elements']:,} | {100 * row['mean']:+.1f} | {100 * row['worst']:+.0f}"
        rows.append(f"| {row['product']} | {row['room']} | {numbers} | {100 * row['noise']:.1f} |")
    return "\n".join(rows) + "\n"


def mitsuba_verdicts() -> str:
    """What the verdicts on Mitsuba's files mean."""
    rows = [
        "| verdict | meaning |",
        "|---|---|",
        *(f"| {name} | {meaning} |" for name, meaning in VERDICTS.items()),
    ]
    return "\n".join(rows) + "\n"


def mitsuba_rule() -> str:
    """The rule by which glpath's claim on Mitsuba's files holds, and the result."""
    measured = result("mitsuba-scenes")["measured"]
    rows = ["| required number of files | number | holds |", "|---|---|---|"]
    for condition in RULE:
        rows.append(f"| {condition} | {measured[condition.left]:g} | {_yes_or_no(condition.holds(measured))} |")
    rows.append(f"| all of these | | {_yes_or_no(result('mitsuba-scenes')['holds'])} |")
    return "\n".join(rows) + "\n"


def _yes_or_no(holds: bool) -> str:
    return "yes" if holds else "**no**"


def mitsuba_scenes() -> str:
    """Of each repository, how many of Mitsuba's files have each verdict."""
    rows = [
        "| repository | files | load | " + " | ".join(VERDICTS) + " |",
        "|---|---|---|" + "---|" * len(VERDICTS),
    ]
    of_repositories: dict[str, list[dict[str, Any]]] = {}
    for row in result("mitsuba-scenes")["rows"]:
        of_repositories.setdefault(row["file"].partition("/")[0], []).append(row)
    everything = [row for found in of_repositories.values() for row in found]
    for name, found in {**of_repositories, "all": everything}.items():
        counts = " | ".join(str(sum(row["verdict"] == verdict for row in found)) for verdict in VERDICTS)
        rows.append(f"| {name} | {len(found)} | {sum(row['loads'] for row in found)} | {counts} |")
    return "\n".join(rows) + "\n"


def mitsuba_plugins() -> str:
    """Of each plugin, the largest differences with their noise, of decided files and of unclear ones."""
    verdicts = ("same", "differs", "unclear")
    rows = [
        f"| plugin | files | {' | '.join(verdicts)} | mean, %: same or differs | blocks, %: same or differs "
        "| mean, %: unclear | blocks, %: unclear |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    of_plugins: dict[str, list[dict[str, Any]]] = {}
    for row in result("mitsuba-scenes")["rows"]:
        for plugin in row.get("plugins", ()):
            of_plugins.setdefault(plugin, []).append(row)
    for plugin, found in sorted(of_plugins.items()):
        cells = [str(sum(row["verdict"] == verdict for row in found)) for verdict in verdicts]
        for group in (("same", "differs"), ("unclear",)):
            compared = [row for row in found if row["verdict"] in group]
            for difference, noise in (("mean_difference", "mean_noise"), ("worst_block", "noise")):
                bounds = [row[difference] + row[noise] for row in compared]
                cells.append(f"{100 * max(bounds):.1f}" if bounds else "")
        rows.append(f"| `{plugin}` | {len(found)} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def mitsuba_differences() -> str:
    """Of files that load but are not the same: the figures, and the warnings."""
    rows = [
        "| file | verdict | mean, ratio | mean, difference | worst block, difference | warnings or error |",
        "|---|---|---|---|---|---|",
    ]
    for row in result("mitsuba-scenes")["rows"]:
        if row["verdict"] in ("same", "refused"):
            continue
        figures = ["", "", ""]
        if "worst_block" in row:
            figures = [
                f"{row['mean_ratio']:.3f}",
                _beyond_noise(row["mean_difference"], row["mean_noise"]),
                _beyond_noise(row["worst_block"], row["noise"]),
            ]
        texts = [text.partition(": ")[2] or text for text in row["warnings"]] or [row.get("error", "")]
        shown = "; ".join(texts).replace("|", "\\|").replace("<", "&lt;")
        name = row["file"].partition("/")[2]
        rows.append(f"| {name} | {row['verdict']} | {' | '.join(figures)} | {shown[:300]} |")
    return "\n".join(rows) + "\n"


def _beyond_noise(difference: float, noise: float) -> str:
    """A difference with its noise in percent; only the noise if that explains the whole difference."""
    if difference < 0.0005:
        return f"within noise of {100 * noise:.1f} %"
    return f"{100 * difference:.1f} % beyond noise of {100 * noise:.1f} %"


#: By the page and the words of the marks around it.
TABLES: dict[tuple[str, str], Callable[[], str]] = {
    ("docs/explanation/developing.md", "variants"): variants,
    ("docs/explanation/shaft-culling.md", "shaft options"): shaft_options,
    ("docs/explanation/parallel-light.md", "parallel-rays"): parallel_rays,
    ("docs/explanation/gather.md", "leaky-rooms"): leaky_rooms,
    ("docs/explanation/gather.md", "leaky-lookups"): leaky_lookups,
    ("docs/explanation/cie171.md", "cie171"): cie171,
    ("docs/explanation/cie171.md", "cie171-misprints"): cie171_misprints,
    ("docs/howto/materials.md", "glazing"): glazing,
    ("docs/howto/mitsuba.md", "mitsuba-verdicts"): mitsuba_verdicts,
    ("docs/howto/mitsuba.md", "mitsuba-scenes"): mitsuba_scenes,
    ("docs/howto/mitsuba.md", "mitsuba-rule"): mitsuba_rule,
    ("docs/howto/mitsuba.md", "mitsuba-plugins"): mitsuba_plugins,
    ("docs/howto/mitsuba.md", "mitsuba-differences"): mitsuba_differences,
    ("README.md", "speed"): speed,
}


def with_table(page: str, name: str, text: str) -> str:
    """The text of a page with its table as it is now."""
    begin_mark, end_mark = f"<!-- {name}: .ci/tables.py writes this table -->\n", f"<!-- end of {name} -->\n"
    begin, end = text.index(begin_mark) + len(begin_mark), text.index(end_mark)
    return f"{text[:begin]}{TABLES[page, name]()}{text[end:]}"


def main() -> int:
    """Write them, or with --check say whether they stand there already."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    check, stale = parser.parse_args().check, False
    for page, name in TABLES:
        path = ROOT / page
        text = path.read_text()
        made = with_table(page, name, text)
        stale |= made != text
        if not check:
            path.write_text(made)
    return int(check and stale)


if __name__ == "__main__":
    sys.exit(main())
