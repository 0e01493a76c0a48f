"""`ViewFactors`: the matrix of view factors, estimates of its errors, and its files.

Sources: Vercammen & Froment 1980 and Larsen & Howell 1986 for the least squares that enforce closure.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from glpath.apps.view_factors.formats import (
    check_names,
    file_kind,
    write_column,
    write_idf,
    write_netcdf,
    write_text,
)
from glpath.apps.view_factors.heat_exchange import RadiativeExchange, exchange_of
from glpath.errors import ImageError, UsageError
from glpath.io.vtk import VtkMesh
from glpath.radiosity.memory import require_memory
from glpath.system.arguments import check_array, checked, is_numbers, short_repr
from glpath.system.files import whole_file
from glpath.system.frames import data_frame, data_set
from glpath.system.npz import open_npz
from glpath.system.vectors import LARGEST

Float64 = NDArray[np.float64]

#: Format number of the file; it changes with the layout.
FORMAT = 2
#: Deviation of row sums from 1 up to which a room counts as closed, unless a row's estimated error is larger.
_OPEN = 0.02
_ROUNDS = 20
# Maximum view factor. The estimate for a tiny face beside a large one may exceed 1.
_MAX_FACTOR = 1000.0
# Maximum rounding error of a view factor, or of a fraction of the surroundings, whose true value is 0.
_ROUNDING = 1e-6


@checked
@dataclass(frozen=True, eq=False, repr=False)
class ViewFactors:
    """View factors between N faces or groups of faces, and to their surroundings.

    matrix     : (N, N) scipy.sparse CSR array, float64: F[i, j] is the fraction of light leaving the front of i
                 that arrives at the front of j unoccluded
    areas      : (N,) float64, scene units squared; 0 for faces without an area, whose rows are zeros
    error      : (N,) float64, estimated error of each row's sum, from the standard errors of its factors, which are
                 assumed to be independent. The estimate is statistical, not a proven bound. The tests use random
                 closed rooms with slits, touching blocks, tiny faces beside large ones, and intersecting sheets.
                 There the median estimate is 5 to 9 times the true error, and one to three rows in a hundred have a
                 larger error than estimated. For an unoccluded row, the estimate is the bound of its
                 quadrature, some millionths, and the true error is 10 to 1000 times smaller. In a closed room,
                 `enclosure` is the exact error of a row
    names      : names of the groups; empty if the rows are the faces, in their order
    statistics : cost of the computation and record of enforced properties, as JSON values
    backs      : (N,) float64, fraction of each row's light that arrives at backs of faces, estimated by rays. It is
                 neither in the matrix nor in `sky`, and is 0 for a model without faults. None is replaced by zeros
    backs_error : (N,) float64, cautious error estimate of `backs`; 0 if no back was hit
    centroids, normals : (N, 3) float64, centroid of each row's faces, and unit normal on their front side. NaN if
                 undefined, for example the normal of a closed group, or if an older version wrote the file

    Raises UsageError for arrays of other shapes, and for values out of range.

    >>> import glpath
    >>> cube = [[0,0,0],[1,0,0],[0,1,0],[1,1,0],[0,0,1],[1,0,1],[0,1,1],[1,1,1]]
    >>> walls = [[0,1,3,2],[4,6,7,5],[0,4,5,1],[2,3,7,6],[0,2,6,4],[1,5,7,3]]
    >>> round(float(glpath.view_factors((cube, walls)).matrix[0, 1]), 5)  # floor to ceiling
    0.19982
    """

    matrix: Any
    areas: Float64
    error: Float64
    names: tuple[str, ...] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)
    backs: Float64 = None  # type: ignore[assignment]
    backs_error: Float64 = None  # type: ignore[assignment]
    centroids: Float64 = None  # type: ignore[assignment]
    normals: Float64 = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        areas = check_array("areas", self.areas, (None,), (0.0, LARGEST**2))
        found: dict[str, Any] = {"areas": areas, "matrix": _checked_matrix(self.matrix, len(areas))}
        for name in ("error", "backs", "backs_error"):
            values = getattr(self, name)
            if values is None and name != "error":
                values = np.zeros(len(areas))
            found[name] = check_array(name, values, (len(areas),), (-_ROUNDING, LARGEST))
        for name in ("centroids", "normals"):
            values = getattr(self, name)
            if values is None:
                values = np.full((len(areas), 3), np.nan)
            found[name] = check_array(name, values, (len(areas), 3), (-LARGEST, LARGEST), may_lack=True)
        names = self.names
        if not isinstance(names, tuple | list) or not all(isinstance(name, str) for name in names):
            raise UsageError(f"names: {short_repr(names)} where a tuple of texts is needed")
        if len(names) not in (0, len(areas)):
            raise UsageError(
                f"names: {len(names):,} where one for each of {len(areas):,} rows is needed, or none",
                "Name each row once.",
            )
        if not isinstance(self.statistics, Mapping):
            raise UsageError(f"statistics: {short_repr(self.statistics)} where a dictionary is needed")
        for name, values in {**found, "names": tuple(names)}.items():
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.areas)

    @cached_property
    def row_sums(self) -> Float64:
        """Fraction (N,) of each row's light that arrives at the fronts of all faces."""
        return np.asarray(self.matrix.sum(axis=1), np.float64).ravel()

    @property
    def sky(self) -> Float64:
        """Fraction (N,) of each row's light that reaches sky or surroundings: 1 minus the row's sum and `backs`."""
        return np.asarray(self.enclosure - self.backs)

    @property
    def enclosure(self) -> Float64:
        """Difference (N,) between 1 and each row's sum; it equals `sky` plus `backs`. 0 for faces without an area.

        In a closed room, this difference is the error of the row.
        """
        return np.asarray(np.where(self.areas > 0, 1 - self.row_sums, 0.0))

    @property
    def closure_error(self) -> float:
        """Largest deviation of a row's sum from 1; for an open scene, its largest opening."""
        return float(np.abs(self.enclosure).max(initial=0.0))

    @property
    def reciprocity_error(self) -> float:
        """Maximum over rows i of the sum over j of |F_ij - F_ji A_j / A_i|.

        For a computed matrix it is only rounding, because each pair is computed once.
        """
        exchange = sparse.diags_array(self.areas) @ self.matrix
        off = np.asarray(abs(exchange - exchange.T).sum(axis=1)).ravel()
        return float((off / self._divisors).max(initial=0.0))

    @property
    def _divisors(self) -> Float64:
        """Areas (N,) as divisors: 1 instead of 0 for faces without an area, whose rows are zeros."""
        return np.where(self.areas > 0, self.areas, 1.0)

    def enforced(self, *, reciprocity: bool = True, closure: bool = False) -> ViewFactors:
        """Return corrected factors with A_i F_ij = A_j F_ji (reciprocity), and with row sums of 1 (closure).

        The requested properties then hold except for rounding. Closure uses least squares: of all symmetric
        exchange areas A_i F_ij with these sums, it finds those with the smallest sum of squared relative changes.
        None becomes negative. Closure distributes the errors without knowing their origin, so computing the factors
        with a smaller `error` is better. `statistics` reports both deviations before and after.

        Raises UsageError if a row deviates from 1 by more than its error, because closure is only for closed rooms.
        """
        before = {"reciprocity": self.reciprocity_error, "closure": self.closure_error}
        exchange = sparse.diags_array(self.areas) @ self.matrix
        if reciprocity or closure:
            exchange = 0.5 * (exchange + exchange.T)
        if closure:
            self.check_closed("closure")
            exchange = _closed(sparse.csr_array(exchange), self.areas)
        matrix = sparse.csr_array(sparse.diags_array(1 / self._divisors) @ exchange)
        words = [word for word, wanted in (("reciprocity", reciprocity), ("closure", closure)) if wanted]
        done = replace(self, matrix=matrix)
        after = {"reciprocity": done.reciprocity_error, "closure": done.closure_error}
        record = {"enforced": words, "before": before, "after": after}
        return replace(done, statistics={**self.statistics, **record})

    def exchange(
        self, emissivity: ArrayLike, temperature: ArrayLike, surroundings: float | None = None
    ) -> RadiativeExchange:
        """Solve the radiative exchange between grey, diffuse faces: net fluxes, radiosities and Gebhart's factors.

        Parameters
        ----------
        emissivity   : (N,) or a scalar, 0 to 1, for the wavelengths that the faces emit
        temperature  : (N,) or a scalar, K; NaN for a face without a net flux, such as an insulated wall
        surroundings : temperature in K of everything outside the faces; None for a closed room. The rows of a
                       closed room should add up to 1 exactly, so call `enforced(closure=True)` first

        Raises UsageError for values out of range, and if the rows are not closed but `surroundings` is None.

        Example: two wide plates of emissivities 0.8 and 0.5, at 400 K and 300 K

        >>> import numpy as np
        >>> from scipy import sparse
        >>> plates = ViewFactors(sparse.csr_array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2), np.zeros(2))
        >>> plates.exchange([0.8, 0.5], [400.0, 300.0]).net_flux.round(1).tolist()
        [441.0, -441.0]
        """
        return exchange_of(self, emissivity, temperature, surroundings)

    def to_pandas(self, what: Literal["rows", "factors"] = "rows") -> Any:
        """Return a `pandas.DataFrame` with a row for each face, or for each factor that is not 0.

        what : "rows", with the columns area, row_sum, sky, backs, error, centroid and normal; or "factors", with
               the columns from, to and factor. Rows are named if they have names, and numbered otherwise

        Raises GlpathError if pandas is missing, UsageError for another value of `what`.
        """
        labels = list(self.names) or None
        if what == "rows":
            columns = {
                "area": self.areas, "row_sum": self.row_sums, "sky": self.sky, "backs": self.backs,
                "error": self.error,
            }  # fmt: skip
            for name, vectors in (("centroid", self.centroids), ("normal", self.normals)):
                columns |= {f"{name}_{axis}": part for axis, part in zip("xyz", vectors.T, strict=True)}
            return data_frame(columns, "face", labels, self.statistics)
        if what != "factors":
            raise UsageError(f"to_pandas: what is {short_repr(what)}; allowed are rows and factors.")
        m = sparse.coo_array(self.matrix)
        i, j = (np.asarray(self.names)[each] if self.names else each for each in m.coords)
        return data_frame({"from": i, "to": j, "factor": m.data}, "pair", None, self.statistics)

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` with the dense matrix `factor` (from, to), and values of each face.

        The values are area, sky, backs and error. Raises GlpathError if xarray is missing, UsageError if the matrix
        does not fit into memory.
        """
        n = len(self)
        require_memory(8.0 * n * n, f"to_xarray: a dense matrix of {n:,} rows", 'to_pandas("factors") is sparse.')
        labels = list(self.names) or np.arange(n)
        variables: dict[str, Any] = {"factor": (("from", "to"), self.matrix.toarray())}
        rows = {"area": self.areas, "sky": self.sky, "backs": self.backs, "error": self.error}
        variables |= {name: (("from",), values) for name, values in rows.items()}
        return data_set(variables, {"from": labels, "to": labels}, self.statistics)

    def to_vtk(
        self,
        faces: Any,
        *,
        groups: str | ArrayLike = "faces",
        flip: bool = False,
        values: Mapping[str, ArrayLike] | None = None,
    ) -> VtkMesh:
        """Return the faces with their values, for ParaView and PyVista: `.save("room.vtp")`, `.to_pyvista()`.

        faces, groups, flip : arguments that were given to `view_factors`
        values              : further values by name, (N,) or (N, k), for example `exchange(...).net_flux`, or
                              `matrix[[i]].toarray()[0]` for the factors of i

        Raises UsageError if these faces have another number of rows.
        """
        from glpath.apps.view_factors.faces import faces_of

        given = faces_of(faces, groups, flip)
        if given.row_count != len(self):
            raise UsageError(
                f"to_vtk: these faces make {given.row_count:,} rows, but the matrix has {len(self):,}.",
                "Give the faces and groups that it was computed of.",
            )
        data = {
            "area": self.areas, "row_sum": self.row_sums, "sky": self.sky, "backs": self.backs, "error": self.error,
        }  # fmt: skip
        for name, each in (values or {}).items():
            if not is_numbers(each):
                raise UsageError(f"to_vtk: {name} is {short_repr(each)} where an array of real numbers is needed.")
            data[name] = np.asarray(each)
        for name, each in data.items():
            if np.ndim(each) < 1 or len(each) != len(self):
                raise UsageError(f"to_vtk: {name} of shape {np.shape(each)}, but there are {len(self):,} rows.")
        on_faces = {"row": given.rows, **{name: each[given.rows] for name, each in data.items()}}
        return VtkMesh(given.vertices, given.outlines, on_faces)

    def check_closed(self, what: str) -> None:
        """Raise UsageError if a row's sum differs from 1 by more than `_OPEN` and by more than the row's error.

        Faces without an area do not count.

        what : name of the operation that needs a closed room, for the message
        """
        allowed = np.maximum(_OPEN, self.error)
        if (far := np.flatnonzero(np.abs(self.enclosure) > allowed)).size:
            i = int(far[np.argmax(np.abs(self.enclosure[far]))])
            name = f" ({self.names[i]})" if self.names else ""
            raise UsageError(
                f"{what}: row {i}{name} adds up to {self.row_sums[i]:.4g}, and {len(far):,} of {len(self):,} rows "
                "are farther from 1 than errors are: this is not a closed room, or some fronts face outward.",
                "Without closure, what is missing goes to the `sky` and `backs`. Or turn the faces (flip).",
            )

    def save(self, path: str | Path) -> None:
        """Write the view factors to a file, whose name selects the format; an error leaves no partial file.

        Raises ImageError if writing fails. Raises UsageError for another name, or if the format cannot hold the
        matrix.
        If backs are visible, files with factors also contain `backs`, because the missing part of a row would
        otherwise count as sky.

        .npz : file for `scipy.sparse.load_npz`, with areas, error, backs, names and statistics; see `load`
        .csv : header line, then a line "i,j,F" for each factor that is not 0, counted from 0; then a line
               "i,backs,share" for each row that sees backs
        .idf : ZoneProperty:UserViewFactors:BySurfaceName of EnergyPlus for a closed zone with all N^2 factors, and
               backs as comments. The zone has the name of the file without .idf, its surfaces have the names of the
               groups
        vfsparse.inp.001  : sparse matrix for uDALES: "i j F" for each factor, counted from 1; set `nnz` of its
                            ENERGYBALANCE to matrix.nnz. It has no field for backs
        vf.nc.inp.001     : dense matrix for uDALES without `lvfsparse`, netCDF of float32; backs in a variable
        svf.inp.001       : sky view factors for uDALES, `sky`, a line for each row
        facetarea.inp.001 : areas of facets for uDALES
        """
        target = Path(path)
        kind = file_kind(target)
        if kind == "idf":
            check_names(self.names, target.stem, target)
            self.check_closed("EnergyPlus")
        with whole_file(target) as temporary:
            if kind == "npz":
                self._save_npz(temporary)
            elif kind == "idf":
                write_idf(self.matrix, self.backs, self.names, target.stem, temporary)
            elif kind == "vf.nc.inp":
                write_netcdf(self.matrix, self.backs, temporary)
            elif kind == "svf.inp":
                write_column(self.sky.clip(min=0.0).tolist(), "sky view factors", temporary)
            elif kind == "facetarea.inp":
                write_column(self.areas.tolist(), "area of facets", temporary)
            else:
                write_text(self.matrix, self.backs, temporary, kind == "csv")

    def _save_npz(self, path: Path) -> None:
        m = sparse.csr_array(self.matrix)
        with open(path, "wb") as file:
            np.savez_compressed(
                file,
                format=np.array(b"csr"), shape=np.array(m.shape), data=m.data, indices=m.indices, indptr=m.indptr,
                _is_array=np.array(True), areas=self.areas, error=self.error, names=np.array(self.names, np.str_),
                statistics=np.array(json.dumps(dict(self.statistics))), glpath_view_factors=np.array(FORMAT),
                backs=self.backs, backs_error=self.backs_error, centroids=self.centroids, normals=self.normals,
            )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> ViewFactors:
        """Read an .npz file that `save` wrote. Raises ImageError for any other file."""
        with open_npz(path, "view factors", "Files of `glpath viewfactors` with .npz are.") as arrays:
            if int(arrays.read("glpath_view_factors", "iu", ())) != FORMAT:
                raise ImageError(f"{path}: is of another version of glpath.", "Compute the view factors again.")
            n = int(arrays.read("shape", "iu", (2,))[0])
            data, indices = arrays.read("data", "f", (None,)), arrays.read("indices", "iu", (None,))
            if data.dtype != np.float64 or indices.dtype not in (np.int32, np.int64) or len(data) != len(indices):
                raise ValueError("`data` and `indices` are not those of a matrix of float64")
            parts = data, indices, arrays.read("indptr", "iu", (n + 1,))
            matrix = sparse.csr_array(parts, shape=(n, n))
            matrix.check_format()
            areas, error = arrays.read("areas", "f", (n,)), arrays.read("error", "f", (n,))
            backs, backs_error = arrays.read("backs", "f", (n,)), arrays.read("backs_error", "f", (n,))
            if not (all(np.isfinite(part).all() for part in (data, areas, backs)) and (areas >= 0).all()):
                raise ValueError("it holds values that are not finite")
            names = tuple(map(str, arrays.read("names", "U", (None,)).tolist()))
            statistics = arrays.read_object("statistics")
            known = {name: arrays.read(name, "f", (n, 3)) for name in ("centroids", "normals") if name in arrays}
            return cls(matrix, areas, error, names, statistics, backs, backs_error, **known)

    def __repr__(self) -> str:
        what = "groups" if self.names else "faces"
        if not len(self):
            return f"<ViewFactors of no {what}>"
        return (
            f"<ViewFactors of {len(self):,} {what}: {self.matrix.nnz:,} factors, rows to {self.error.max():.1g}, "
            f"sky {self.sky.min():.3g} to {self.sky.max():.3g}"
            + (f", backs up to {self.backs.max():.3g}>" if self.backs.any() else ">")
        )


def _checked_matrix(matrix: Any, count: int) -> Any:
    """Return a matrix of view factors in CSR form.

    Raises UsageError for another shape and for factors out of range.
    """
    if not sparse.issparse(matrix):
        raise UsageError(
            f"matrix: {short_repr(matrix)} where a sparse matrix of scipy is needed",
            "scipy.sparse.csr_array(matrix) makes one.",
        )
    if matrix.shape != (count, count):
        raise UsageError(
            f"matrix: of shape {matrix.shape} where ({count}, {count}) is needed",
            "areas has one number for each row.",
        )
    if matrix.dtype.kind not in "fiu":
        raise UsageError(f"matrix: of type {matrix.dtype} where real numbers are needed")
    result = sparse.csr_array(matrix, dtype=np.float64)
    wrong = ~((result.data >= -_ROUNDING) & (result.data <= _MAX_FACTOR))
    if wrong.any():
        at = int(np.argmax(wrong))
        row = int(np.searchsorted(result.indptr, at, side="right")) - 1
        raise UsageError(
            f"matrix[{row}, {result.indices[at]}]: {result.data[at]:g} where view factors from 0 to "
            f"{_MAX_FACTOR:g} are allowed",
            "A factor is a fraction of the light that leaves a face.",
        )
    return result


def _closed(exchange: Any, areas: Float64) -> Any:
    """Return symmetric exchange areas with row sums equal to the areas, by least changes of `exchange` (N, N)."""
    for _ in range(_ROUNDS):
        missing = areas - np.asarray(exchange.sum(axis=1)).ravel()
        if np.abs(missing / np.where(areas > 0, areas, 1.0)).max(initial=0.0) < 1e-13:
            break
        # Least squares with Lagrange multipliers l_i: exchange area G_ij changes by d_ij = G_ij^2 (l_i + l_j). Each
        # row of d adds up to the amount by which the row of G is too small.
        weights = sparse.csr_array(exchange.multiply(exchange))
        sums = np.asarray(weights.sum(axis=1)).ravel()
        empty = sums <= 0
        diagonal = np.where(empty, 1.0, sums)

        def times(x: Float64, weights: Any = weights, diagonal: Float64 = diagonal) -> Float64:
            return np.asarray(diagonal * x + weights @ x)

        # Scale the system to a diagonal of ones. It is singular, but consistent, if light passes only between two
        # sets of faces, such as two plates.
        root = np.sqrt(diagonal)
        n = len(areas)
        scaled = LinearOperator((n, n), lambda y, times=times, root=root: times(y / root) / root, dtype=np.float64)
        y, _ = cg(scaled, missing / root, rtol=1e-13, maxiter=2000)
        multipliers = y / root
        rows = np.repeat(np.arange(n), np.diff(exchange.indptr))
        change = 1 + exchange.data * (multipliers[rows] + multipliers[exchange.indices])
        exchange = sparse.csr_array(
            (exchange.data * np.maximum(change, 0.0), exchange.indices, exchange.indptr), shape=exchange.shape
        )
    return exchange
