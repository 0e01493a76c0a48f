"""Owners of GL objects, which can release them: engines, buffers and scenes on the device."""

from __future__ import annotations

from typing import Self


class Owner:
    """Has objects on the device until `close`, or the end of a `with` block, or until Python collects it.

    with PathBufferTracer(...) as engine: ...
    """

    def close(self) -> None:
        """Release everything; unshared objects are freed at once, where this thread has the context.

        The object is unusable then. What it was given, a `DeviceScene`, stays with its other owners.
        """
        vars(self).clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
