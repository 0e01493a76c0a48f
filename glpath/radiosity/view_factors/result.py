"""`ViewFactors`: the matrix, what is known of its errors, and its files.

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

from glpath.errors import ImageError, UsageError
from glpath.io.vtk import VtkMesh
from glpath.radiosity.memory import require_memory
from glpath.radiosity.view_factors.formats import (
    check_names,
    file_kind,
    write_column,
    write_idf,
    write_netcdf,
    write_text,
)
from glpath.radiosity.view_factors.heat_exchange import RadiativeExchange, exchange_of
from glpath.system.files import whole_file
from glpath.system.frames import data_frame, data_set
from glpath.system.npz import open_npz

Float64 = NDArray[np.float64]

#: Format of the file: another number is another layout.
FORMAT = 2
#: Allowed error of the row sums of a closed room, before it is enforced.
_OPEN = 0.02
_ROUNDS = 20


@dataclass(frozen=True, eq=False, repr=False)
class ViewFactors:
    """View factors between N faces or groups of faces, and to what is around them.

    matrix     : (N, N) scipy.sparse CSR array, float64: F[i, j] is the share of what leaves the front of i that
                 arrives at the front of j unoccluded
    areas      : (N,) float64, scene units squared; 0 of faces without, whose rows are zeros
    error      : (N,) float64, an estimate of the error of each row's sum, from the standard errors of its factors,
                 as if independent. It is statistical, no proven bound: in the tests' random closed rooms (slits,
                 blocks that touch, tiny faces beside large ones, sheets that cut each other) it is 5 to 9 times the
                 true error in the median, and one to three rows in a hundred are further off. A row that nothing
                 stands before has a bound of its quadrature, some millionths, and is 10 to 1000 times nearer.
                 In a closed room `enclosure` is a row's error, without an
                 estimate
    names      : of the groups; empty where the rows are the faces, in their order
    statistics : what it took, and what was enforced, as JSON has values
    backs      : (N,) float64, the share that arrives at backs of faces, by rays: neither in the matrix nor sky. Of
                 a model without faults it is 0. None for zeros
    backs_error : (N,) float64, of `backs`, cautiously; 0 where none was hit
    centroids, normals : (N, 3) float64, of each row's faces, unit normals out of the front; NaN where there is
                 none, as of a closed group, or where the file is of an older version

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
        for name in ("backs", "backs_error"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(len(self.areas)))
        for name in ("centroids", "normals"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full((len(self.areas), 3), np.nan))

    def __len__(self) -> int:
        return len(self.areas)

    @cached_property
    def row_sums(self) -> Float64:
        """(N,): the share that arrives at any face."""
        return np.asarray(self.matrix.sum(axis=1), np.float64).ravel()

    @property
    def sky(self) -> Float64:
        """(N,): what passes all faces, to the sky or surroundings: 1 less the row's sum and `backs`."""
        return np.asarray(self.enclosure - self.backs)

    @property
    def enclosure(self) -> Float64:
        """(N,): what a row lacks of 1, `sky` and `backs`; 0 but for errors in a room, and of faces without area."""
        return np.asarray(np.where(self.areas > 0, 1 - self.row_sums, 0.0))

    @property
    def closure_error(self) -> float:
        """The farthest that a row's sum is from 1. Of an open scene, how open it is."""
        return float(np.abs(self.enclosure).max(initial=0.0))

    @property
    def reciprocity_error(self) -> float:
        """The largest of sum_j |F_ij - F_ji A_j / A_i| over the rows: rounding, as pairs are computed once."""
        exchange = sparse.diags_array(self.areas) @ self.matrix
        off = np.asarray(abs(exchange - exchange.T).sum(axis=1)).ravel()
        return float((off / self._divisors).max(initial=0.0))

    @property
    def _divisors(self) -> Float64:
        """The areas, and 1 for faces without, whose rows are zeros."""
        return np.where(self.areas > 0, self.areas, 1.0)

    def enforced(self, *, reciprocity: bool = True, closure: bool = False) -> ViewFactors:
        """With A_i F_ij = A_j F_ji, and with rows that add up to 1, exactly but for rounding.

        Closure is by least squares: of all symmetric exchange areas with these sums, those with the smallest sum of
        squared relative changes; none becomes negative. It spreads the errors, and cannot know where they were: a
        smaller `error` is better. Both are reported in `statistics`, before and after.

        Raises UsageError where a row is farther from 1 than errors are: closure is for rooms that are closed.
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
        """What grey, diffuse faces exchange by radiation: net fluxes, radiosities and Gebhart's factors.

        Parameters
        ----------
        emissivity   : (N,) or one, 0 to 1, for the wavelengths that the faces send
        temperature  : (N,) or one, K; NaN for a face that no net flux leaves, such as an insulated wall
        surroundings : K of all that faces see beside each other; None for a closed room, whose rows should add up
                       to 1 exactly: `enforced(closure=True)` first

        Raises UsageError for what is out of range, and without `surroundings` where the rows are not closed.

        Example: two wide plates of emissivities 0.8 and 0.5, at 400 K and 300 K

        >>> import numpy as np
        >>> from scipy import sparse
        >>> plates = ViewFactors(sparse.csr_array([[0.0, 1.0], [1.0, 0.0]]), np.ones(2), np.zeros(2))
        >>> plates.exchange([0.8, 0.5], [400.0, 300.0]).net_flux.round(1).tolist()
        [441.0, -441.0]
        """
        return exchange_of(self, emissivity, temperature, surroundings)

    def to_pandas(self, what: Literal["rows", "factors"] = "rows") -> Any:
        """A `pandas.DataFrame`: a row for each face, or one for each factor that is not 0.

        what : "rows": area, row_sum, sky, backs, error, centroid and normal; "factors": from, to, factor, by names
               where there are some

        Raises GlpathError where pandas is missing, UsageError for another word.
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
            raise UsageError(f"to_pandas: what is {what!r}; allowed are rows and factors.")
        m = sparse.coo_array(self.matrix)
        i, j = (np.asarray(self.names)[each] if self.names else each for each in m.coords)
        return data_frame({"from": i, "to": j, "factor": m.data}, "pair", None, self.statistics)

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with the dense matrix `factor` (from, to), and the areas and shares of each face.

        Raises GlpathError where xarray is missing, UsageError where the matrix does not fit into memory.
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
        """The faces with what is known of them, for ParaView and PyVista: `.save("room.vtp")`, `.to_pyvista()`.

        faces, groups, flip : as they were given to `view_factors`
        values              : more by name, one or a row of some for each of the N rows: `exchange(...).net_flux`,
                              or `matrix[[i]].toarray()[0]`, what i sees

        Raises UsageError where these faces have another number of rows.
        """
        from glpath.radiosity.view_factors.faces import faces_of

        given = faces_of(faces, groups, flip)
        if given.row_count != len(self):
            raise UsageError(
                f"to_vtk: these faces make {given.row_count:,} rows, but the matrix has {len(self):,}.",
                "Give the faces and groups that it was computed of.",
            )
        data = {
            "area": self.areas, "row_sum": self.row_sums, "sky": self.sky, "backs": self.backs, "error": self.error,
        }  # fmt: skip
        data |= {name: np.asarray(each) for name, each in (values or {}).items()}
        for name, each in data.items():
            if np.ndim(each) < 1 or len(each) != len(self):
                raise UsageError(f"to_vtk: {name} of shape {np.shape(each)}, but there are {len(self):,} rows.")
        on_faces = {"row": given.rows, **{name: each[given.rows] for name, each in data.items()}}
        return VtkMesh(given.vertices, given.outlines, on_faces)

    def check_closed(self, what: str) -> None:
        """Raise UsageError where a row is farther from 1 than errors are; faces without an area do not count."""
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
        """Write a file, whole or not at all. Raises ImageError where that fails, UsageError for another name, and
        for what the program that reads it cannot hold.

        Only where backs are seen, files that hold factors have their shares, too, as what a row lacks of 1 would
        count as sky.

        .npz : what `scipy.sparse.load_npz` reads, with areas, error, backs, names and statistics; see `load`
        .csv : a line "i,j,F" for each factor that is not 0, counted from 0, behind a line of names; then a line
               "i,backs,share" for each row that sees any
        .idf : EnergyPlus's ZoneProperty:UserViewFactors:BySurfaceName, for a closed zone that is called as the file
               is (without .idf), whose surfaces are called as the groups are; all N^2 factors, and backs as remarks
        vfsparse.inp.001  : what uDALES reads: "i j F" for each factor, counted from 1; `nnz` of its ENERGYBALANCE
                            is their number, matrix.nnz. It has no field for backs
        vf.nc.inp.001     : the same in full, netCDF of float32, for uDALES without `lvfsparse`; backs in a variable
        svf.inp.001       : its sky view factors, `sky`, a line for each row
        facetarea.inp.001 : its areas of facets
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
        """Read an .npz of `save`. Raises ImageError for anything else."""
        with open_npz(path, "view factors", "Files of `glpath viewfactors` with .npz are.") as arrays:
            if int(arrays.read("glpath_view_factors", "iu", ())) != FORMAT:
                raise ImageError(f"{path}: is of another version of glpath.", "Compute the view factors again.")
            n = int(arrays.read("shape", "iu", (2,))[0])
            data = arrays.read("data", "f", (None,))
            parts = data, arrays.read("indices", "iu", (len(data),)), arrays.read("indptr", "iu", (n + 1,))
            matrix = sparse.csr_array(parts, shape=(n, n))
            matrix.check_format()
            areas, error = arrays.read("areas", "f", (n,)), arrays.read("error", "f", (n,))
            backs, backs_error = arrays.read("backs", "f", (n,)), arrays.read("backs_error", "f", (n,))
            if not (all(np.isfinite(part).all() for part in (data, areas, backs)) and (areas >= 0).all()):
                raise ValueError("it holds values that are not finite")
            names = tuple(map(str, arrays.read("names", "U", (None,)).tolist()))
            statistics = json.loads(str(arrays.read("statistics", "U", ())))
            known = {name: arrays.read(name, "f", (n, 3)) for name in ("centroids", "normals") if name in arrays}
            return cls(matrix, areas, error, names, statistics, backs, backs_error, **known)

    def __repr__(self) -> str:
        what = "groups" if self.names else "faces"
        return (
            f"<ViewFactors of {len(self):,} {what}: {self.matrix.nnz:,} factors, rows to {self.error.max():.1g}, "
            f"sky {self.sky.min():.3g} to {self.sky.max():.3g}"
            + (f", backs up to {self.backs.max():.3g}>" if self.backs.any() else ">")
        )


def _closed(exchange: Any, areas: Float64) -> Any:
    """Symmetric exchange areas whose rows add up to the areas."""
    for _ in range(_ROUNDS):
        missing = areas - np.asarray(exchange.sum(axis=1)).ravel()
        if np.abs(missing / np.where(areas > 0, areas, 1.0)).max(initial=0.0) < 1e-13:
            break
        # Least squares, with Lagrange's multipliers: d_ij = G_ij^2 (l_i + l_j), and their sums are what is missing.
        weights = sparse.csr_array(exchange.multiply(exchange))
        sums = np.asarray(weights.sum(axis=1)).ravel()
        empty = sums <= 0
        diagonal = np.where(empty, 1.0, sums)

        def times(x: Float64, weights: Any = weights, diagonal: Float64 = diagonal) -> Float64:
            return np.asarray(diagonal * x + weights @ x)

        # Scaled to a diagonal of ones; it is singular, but consistent, where the faces fall in two sets.
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
