"""One Prefect server for all flow tests: it takes longer to start than they take together."""

import socket
import subprocess
import time

import pytest
from prefect.settings import (
    PREFECT_API_URL,
    PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
    PREFECT_HOME,
    PREFECT_LOGGING_TO_API_ENABLED,
    temporary_settings,
)

import flows  # noqa: F401 - quietens Prefect before it is imported
from flows.server import start


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    home = tmp_path_factory.mktemp("prefect")
    api = f"http://127.0.0.1:{free_port()}/api"
    settings = {
        PREFECT_HOME: home,
        PREFECT_API_URL: api,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None,
        PREFECT_LOGGING_TO_API_ENABLED: False,
    }
    with temporary_settings(settings):
        process = start(api)
        yield api
        process.terminate()
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:  # how fast Prefect shuts down is not what is tested
            process.kill()


@pytest.fixture
def wait_for():
    """Return a function that asks until the answer is the expected one: the server learns of states by events."""

    def wait(ask, expected, seconds=20):
        deadline = time.monotonic() + seconds
        while (answer := ask()) != expected and time.monotonic() < deadline:
            time.sleep(0.1)
        assert answer == expected

    return wait
