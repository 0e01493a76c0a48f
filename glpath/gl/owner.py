"""What engines, buffers and scenes on the device have in common: they own GL objects, and can let go of them."""

from __future__ import annotations

from types import TracebackType
from typing import Self


class Owner:
    """Has objects on the device until `close`, or the end of a `with` block, or until Python collects it.

    with PathBufferTracer(...) as engine: ...
    """

    def close(self) -> None:
        """Let go of everything; what nobody else has is freed at once, where this thread has the context.

        Nothing can be done with the object any more. What it was given, a `DeviceScene`, stays with whoever has it.
        """
        vars(self).clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
