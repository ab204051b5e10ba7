"""A file server for artifacts: reads the store and nothing else, and checks every file before a byte of it leaves.

Of the standard library alone, so that whoever has the store can serve it; whatever it may answer is listed here.
"""

import hashlib
import ipaddress
import json
import os
import shutil
import socket
import socketserver
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path, PurePosixPath
from typing import IO, cast
from urllib.parse import urlsplit

from drl_meshgen.store import pages
from drl_meshgen.store.address import parsed_path
from drl_meshgen.store.catalogue import SHORT
from drl_meshgen.store.store import Store

TYPES = {
    ".css": "text/css; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".jpg": "image/jpeg",
    ".json": "application/json",
    ".parquet": "application/vnd.apache.parquet",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".tex": "text/plain; charset=utf-8",
    ".toml": "text/plain; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
}
"""Content types by suffix; other files are downloads."""
POLICY = (
    "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts allow-downloads"
)
"""A report sorts its tables and shows its pictures; a page can do no more, whoever wrote it: it cannot read others."""
PAGE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
AT_ONCE = 32
"""Requests that are answered at the same time; others wait."""
PATIENCE = 20.0
"""Seconds a client may keep silent."""
FAREWELL = 5.0
"""Seconds that requests under way have to come to their end."""
_IN_MEMORY = 2**22
Connection = socket.socket | tuple[bytes, socket.socket]


class ArtifactServer(socketserver.ThreadingMixIn, HTTPServer):
    """Serves one store, read-only. It writes nothing there, so a store that is mounted read-only will do."""

    daemon_threads = True

    def __init__(self, store: Store, host: str, port: int) -> None:
        """Listen at `host` and `port` (0: any free one); raises OSError where that cannot be."""
        self.store = store
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._slots = threading.BoundedSemaphore(AT_ONCE)
        super().__init__((host, port), _Handler)
        self.local = _is_loopback(str(self.server_address[0]))

    @property
    def url(self) -> str:
        """The address it listens at."""
        host, port = str(self.server_address[0]), self.server_address[1]
        return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"

    def server_bind(self) -> None:
        """Take the address, without asking the network for its name as the base class does."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), self.server_address[1]

    def process_request(self, request: Connection, client_address: object) -> None:
        """Answer in a thread of its own, as soon as there are few enough."""
        self._slots.acquire()
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # no more threads
            self._slots.release()
            raise

    def process_request_thread(self, request: Connection, client_address: object) -> None:
        """Answer, then make room for the next."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._slots.release()

    def handle_error(self, request: Connection, client_address: object) -> None:
        """Say nothing of clients that hang up or fall silent."""
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)

    def server_close(self) -> None:
        """Stop listening, and let requests under way come to their end."""
        super().server_close()
        deadline = time.monotonic() + FAREWELL
        for _ in range(AT_ONCE):
            if not self._slots.acquire(timeout=max(deadline - time.monotonic(), 0)):
                return


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


class _Handler(BaseHTTPRequestHandler):
    timeout = PATIENCE

    def version_string(self) -> str:
        return "drl-meshgen"

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:  # noqa: ARG002
        """Refuse what the base class could not read as a request, without repeating any of it."""
        self.close_connection = True
        self.request_version = "HTTP/1.0"  # what could not be read counts as 0.9, whose answers have no head
        self._say(HTTPStatus(code), HTTPStatus(code).phrase)

    @property
    def _store(self) -> Store:
        return cast("ArtifactServer", self.server).store

    def _misled(self) -> bool:
        """Tell whether a page elsewhere has given this machine a name of its own to read from it by the browser."""
        if not cast("ArtifactServer", self.server).local:
            return False
        try:
            return not _is_loopback(urlsplit(f"//{self.headers.get('Host', 'localhost')}").hostname or "")
        except ValueError:
            return True

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if self._misled():
            self._say(HTTPStatus.MISDIRECTED_REQUEST, "this server answers to the names of this machine only")
        elif path == "/health":
            self._health()
        elif path == "/":
            self._page("Artifacts", pages.latest(self._store))
        elif (address := parsed_path(path)) is None:
            self._say(HTTPStatus.NOT_FOUND, "no such address")
        else:
            self._artifact(*address)

    do_HEAD = do_GET  # noqa: N815 - names that the base class calls

    def _refuse(self) -> None:
        self.close_connection = True
        self._say(HTTPStatus.METHOD_NOT_ALLOWED, "artifacts are only read", {"Allow": "GET, HEAD"})

    do_POST = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = do_TRACE = do_CONNECT = _refuse  # noqa: N815

    def _health(self) -> None:
        there = self._store.root.is_dir()
        status = HTTPStatus.OK if there else HTTPStatus.SERVICE_UNAVAILABLE
        self._send(status, "application/json", json.dumps({"store": there}).encode(), PAGE_POLICY)

    def _artifact(self, stage: str, key: str, output: str) -> None:
        record = self._store.record(stage, key)
        if record is None:
            self._say(HTTPStatus.NOT_FOUND, "no such artifact")
        elif not output:
            self._page(f"{stage} {key[:SHORT]}", pages.files(record))
        elif output not in record.ref.outputs:
            self._say(HTTPStatus.NOT_FOUND, "no such file in this artifact")
        else:
            self._file(record.ref.outputs[output], PurePosixPath(output))

    def _file(self, sha: str, name: PurePosixPath) -> None:
        with tempfile.SpooledTemporaryFile(_IN_MEMORY) as copy:
            if not sound_copy(self._store.objects.path(sha), sha, copy):
                self._say(HTTPStatus.GONE, "the file is missing or damaged; running its stage again restores it")
                return
            length = copy.tell()
            copy.seek(0)
            extra = {"ETag": f'"{sha}"'}
            if self.headers.get("If-None-Match") == extra["ETag"]:
                self._start(HTTPStatus.NOT_MODIFIED, POLICY, extra)
                return
            kind = TYPES.get(name.suffix)
            if kind is None:
                extra["Content-Disposition"] = f'attachment; filename="{name.name}"'
            extra |= {"Content-Type": kind or "application/octet-stream", "Content-Length": str(length)}
            self._start(HTTPStatus.OK, POLICY, extra)
            if self.command != "HEAD":
                shutil.copyfileobj(copy, self.wfile)

    def _page(self, title: str, body: str) -> None:
        self._send(HTTPStatus.OK, TYPES[".html"], pages.page(title, body).encode(), PAGE_POLICY)

    def _say(self, status: HTTPStatus, sentence: str, extra: Mapping[str, str] | None = None) -> None:
        self._send(status, TYPES[".txt"], f"{sentence}\n".encode(), PAGE_POLICY, extra)

    def _send(
        self, status: HTTPStatus, kind: str, body: bytes, policy: str, extra: Mapping[str, str] | None = None
    ) -> None:
        self._start(status, policy, {"Content-Type": kind, "Content-Length": str(len(body)), **(extra or {})})
        if self.command != "HEAD":
            self.wfile.write(body)

    def _start(self, status: HTTPStatus, policy: str, headers: Mapping[str, str]) -> None:
        self.send_response(status)
        fixed = {
            "Cache-Control": "no-cache",
            "Content-Security-Policy": policy,
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        for name, value in {**fixed, **headers}.items():
            self.send_header(name, value)
        self.end_headers()


def sound_copy(path: Path, sha: str, copy: IO[bytes]) -> bool:
    """Copy an object and tell whether what was copied has the content its name promises.

    Nothing but a plain file is opened, so neither a link nor a pipe in its place leads anywhere.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return False
    found = hashlib.sha256()
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            return False
        while chunk := os.read(handle, 2**20):
            found.update(chunk)
            copy.write(chunk)
    except OSError:  # a sector that cannot be read
        return False
    finally:
        os.close(handle)
    return found.hexdigest() == sha
