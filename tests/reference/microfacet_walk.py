"""Light that walks from microfacet to microfacet of rough metal, slow and without approximations.

Source: Heitz, Hanika, d'Eon & Dachsbacher 2016, Multiple-scattering microfacet BSDFs with the Smith model: heights
        alike likely, GGX's normals; Schlick's Fresnel.
"""

from __future__ import annotations

import numpy as np

from glpath.scene.model import Float64


def metal_albedo(cosine: float, alpha: float, normal: float, paths: int = 200_000) -> float:
    """Of light from a cosine, the share that leaves again; `normal`: what metal reflects at normal incidence."""
    rng = np.random.default_rng(0)
    w = np.tile([-np.sqrt(1 - cosine**2), 0.0, -cosine], (paths, 1))
    share, below = np.ones(paths), np.ones(paths)  # below: of all heights
    left = 0.0
    for _ in range(60):
        exponent, u = _lambda(w, alpha), rng.random(len(w))
        seen = np.where(w[:, 2] > 0, below ** np.maximum(exponent, 0.0), 0.0)
        out = u > 1 - seen
        left += float(share[out].sum())
        w, share, below, exponent, u = (each[~out] for each in (w, share, below, exponent, u))
        if not len(w):
            break
        below = np.clip(below / (1 - u) ** (1 / np.where(np.abs(exponent) < 1e-9, 1e-9, exponent)), 1e-12, 1)
        m = _visible_normals(-w, alpha, rng)
        o = -(w * m).sum(axis=1)
        share = share * (normal + (1 - normal) * np.clip(1 - o, 0, 1) ** 5)
        w = w + 2 * o[:, None] * m
    return left / paths


def _lambda(w: Float64, alpha: float) -> Float64:
    z = np.clip(w[:, 2], -0.999999, 0.999999)
    return np.asarray(0.5 * (-1 + np.sign(z) * np.sqrt(1 + alpha**2 * (1 - z * z) / (z * z))))


def _visible_normals(w: Float64, alpha: float, rng: np.random.Generator) -> Float64:
    stretched = w * [alpha, alpha, 1.0]
    stretched /= np.linalg.norm(stretched, axis=1, keepdims=True)
    u = rng.random((2, len(w)))
    z = (1 - u[1]) * (1 + stretched[:, 2]) - stretched[:, 2]
    r, phi = np.sqrt(np.clip(1 - z * z, 0, 1)), 2 * np.pi * u[0]
    h = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1) + stretched
    h = np.stack([alpha * h[:, 0], alpha * h[:, 1], np.maximum(h[:, 2], 1e-9)], axis=1)
    return np.asarray(h / np.linalg.norm(h, axis=1, keepdims=True))
