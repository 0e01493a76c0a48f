"""msgspec's conversions for any number of threads: the first one to a type prepares tables without a lock."""

from __future__ import annotations

from threading import Lock
from typing import Any

import msgspec

_LOCK = Lock()


def convert(value: Any, kind: Any, *, strict: bool = True) -> Any:
    """`value` as `kind`. Raises msgspec.ValidationError.

    msgspec 0.22 crashes where several threads convert to one type for the first time.
    """
    with _LOCK:
        return msgspec.convert(value, kind, strict=strict)


def decode_json(text: str | bytes, kind: Any) -> Any:
    """JSON as `kind`, with the same lock. Raises msgspec.DecodeError."""
    with _LOCK:
        return msgspec.json.decode(text, type=kind)
