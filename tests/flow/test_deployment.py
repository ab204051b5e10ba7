"""compose.yaml, Dockerfile, prefect.yaml and Makefile agree with each other and with the flows."""

import re
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
import yaml
from cronsim import CronSim
from prefect.utilities.importtools import import_object

ROOT = Path(__file__).resolve().parents[2]
COMPOSE = yaml.safe_load((ROOT / "compose.yaml").read_text())
SERVICES = COMPOSE["services"]
DEPLOYMENTS = {one["name"]: one for one in yaml.safe_load((ROOT / "prefect.yaml").read_text())["deployments"]}
DOCKERFILE = (ROOT / "Dockerfile").read_text()
MAKEFILE = (ROOT / "Makefile").read_text()
ONE_SHOT = {"deploy"}


def mounts(service):
    """Return the places in a service's containers by what is mounted there."""
    found = [re.fullmatch(r"(.+?):(/[^:]+)(:ro)?", volume) for volume in SERVICES[service].get("volumes", [])]
    return {match[1]: match[2] for match in found}


def options(command):
    """Return the values of the options of a command by name."""
    return {name: value for name, value in pairwise(command) if name.startswith("--")}


@pytest.mark.parametrize("name", DEPLOYMENTS)
def test_every_deployment_names_a_flow_and_parameters_that_it_takes(name):
    deployment = DEPLOYMENTS[name]
    path, _, function = deployment["entrypoint"].partition(":")
    assert (ROOT / path).is_file()
    flow = import_object(f"{path.removesuffix('.py').replace('/', '.')}.{function}")
    flow.validate_parameters(deployment.get("parameters", {}))


@pytest.mark.parametrize("name", DEPLOYMENTS)
def test_every_schedule_can_be_read_and_names_its_time_zone(name):
    for schedule in DEPLOYMENTS[name].get("schedules", []):
        assert next(CronSim(schedule["cron"], datetime.now(ZoneInfo(schedule["timezone"]))))


def test_every_pool_of_a_deployment_is_made_and_has_a_worker():
    pools = {deployment["work_pool"]["name"] for deployment in DEPLOYMENTS.values()}
    commands = [service["command"] for service in SERVICES.values() if "worker" in service.get("command", [])]
    assert {options(command)["--pool"] for command in commands} == pools
    for pool in pools:
        assert f"work-pool create {pool} " in SERVICES["deploy"]["command"][-1]


def test_a_batch_never_waits_for_the_worker_that_it_occupies():
    nightly = DEPLOYMENTS["nightly"]
    flow, _, shard = nightly["parameters"]["deployment"].partition("/")
    assert DEPLOYMENTS[shard]["entrypoint"].endswith(f":{flow}")
    assert DEPLOYMENTS[shard]["work_pool"] != nightly["work_pool"]
    assert DEPLOYMENTS[shard]["parameters"]["runner"] != "workers"


def test_workers_are_alike_but_for_their_pool():
    differ = {"command", "mem_limit", "scale"}
    worker, batches = ({k: v for k, v in SERVICES[name].items() if k not in differ} for name in ("worker", "batches"))
    assert worker == batches


def test_long_running_services_restart_and_tell_their_health():
    for name, service in SERVICES.items():
        if name not in ONE_SHOT:
            assert service["restart"] == "unless-stopped"
            assert service["healthcheck"]["test"]


def test_services_wait_for_others_until_these_can_be_used():
    for service in SERVICES.values():
        for other, how in service.get("depends_on", {}).items():
            ready = "service_completed_successfully" if other in ONE_SHOT else "service_healthy"
            assert how["condition"] == ready


def test_no_file_holds_a_secret():
    for name, service in SERVICES.items():
        for key, value in service.get("environment", {}).items():
            if "PASSWORD" in key:
                assert value.startswith("${"), (name, key)
            given = re.search(r"://[^:/]+:([^@]+)@", re.sub(r"\$\{[^}]*\}", "$", str(value)))
            assert given is None or given[1] == "$", (name, key)
    assert ".env" in (ROOT / ".gitignore").read_text().split()
    assert not any(line.startswith("!.env") for line in (ROOT / ".dockerignore").read_text().splitlines())


def test_nothing_is_published_beyond_this_machine():
    ports = [port for service in SERVICES.values() for port in service.get("ports", [])]
    assert [port for port in ports if not port.startswith("127.0.0.1:")] == []


def test_containers_have_no_privileges():
    for service in SERVICES.values():
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
    assert SERVICES["postgres"]["user"] == "postgres"
    for target in ("server", "worker"):
        stage = DOCKERFILE.partition(f" AS {target}\n")[2].partition("\nFROM ")[0]
        assert re.findall(r"^USER (.+)$", stage, re.MULTILINE) == ["meshgen"]


def test_images_are_pinned_and_targets_exist():
    targets = re.findall(r"^FROM \S+ AS (\w+)$", DOCKERFILE, re.MULTILINE)
    for service in SERVICES.values():
        assert service["build"]["target"] in targets if "build" in service else re.search(r":\d", service["image"])


def test_what_one_service_writes_the_other_reads():
    workdir = re.search(r"^WORKDIR (\S+)$", DOCKERFILE, re.MULTILINE)[1]
    worker, files = SERVICES["worker"], SERVICES["files"]
    assert mounts("worker")["artifacts"] == mounts("files")["artifacts"] == f"{workdir}/artifacts"
    assert worker["environment"]["DRL_MESHGEN_STORE"] == files["environment"]["DRL_MESHGEN_STORE"]
    assert worker["environment"]["DRL_MESHGEN_STORE"] == mounts("worker")["artifacts"]
    assert "artifacts:/app/artifacts:ro" in files["volumes"]
    volumes = re.search(r"^VOLUME (.+)$", DOCKERFILE, re.MULTILINE)[1]
    assert {mounts("worker")[name] for name in ("artifacts", "reports")} == set(yaml.safe_load(volumes))
    named = {name for service in SERVICES for name in mounts(service) if not name.startswith(("$", "."))}
    assert named == set(COMPOSE["volumes"])


@pytest.mark.parametrize("name", DEPLOYMENTS)
def test_what_a_deployment_writes_lies_in_a_volume_of_the_worker(name):
    parameters = DEPLOYMENTS[name].get("parameters", {})
    places = [parameters[key] for key in ("report", "out", "store", "rows") if parameters.get(key)]
    kept = [place.removeprefix("/app/") for place in mounts("worker").values()]
    assert [place for place in places if not place.startswith(tuple(kept))] == []


def test_addresses_and_ports_agree():
    environment = {name: service.get("environment", {}) for name, service in SERVICES.items()}
    server, files = SERVICES["server"], SERVICES["files"]
    published, inside = server["ports"][0].removeprefix("127.0.0.1:").rsplit(":", 1)
    assert options(server["command"])["--port"] == inside
    assert environment["server"]["PREFECT_SERVER_UI_API_URL"] == f"http://127.0.0.1:{published}/api"
    for name in ("worker", "deploy"):
        assert environment[name]["PREFECT_API_URL"] == f"http://server:{inside}/api"
    assert f":{inside}/" in server["healthcheck"]["test"][-1]
    published, inside = files["ports"][0].removeprefix("127.0.0.1:").rsplit(":", 1)
    assert options(files["command"])["--port"] == inside
    assert environment["worker"]["DRL_MESHGEN_FILES"] == f"http://127.0.0.1:{published}"
    assert f":{inside}/" in files["healthcheck"]["test"][-1]
    postgres = environment["postgres"]
    given = f"postgresql+asyncpg://{postgres['POSTGRES_USER']}:{postgres['POSTGRES_PASSWORD']}@postgres:5432/"
    assert environment["server"]["PREFECT_SERVER_DATABASE_CONNECTION_URL"] == given + postgres["POSTGRES_DB"]


def test_workers_can_be_several():
    worker = SERVICES["worker"]
    assert "scale" in worker
    assert not {"container_name", "ports"} & set(worker)


def test_image_and_makefile_install_the_same_libraries():
    def libraries(text):
        return re.findall(r"\blib[a-z0-9-]+", text)

    wanted = libraries(MAKEFILE.partition("LIBRARIES := ")[2].partition("\n\n")[0])
    assert libraries(DOCKERFILE.partition("--no-install-recommends")[2].partition("&& rm")[0]) == wanted
    assert re.search(r"^TORCH := (.+)$", MAKEFILE, re.MULTILINE)[1] == re.search(r"ARG TORCH=(.+)", DOCKERFILE)[1]
