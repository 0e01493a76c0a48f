"""Base class of GL object owners (engines, buffers, scenes on the device) that can release their objects."""

from __future__ import annotations

from typing import Self


class Owner:
    """Owner of objects on the device until `close`, the end of a `with` block, or garbage collection.

    with PathBufferTracer(...) as engine: ...
    """

    def close(self) -> None:
        """Release everything; unshared objects are freed at once if this thread has the context.

        The owner is unusable afterwards. A `DeviceScene` that it was given stays with its other owners.
        """
        vars(self).clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
