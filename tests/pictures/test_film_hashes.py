"""The bits of some films, all engines: nothing inside may move a picture unnoticed.

Bits are those of one device, `REFERENCE`; `tests/data/film_hashes.json` has them. On another one these tests are
skipped, and the summary says so. Where a change moves a picture on purpose,
`python -m tests.pictures.test_film_hashes` writes the file anew, and the commit says which and why.
"""

from __future__ import annotations

import json

import pytest

from glpath.gl.context import get_context
from tests.support.hashed_films import FILMS, film_hash, film_of
from tests.support.repository import TESTS

#: Renderer and driver. Another one rounds otherwise.
REFERENCE = "llvmpipe (LLVM 15.0.6, 256 bits), Mesa 22.3.6"
STORED = TESTS / "data" / "film_hashes.json"


def device() -> str:
    info = get_context().info
    return f"{info.renderer}, {info.driver}"


def test_every_film_has_its_bits_stored():
    """On any device: what is not stored is not compared."""
    assert json.loads(STORED.read_text())[REFERENCE].keys() == FILMS.keys()


@pytest.mark.parametrize("name", FILMS)
def test_a_film_has_the_bits_that_it_had(name: str):
    if device() != REFERENCE:
        pytest.skip(f"films are compared on {REFERENCE} alone, not on {device()}")
    assert film_hash(film_of(name)) == json.loads(STORED.read_text())[REFERENCE][name]


if __name__ == "__main__":
    assert device() == REFERENCE, f"bits are stored of {REFERENCE} alone, not of {device()}"
    bits = {name: film_hash(film_of(name)) for name in FILMS}
    STORED.write_text(json.dumps({REFERENCE: bits}, indent=2) + "\n")
