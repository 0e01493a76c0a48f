"""A server on the loopback with a page at its root, and the files that the page requests."""

from __future__ import annotations

from http.server import SimpleHTTPRequestHandler
from typing import Any


class PageHandler(SimpleHTTPRequestHandler):
    """Serves a page; a subclass maps other paths to files in `translate_path`."""

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
