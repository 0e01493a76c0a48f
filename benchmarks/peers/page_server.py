"""A page at the root of a server on the loopback, and what it asks for beside it."""

from __future__ import annotations

from http.server import SimpleHTTPRequestHandler
from typing import Any


class PageHandler(SimpleHTTPRequestHandler):
    """Of a page; a subclass says by `translate_path` which files other paths are."""

    def __init__(self, *given: Any, page: bytes) -> None:
        self.page = page
        super().__init__(*given)

    def do_GET(self) -> None:
        if self.path != "/":
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(self.page)))
        self.end_headers()
        self.wfile.write(self.page)

    def log_message(self, *_: object) -> None:
        pass
