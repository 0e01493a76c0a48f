"""Log of the package: the logger "glpath", whose messages never end the work."""

from __future__ import annotations

import logging
import sys
from typing import Any

from glpath.errors import encodable


class ReportLog(logging.LoggerAdapter[logging.Logger]):
    """Logger that catches exceptions of its handlers and filters, which belong to the caller's program.

    The message of a failed handler goes to standard error instead.
    """

    def log(self, level: int, msg: object, *args: Any, **how: Any) -> None:
        """Log a message; all other methods of the logger, such as `warning`, call this one."""
        try:
            super().log(level, msg, *args, **{"stacklevel": 2, **how})  # 2: the caller of `warning`
        except Exception as error:
            from glpath.system.terminal import report_stream  # late, because it imports rich

            text = str(msg) % args if args else str(msg)
            reason = (
                f"glpath: a handler of the logger {self.logger.name} raised {type(error).__name__}; the message:"
            )
            print(encodable(f"{reason} {text}"), file=report_stream(sys.stderr), flush=True)


#: Log of all modules.
log = ReportLog(logging.getLogger("glpath"))
#: Log of compilations. Their messages are warnings, because logging shows only warnings by default.
compilations = ReportLog(logging.getLogger("glpath.compilations"))
