"""The services of compose.yaml as processes of this machine: same commands, environments, health checks and order.

Names of containers become loopback addresses with free ports, /app a folder; Postgres is a private cluster.
"""

import contextlib
import os
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
PORTS = {"postgres": "5432", "server": "4200", "files": "4300", "worker": "8080", "batches": "8080"}
"""Where services listen inside their containers."""
PATIENCE = 180.0
"""Seconds a service may take to become healthy."""


def free_ports(count):
    probes = [socket.socket() for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


def postgres_programs():
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return found[-1].parent if found else Path(shutil.which("initdb")).parent


class Service:
    """One container's process."""

    def __init__(self, topology, name, number=1):
        self.topology, self.name, self.number = topology, name, number
        self.given = topology.compose["services"][name]
        self.label = f"{name}-{number}"
        self.port = topology.ports[name] if number == 1 else free_ports(1)[0]
        self.home = topology.folder / "home" / self.label
        self.home.mkdir(parents=True)
        self.log = topology.folder / "logs" / f"{self.label}.log"
        self.process = None

    def environment(self):
        variables = re.findall(r"(\w+)=(\S+)", " ".join(re.findall(r"^ENV ((?:.*\\\n)*.*)$", DOCKERFILE, re.MULTILINE)))
        return {
            "PATH": f"{Path(sys.executable).parent}:{postgres_programs()}:{os.environ['PATH']}",
            "HOME": str(self.home),
            "PYTHONPATH": str(ROOT / "src"),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "PREFECT_WORKER_WEBSERVER_PORT": str(self.port),
            **dict(variables),
            **{name: self.here(str(value)) for name, value in self.given.get("environment", {}).items()},
        }

    def here(self, text):
        """Return a text of compose.yaml as it is without containers."""
        text = self.topology.resolved(text)
        for name, port in self.topology.ports.items():
            text = text.replace(f"{name}:{PORTS.get(name, '')}", f"127.0.0.1:{port}")
        text = re.sub(
            rf"(?<=127\.0\.0\.1:){PORTS.get(self.name, 'none')}\b|^{PORTS.get(self.name, 'none')}$",
            str(self.port),
            text,
        )
        return re.sub(r"(?<![\w.])/app\b", str(self.topology.app), text).replace("0.0.0.0", "127.0.0.1")

    def command(self):
        return [self.here(part) for part in self.given["command"]]

    def start(self):
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                self.command(),
                cwd=self.topology.app,
                env=self.environment(),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def healthy(self):
        kind, *test = [self.here(part) for part in self.given["healthcheck"]["test"]]
        command = ["sh", "-c", *test] if kind == "CMD-SHELL" else test
        environment = self.environment() | {"PGHOST": "127.0.0.1", "PGPORT": str(self.port)}
        return subprocess.run(command, env=environment, capture_output=True, check=False).returncode == 0

    def wait(self):
        """Wait until it is healthy."""
        deadline = time.monotonic() + PATIENCE
        while not self.healthy():
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"{self.label} does not come up:\n{self.log.read_text()[-3000:]}")
            time.sleep(0.5)

    def ended(self):
        """Wait until a one-shot service has done its work."""
        if self.process.wait(PATIENCE):
            raise RuntimeError(f"{self.label} failed:\n{self.log.read_text()[-3000:]}")

    def family(self):
        """Return the ids of its process and of all that it started, the youngest first."""
        parents = {}
        for place in Path("/proc").glob("[0-9]*/stat"):
            try:
                parents[int(place.parent.name)] = int(place.read_text().rpartition(")")[2].split()[1])
            except OSError:  # ended meanwhile
                continue
        found = [self.process.pid]
        for one in found:
            found += [child for child, parent in parents.items() if parent == one]
        return found[::-1]

    def kill(self):
        """End it and all it started as a power cut does."""
        for one in self.family():
            send(one, signal.SIGKILL)
        self.process.wait(30)

    def stop(self):
        """End it as `docker compose stop` does: a signal, some patience, an end."""
        if self.process is None or self.process.poll() is not None:
            return
        family = self.family()
        self.process.send_signal(signal.SIGINT if self.name == "postgres" else signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(20)
        for one in family:
            send(one, signal.SIGKILL)
        self.process.wait(30)


def send(process, number):
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, number)


class Postgres(Service):
    """A private cluster; Postgres refuses to run as root, so root lends it the user that the package made."""

    @property
    def data(self):
        return self.topology.folder / "postgres"

    def command(self):
        sockets = self.topology.folder / "sockets"
        return [
            *self.user(),
            "postgres",
            "-D",
            str(self.data),
            "-p",
            str(self.port),
            "-h",
            "127.0.0.1",
            "-k",
            str(sockets),
        ]

    @staticmethod
    def user():
        return ["setpriv", "--reuid=postgres", "--regid=postgres", "--init-groups"] if os.geteuid() == 0 else []

    def start(self):
        if not self.data.exists():
            self.create()
        super().start()

    def create(self):
        given = self.environment()
        secret = self.topology.folder / "secret"
        secret.write_text(given["POSTGRES_PASSWORD"])
        for place in (self.data, self.topology.folder / "sockets"):
            place.mkdir(mode=0o700)
            if os.geteuid() == 0:
                shutil.chown(place, "postgres", "postgres")
        if os.geteuid() == 0:
            shutil.chown(secret, "postgres", "postgres")
        command = [*self.user(), "initdb", "-D", str(self.data), "-U", given["POSTGRES_USER"], "--encoding=UTF8"]
        command += ["--locale=C.UTF-8", "--auth=scram-sha-256", f"--pwfile={secret}"]
        subprocess.run(command, env=given, cwd=self.topology.folder, check=True, capture_output=True)
        secret.unlink()
        super().start()
        given |= {"PGPASSWORD": given["POSTGRES_PASSWORD"], "PGHOST": "127.0.0.1", "PGPORT": str(self.port)}
        create = ["createdb", "--username", given["POSTGRES_USER"], given["POSTGRES_DB"]]
        deadline = time.monotonic() + PATIENCE
        while subprocess.run(create, env=given, capture_output=True, check=False).returncode:
            if time.monotonic() > deadline:
                raise RuntimeError(self.log.read_text())
            time.sleep(0.3)
        self.stop()


class Topology:
    """All services, started in their order and ended together."""

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="drl-meshgen-integration-"))
        self.folder.chmod(0o711)  # Postgres passes through as another user
        self.app = self.folder / "app"
        self.compose = yaml.safe_load((ROOT / "compose.yaml").read_text())
        names = list(self.compose["services"])
        self.ports = dict(zip(names, free_ports(len(names)), strict=True))
        self.variables = {
            "POSTGRES_PASSWORD": secrets.token_hex(16),
            "DASHBOARD_PORT": str(self.ports["server"]),
            "FILES_PORT": str(self.ports["files"]),
        }
        for name in ("flows", "tasks"):
            shutil.copytree(ROOT / name, self.app / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("artifacts", "models", "reports/generated"):
            (self.app / name).mkdir(parents=True)
        (self.folder / "logs").mkdir()
        self.services = {}

    def resolved(self, text):
        """Return a text with its variables as compose puts them in."""

        def value(match):
            name, kind, default = match.groups()
            known = self.variables.get(name) or (default if kind == ":-" else None)
            if known is None:
                raise KeyError(name)
            return known

        return re.sub(r"\$\{(\w+)(?:(:-|:\?)([^}]*))?\}", value, text)

    def start(self):
        for name in self.order():
            given = self.compose["services"][name]
            count = int(self.resolved(str(given.get("scale", 1))))
            made = [(Postgres if name == "postgres" else Service)(self, name, k + 1) for k in range(count)]
            self.services |= {service.label: service for service in made}
            for service in made:
                service.start()
            for service in made:
                if "healthcheck" in given:
                    service.wait()
                else:
                    service.ended()

    def order(self):
        """Return the names of the services, each after those it depends on."""
        given, done = self.compose["services"], []
        while len(done) < len(given):
            done += [name for name in given if name not in done and set(given[name].get("depends_on", ())) <= set(done)]
        return done

    def stop(self):
        """End everything, the last started first, and remove the folder."""
        for service in reversed(self.services.values()):
            service.stop()
        shutil.rmtree(self.folder, ignore_errors=True)


DOCKERFILE = (ROOT / "Dockerfile").read_text()
