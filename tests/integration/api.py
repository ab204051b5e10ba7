"""Prefect's REST interface, as far as the check of the deployment needs it."""

import json
import time
import urllib.error
import urllib.request

ENDED = {"COMPLETED", "FAILED", "CRASHED", "CANCELLED"}


class Api:
    def __init__(self, base):
        self.base = base

    def ask(self, path, body=None, method=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            f"{self.base}{path}", data, {"Content-Type": "application/json"}, method=method
        )
        with urllib.request.urlopen(request, timeout=30) as reply:
            content = reply.read()
        return json.loads(content) if content else None

    def deployment(self, name):
        return self.ask(f"/deployments/name/{name}")

    def start(self, name, **parameters):
        """Ask for a run of a deployment and return its id."""
        found = self.deployment(name)["id"]
        return self.ask(f"/deployments/{found}/create_flow_run", {"parameters": parameters})["id"]

    def run(self, number):
        return self.ask(f"/flow_runs/{number}")

    def runs(self, **filters):
        return self.ask("/flow_runs/filter", {"flow_runs": filters, "limit": 200})

    def workers(self, pool):
        return self.ask(f"/work_pools/{pool}/workers/filter", {})

    def artifacts(self, number):
        return self.ask("/artifacts/filter", {"artifacts": {"flow_run_id": {"any_": [number]}}, "limit": 200})

    def wait(self, number, states=ENDED, seconds=240):
        """Wait until a flow run is in one of these states and return it; outages of the server are waited for too."""
        return until(lambda: (run := self.run(number))["state_type"] in states and run, seconds, number)


def until(ask, seconds, what):
    """Ask until the answer is true and return it; a server that does not answer is asked again."""
    deadline = time.monotonic() + seconds
    answer = None
    while time.monotonic() < deadline:
        try:
            if answer := ask():
                return answer
        except (urllib.error.URLError, ConnectionError, TimeoutError):
            pass
        time.sleep(0.5)
    raise AssertionError(f"{what}: not within {seconds} s")
