"""Where a recording goes, checked before anything is sent.

Rerun itself only logs that a port is taken or that nobody listens, and goes on without an audience.
"""

import socket
from pathlib import Path
from urllib.parse import urlsplit

import rerun as rr

from advercity.errors import InputError, RunError

LOOPBACK = "127.0.0.1"
PORT = 9876
PATIENCE_S = 3.0


def file_at(path: Path) -> rr.FileSink:
    """A recording that grows in `partial_of(path)`, for whoever closes it to move to `path`.

    Raises:
        InputError: `path` is a folder.
        RunError: It cannot be written.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name a file that ends in .rrd")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial_of(path).open("wb").close()
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error
    return rr.FileSink(str(partial_of(path)))


def partial_of(path: Path) -> Path:
    """Where a recording lies while it is not whole."""
    return path.with_name(f"{path.name}.partial")


def server_on(port: int) -> rr.GrpcServerSink:
    """A server for viewers on this machine, and only for them; RunError if the port is taken."""
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((LOOPBACK, port))
    except OSError as error:
        raise RunError(
            f"port {port} is taken, perhaps by a Rerun viewer; close it, or send to it with"
            f" --connect {LOOPBACK}:{port}"
        ) from error
    return rr.GrpcServerSink(LOOPBACK, port)


def connection_to(address: str) -> rr.GrpcSink:
    """A running viewer.

    Args:
        address: `host:port` or a whole `rerun+http://host:port/proxy`.

    Raises:
        InputError: `address` is neither.
        RunError: Nobody listens there.
    """
    url = address if "://" in address else f"rerun+http://{address}/proxy"
    try:
        sink = rr.GrpcSink(url)
        parts = urlsplit(url)
        host, port = parts.hostname or LOOPBACK, parts.port or PORT
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"{address}: not an address of a Rerun viewer; write host:port: {error}"
        ) from error
    try:
        socket.create_connection((host, port), timeout=PATIENCE_S).close()
    except OSError as error:
        raise RunError(f"{address}: no Rerun viewer answers; start one with: rerun") from error
    return sink
