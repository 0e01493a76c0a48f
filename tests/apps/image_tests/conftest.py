"""What tests of the plugin share."""

from __future__ import annotations

import tests.support.preloaded  # noqa: F401
