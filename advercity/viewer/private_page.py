"""Forwards Rerun's page to browsers of this machine, with a policy blocking the Internet.

Without it the page sends usage data, asks for releases and loads fonts, despite Rerun's settings.
Browsers enforce the policy.
"""

import shutil
from collections.abc import Generator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from urllib.error import HTTPError, URLError
from urllib.request import urlopen

from advercity.errors import RunError

LOOPBACK_ADDRESS = "127.0.0.1"
TILE_SERVER = "https://tile.openstreetmap.org"
FORWARDED_HEADERS = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")


def build_policy(*, map_tiles: bool) -> str:
    """Build the Content-Security-Policy: this machine, and with tiles their server."""
    tiles = f" {TILE_SERVER}" if map_tiles else ""
    scripts = "'self' 'unsafe-inline' 'wasm-unsafe-eval' blob: data:"
    return (
        f"default-src {scripts}; connect-src 'self' http://{LOOPBACK_ADDRESS}:* blob: data:{tiles}"
    )


@contextmanager
def forward_page(port: int, source_port: int, *, map_tiles: bool) -> Generator[None]:
    """Forward the page at `source_port` to `port` with the policy, while the context is entered.

    Raises:
        RunError: The port is taken.
    """
    policy = build_policy(map_tiles=map_tiles)

    class Forwarder(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if not self.path.startswith("/"):
                return self.send_error(400)
            try:
                answer = urlopen(f"http://{LOOPBACK_ADDRESS}:{source_port}{self.path}")
            except HTTPError as error:
                return self.send_error(error.code)
            except URLError:
                return self.send_error(502)
            with answer:
                self.send_response(answer.status)
                for name in FORWARDED_HEADERS:
                    if answer.headers[name] is not None:
                        self.send_header(name, answer.headers[name])
                self.send_header("Content-Security-Policy", policy)
                self.end_headers()
                shutil.copyfileobj(answer, self.wfile)

        def log_message(self, format: str, *args: object) -> None:
            """Keep quiet."""

    try:
        server = ThreadingHTTPServer((LOOPBACK_ADDRESS, port), Forwarder)
    except OSError as error:
        raise RunError(f"port {port} is taken, perhaps by another web view; close it") from error
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
