"""Files of view factors for other programs: CSV, uDALES and EnergyPlus, written from the unchanged matrix.

The energy balance of uDALES reads F[i, j] as light that arrives at facet i from facet j, which equals ours by
reciprocity (`calclw` of its modEB.f90). Its sparse matrix is text. Its dense one is netCDF, float32, which Fortran
reads with the first index running fastest: in C order it is the transpose. The facets must have the order of its
.stl.

EnergyPlus reads a factor for each pair of surfaces of a zone, including 0, from the first named to the second. It
changes the factors of zones that are not closed by its own iteration.

Sources: uDALES 2, src/initfac.f90 and tools/preprocessing.m; EnergyPlus 23.2, Input Output Reference, "Group -
Advanced Surface Concepts", and GetInputViewFactorsbyName of HeatBalanceIntRadExchange.cc.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from glpath.errors import UsageError
from glpath.radiosity.memory import require_memory

Float64 = NDArray[np.float64]

#: File names of uDALES, which appends the number of the experiment to each.
_UDALES = ("vfsparse.inp", "svf.inp", "facetarea.inp", "vf.nc.inp")
#: Maximum size of a variable in netCDF version 3, in bytes.
_NETCDF_MAX = (1 << 31) - 4
#: Characters that end a field, an object or a line in an .idf.
_IDF_MARKS = ",;!\n\r"


def file_kind(path: str | Path) -> str:
    """Return the format of a file name: "npz", "csv", "idf", or a uDALES name without its number.

    Raises UsageError for other names.
    """
    name = Path(path).name.lower()
    for kind in ("npz", "csv", "idf"):
        if name.endswith(f".{kind}"):
            return kind
    for kind in _UDALES:
        if re.fullmatch(rf"{re.escape(kind)}(\.\d+)?", name):
            return kind
    raise UsageError(
        f"{path}: is no name of a file of view factors; allowed are .npz, .csv, .idf, vfsparse.inp.001, "
        "vf.nc.inp.001, svf.inp.001 and facetarea.inp.001.",
        ".npz is for scipy and keeps everything, .csv for everybody, .idf for EnergyPlus, the others for uDALES "
        "(any number).",
    )


def write_text(matrix: Any, backs: Float64, path: Path, csv: bool) -> None:
    """Write a line for each factor that is not 0, as CSV or in the format of uDALES.

    CSV has "i,j,F" counted from 0 after a header line, and at the end "i,backs,F" for rows that see backs. uDALES
    has "i j F" counted from 1, without a field for backs.
    """
    m = sparse.coo_array(matrix)
    i, j = m.coords
    with open(path, "w", encoding="utf-8") as file:
        if csv:
            file.write("i,j,F\n")
        first, separator = (0, ",") if csv else (1, " ")
        for begin in range(0, m.nnz, 1 << 16):
            part = slice(begin, begin + (1 << 16))
            rows, columns, values = (each[part].tolist() for each in (i, j, m.data))
            file.writelines(
                f"{r + first}{separator}{c + first}{separator}{v:.9g}\n"
                for r, c, v in zip(rows, columns, values, strict=True)
            )
        if csv:
            file.writelines(f"{i},backs,{backs[i]:.9g}\n" for i in np.flatnonzero(backs).tolist())


def write_column(values: Iterable[float], title: str, path: Path) -> None:
    """Write a title line and a number for each row, the format in which uDALES reads sky view factors and areas."""
    path.write_text(f"# {title}\n" + "".join(f"{value:.9g}\n" for value in values), encoding="utf-8")


def write_netcdf(matrix: Any, backs: Float64, path: Path) -> None:
    """Write the dense matrix of uDALES, and, if backs are visible, a variable "backs", which uDALES ignores.

    Raises UsageError if the matrix exceeds the limit of netCDF or the memory.
    """
    from scipy.io import netcdf_file

    n = matrix.shape[0]
    remedy = "vfsparse.inp holds the same where lvfsparse is .true. in &ENERGYBALANCE."
    if 4 * n * n > _NETCDF_MAX:
        raise UsageError(f"vf.nc.inp: {n:,} rows; netCDF has room for {int((_NETCDF_MAX / 4) ** 0.5):,}.", remedy)
    require_memory(8.0 * n * n, f"vf.nc.inp: a dense matrix of {n:,} rows", remedy)
    with netcdf_file(path, "w") as file:
        file.createDimension("rows", n)
        file.createDimension("columns", n)
        dense = file.createVariable("view factor", "f4", ("rows", "columns"))
        dense.data[:] = 0
        m = sparse.coo_array(matrix)
        dense.data[m.coords[1], m.coords[0]] = m.data
        if backs.any():
            file.createVariable("backs", "f4", ("rows",)).data[:] = backs


def check_names(names: Sequence[str], zone: str, path: Path) -> None:
    """Raise UsageError if rows cannot be surfaces of EnergyPlus, or if a zone cannot have that name."""
    if not names:
        raise UsageError(
            f"{path}: EnergyPlus knows surfaces by their names, but the rows are faces.",
            "Group them: shapes, or in Python a label for each face that is the name of its surface.",
        )
    for name in (zone, *names):
        if not name.strip() or any(mark in name for mark in _IDF_MARKS):
            raise UsageError(
                f"{path}: {name!r} cannot be a name in an .idf: it is empty or has one of , ; ! or a line break.",
                "Name it otherwise; the zone has the name of the file.",
            )
    folded = [name.strip().lower() for name in names]
    for i, name in enumerate(folded):
        if name in folded[:i]:
            other = names[folded.index(name)]
            raise UsageError(
                f"{path}: {other!r} and {names[i]!r} are one name to EnergyPlus, which knows no capitals.",
                "Name one of them otherwise.",
            )


def write_idf(matrix: Any, backs: Float64, names: Sequence[str], zone: str, path: Path) -> None:
    """Write ZoneProperty:UserViewFactors:BySurfaceName of EnergyPlus, with all N^2 factors.

    For each row that sees backs, a comment in the file gives the fraction of light that arrives there. Names must
    pass `check_names`.
    """
    dense = np.asarray(matrix.toarray()).clip(0.0, 1.0)
    last = len(names) - 1
    with open(path, "w", encoding="utf-8") as file:
        file.write(
            "! View factors by glpath, from the first surface to the second; for the model that has them.\n"
            + "".join(
                f"! Of what leaves {names[i].strip()}, {backs[i]:.4g} arrives at backs of faces.\n"
                for i in np.flatnonzero(backs).tolist()
            )
            + f"ZoneProperty:UserViewFactors:BySurfaceName,\n  {zone.strip()},\n"
        )
        for i, one in enumerate(names):
            file.writelines(
                f"  {one.strip()},{other.strip()},{value:.9g}{';' if i == j == last else ','}\n"
                for j, (other, value) in enumerate(zip(names, dense[i].tolist(), strict=True))
            )
