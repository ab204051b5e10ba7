"""A Prefect server for interactive runs: the one that is there, or a persistent local one that is started."""

import os
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from prefect.settings import (
    PREFECT_API_URL,
    PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
    PREFECT_HOME,
    temporary_settings,
)

from drl_meshgen.errors import MeshgenError
from drl_meshgen.store.locks import exclusive

LOCAL = "http://127.0.0.1:4200/api"
PATIENCE = 180.0
"""Seconds a server may take to start; 14 on two idle cores, 60 on busy ones."""


class ServerError(MeshgenError):
    """No Prefect server can be reached or started."""


def answers(api: str) -> bool:
    """Tell whether a Prefect server answers at an API address."""
    try:
        with urllib.request.urlopen(f"{api}/health", timeout=5) as reply:  # noqa: S310 - http by construction
            return reply.status == 200 and reply.read().strip() == b"true"
    except (urllib.error.URLError, TimeoutError, ConnectionError):
        return False


def start(api: str) -> subprocess.Popen[bytes] | None:
    """Start a server in the background at a local address and wait until it answers.

    It outlives this process, keeps its SQLite database and log in PREFECT_HOME, and ends with `prefect server stop`.
    Returns its process, None where one answers already. Raises `ServerError` where it does not come up.
    """
    home = Path(PREFECT_HOME.value())
    address = urlsplit(api)
    with exclusive(home / "server.lock"):
        if answers(api):
            return None
        log = home / "server.log"
        command = [sys.executable, "-m", "prefect", "server", "start"]
        command += ["--host", str(address.hostname), "--port", str(address.port or 4200)]
        with log.open("ab") as out:
            server = subprocess.Popen(  # noqa: S603 - a fixed command
                command,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                start_new_session=True,
                env={**os.environ, "PREFECT_HOME": str(home)},
            )
        (home / "server.pid").write_text(str(server.pid))
        deadline = time.monotonic() + PATIENCE
        while not answers(api):
            if server.poll() is not None or time.monotonic() > deadline:
                raise ServerError(f"no Prefect server came up at {api}; see {log}")
            time.sleep(0.25)
    return server


@contextmanager
def connected() -> Iterator[str]:
    """Yield the address of a server that answers, with Prefect's settings pointing to it.

    That is the configured one (PREFECT_API_URL or profile), else a local one, started if need be. Raises `ServerError`
    where a configured server elsewhere does not answer.
    """
    api = (PREFECT_API_URL.value() or LOCAL).rstrip("/")
    if not answers(api):
        if urlsplit(api).hostname not in {"127.0.0.1", "localhost"}:
            raise ServerError(f"the Prefect server at {api} does not answer")
        sys.stderr.write(f"starting a Prefect server at {api.removesuffix('/api')}; `prefect server stop` ends it\n")
        start(api)
    with temporary_settings({PREFECT_API_URL: api, PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None}):
        yield api
