"""One page on a port of this machine, for as long as somebody looks at it; the server ends with its process."""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from m4_dynamics.errors import InvalidSettingError

__all__ = ["LOOPBACK", "PageServer", "can_open_browser", "open_browser"]

#: Nobody but this machine reaches it.
LOOPBACK = "127.0.0.1"


class PageServer:
    """Serves one page at the root of a port; any other path is not found."""

    def __init__(self, page: str, *, host: str = LOOPBACK, port: int = 0) -> None:
        """Take a port; nothing is answered before `run`.

        Args:
            page: The page's text.
            host: Address to listen on.
            port: Port to listen on; 0 takes a free one.

        Raises:
            InvalidSettingError: The address or the port cannot be had.
        """
        if not 0 <= port <= 65535:
            raise InvalidSettingError("port", port, "a number from 0 to 65535")
        try:
            self._server = ThreadingHTTPServer((host, port), _handler_of(page.encode("utf-8")))
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InvalidSettingError("address", f"{host}:{port}", f"one that is free here ({reason})") from error
        self._server.daemon_threads = True
        shown = host if host not in ("", "0.0.0.0") else LOOPBACK
        #: Where the page is.
        self.url = f"http://{shown}:{self._server.server_address[1]}/"

    def run(self) -> None:
        """Answer until `stop` is called from another thread, or an interrupt ends it; then the port is free again."""
        try:
            self._server.serve_forever(poll_interval=0.1)
        finally:
            self._server.server_close()

    def stop(self) -> None:
        """End `run`."""
        self._server.shutdown()


def can_open_browser() -> bool:
    """Whether there is a screen that a browser could open a window on."""
    if sys.platform.startswith("linux"):
        return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return True


def open_browser(url: str) -> None:
    """Ask the user's browser to show an address, without waiting for it."""
    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def _handler_of(body: bytes) -> type[BaseHTTPRequestHandler]:
    """A handler that knows one page."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            self._answer(with_body=True)

        def do_HEAD(self) -> None:
            self._answer(with_body=False)

        def _answer(self, *, with_body: bool) -> None:
            found = self.path.split("?")[0] == "/"
            content = body if found else b"There is one page here, at /.\n"
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", f"text/{'html' if found else 'plain'}; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            if with_body:
                self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing: who looks sees."""

    return Handler
