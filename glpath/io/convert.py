"""Thread-safe conversions with msgspec, which builds tables without a lock at the first use of a type."""

from __future__ import annotations

from threading import Lock
from typing import Any

import msgspec

_LOCK = Lock()


def convert(value: Any, kind: Any, *, strict: bool = True) -> Any:
    """Return `value` converted to the type `kind`. Raises msgspec.ValidationError.

    Text with surrogates, and objects that msgspec cannot read, raise the same error.

    The lock is needed because msgspec 0.22 crashes if several threads convert to one type for the first time.
    """
    with _LOCK:
        try:
            return msgspec.convert(value, kind, strict=strict)
        except UnicodeEncodeError as error:
            raise msgspec.ValidationError("UTF-8 cannot encode its text") from error
        except msgspec.ValidationError:
            raise
        except Exception as error:  # objects of other packages raise any error when they are indexed
            raise msgspec.ValidationError("has an object of a type that a file cannot hold") from error


def decode_json(text: str | bytes, kind: Any) -> Any:
    """Return JSON decoded as `kind`, under the same lock as `convert`. Raises msgspec.DecodeError."""
    with _LOCK:
        try:
            return msgspec.json.decode(text, type=kind)
        except UnicodeEncodeError as error:
            raise msgspec.DecodeError("UTF-8 cannot encode its text") from error
