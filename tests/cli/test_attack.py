"""What strangers and misfortune do ends in a picture or a clear error, and loses nothing; see attack.py."""

from __future__ import annotations

import pytest

from tests.support.attack import BAD, KINDS, main

pytestmark = [pytest.mark.evidence, pytest.mark.release]


@pytest.mark.parametrize("kind", KINDS)
def test_no_attack_brings_a_traceback_a_crash_or_a_loss(kind: str) -> None:
    found = main([kind])[kind]
    assert {each: found[each] for each in BAD} == dict.fromkeys(BAD, 0), "\n".join(found["first"])
    assert found["fine"] > 0
    assert found["tried"] >= {"scenes": 700, "environments": 30, "disks": 8, "kills": 28, "threads": 96}[kind]
