"""Thread-safe conversions with msgspec, which builds tables without a lock at the first use of a type."""

from __future__ import annotations

from threading import Lock
from typing import Any

import msgspec

_LOCK = Lock()


def convert(value: Any, kind: Any, *, strict: bool = True) -> Any:
    """Return `value` converted to the type `kind`. Raises msgspec.ValidationError, also for text with surrogates.

    The lock is needed because msgspec 0.22 crashes if several threads convert to one type for the first time.
    """
    with _LOCK:
        try:
            return msgspec.convert(value, kind, strict=strict)
        except UnicodeEncodeError as error:
            raise msgspec.ValidationError("UTF-8 cannot encode its text") from error
        except TypeError as error:  # msgspec takes some objects, such as ranges, for dictionaries
            raise msgspec.ValidationError(f"a {type(value).__name__}, or a value in it, cannot be read") from error


def decode_json(text: str | bytes, kind: Any) -> Any:
    """Return JSON decoded as `kind`, under the same lock as `convert`. Raises msgspec.DecodeError."""
    with _LOCK:
        return msgspec.json.decode(text, type=kind)
