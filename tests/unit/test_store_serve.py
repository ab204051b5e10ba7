"""The file server serves the store and nothing else, and nothing of it that is damaged."""

import http.client
import os
import signal
import socket
import subprocess
import sys
import threading

import pytest

from drl_meshgen.store import Recipe, Store
from drl_meshgen.store.address import artifact_path
from drl_meshgen.store.serve import ArtifactServer

PAGE = b'<!doctype html><title>run</title><img src="pictures/a.png">'
FILES = {"index.html": PAGE, "pictures/a.png": b"\x89PNG", "mesh.vtu": b"<VTKFile/>", "big.bin": bytes(5 * 2**20)}


@pytest.fixture
def report(store):
    """Return a stored report."""

    def compute(folder):
        for name, content in FILES.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(content)

    return store.run(Recipe.of("report", 1, "0" * 64, {}, {"surfaces": ["hand", "<b>foot</b>"]}), compute)


@pytest.fixture
def server(store):
    with ArtifactServer(store, "127.0.0.1", 0) as served:
        thread = threading.Thread(target=served.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield served
        served.shutdown()
        thread.join()


def ask(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection(*server.server_address, timeout=60)
    connection.request(method, path, headers=headers)
    reply = connection.getresponse()
    body = reply.read()
    connection.close()
    return reply, body


def raw(server, request):
    """Send bytes and return the answer with its head."""
    with socket.create_connection(server.server_address, timeout=60) as link:
        link.sendall(request)
        link.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: link.recv(2**16), b""))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("index.html", "text/html; charset=utf-8"),
        ("pictures/a.png", "image/png"),
        ("mesh.vtu", "application/octet-stream"),
        ("big.bin", "application/octet-stream"),
    ],
)
def test_a_stored_file_is_served_under_its_address_with_its_type(server, report, name, kind):
    reply, body = ask(server, artifact_path(report, name))
    assert (reply.status, reply.headers["Content-Type"], body) == (200, kind, FILES[name])


def test_files_that_a_browser_cannot_show_are_downloads_under_their_name(server, report):
    reply, _ = ask(server, artifact_path(report, "mesh.vtu"))
    assert reply.headers["Content-Disposition"] == 'attachment; filename="mesh.vtu"'


def test_the_first_page_lists_runs_and_shows_names_as_text(server, report):
    _, body = ask(server, "/")
    assert artifact_path(report, "index.html").encode() in body
    assert b"hand, &lt;b&gt;foot&lt;/b&gt;" in body


def test_the_address_of_an_artifact_lists_its_files_and_no_others(server, report):
    _, body = ask(server, artifact_path(report))
    assert [name for name in FILES if artifact_path(report, name).encode() not in body] == []
    assert body.count(b"href=") == len(FILES) + 1


def test_health_tells_whether_the_store_is_there(server, store, report):
    assert ask(server, "/health")[0].status == 200
    store.root.rename(store.root.with_name("gone"))
    assert ask(server, "/health")[0].status == 503
    assert ask(server, artifact_path(report, "index.html"))[0].status == 404


def test_every_answer_forbids_to_guess_types_and_to_load_from_elsewhere(server, report):
    for path in ("/", "/health", "/nothing", artifact_path(report), artifact_path(report, "index.html")):
        headers = ask(server, path)[0].headers
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Content-Security-Policy"].startswith("default-src 'none'")
        assert "ython" not in headers["Server"]


def test_head_says_the_same_without_the_content(server, report):
    whole, _ = ask(server, artifact_path(report, "index.html"))
    head, body = ask(server, artifact_path(report, "index.html"), "HEAD")
    assert (body, head.headers["Content-Length"]) == (b"", whole.headers["Content-Length"])


def test_what_a_browser_has_already_is_not_sent_again(server, report):
    path = artifact_path(report, "index.html")
    tag = ask(server, path)[0].headers["ETag"]
    reply, body = ask(server, path, **{"If-None-Match": tag})
    assert (reply.status, body) == (304, b"")


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT"])
def test_nothing_can_be_written(server, report, method):
    reply, _ = ask(server, artifact_path(report, "index.html"), method)
    assert (reply.status, reply.headers["Allow"]) == (405, "GET, HEAD")


def damaged(place, kind):
    content = place.read_bytes()
    place.unlink()
    if kind == "altered":
        place.write_bytes(bytes([content[0] ^ 1]) + content[1:])
    elif kind == "truncated":
        place.write_bytes(content[:-1])
    elif kind == "folder":
        place.mkdir()
    elif kind == "pipe":
        os.mkfifo(place)
    elif kind == "link":
        outside = place.parents[3] / "outside"
        outside.write_bytes(content)
        place.symlink_to(outside)


@pytest.mark.parametrize("kind", ["altered", "truncated", "missing", "folder", "pipe", "link"])
@pytest.mark.parametrize("name", ["index.html", "big.bin"])
def test_a_damaged_file_is_gone_and_none_of_its_bytes_leaves(server, store, report, name, kind):
    damaged(store.objects.path(report.outputs[name]), kind)
    reply, body = ask(server, artifact_path(report, name), **{"If-None-Match": f'"{report.outputs[name]}"'})
    assert reply.status == 410
    assert body == b"the file is missing or damaged; running its stage again restores it\n"


@pytest.mark.parametrize("kind", ["altered", "truncated", "missing", "folder"])
def test_an_artifact_with_a_damaged_record_is_not_there(server, store, report, kind):
    damaged(store.record_path("report", report.key), kind)
    assert ask(server, artifact_path(report, "index.html"))[0].status == 404
    assert ask(server, "/")[0].status == 200


KEY = "{key}"
HOSTILE = [
    "/../../../../etc/passwd",
    "/artifacts/../../etc/passwd",
    f"/artifacts/report/{KEY}/../../../objects",
    f"/artifacts/report/{KEY}/%2e%2e/%2e%2e/secret",
    f"/artifacts/report/{KEY}/..%2f..%2fsecret",
    f"/artifacts/report/{KEY}/%252e%252e/secret",
    f"/artifacts/report/{KEY}/index.html%00.png",
    f"/artifacts/report/{KEY}/index.html\0",
    f"/artifacts/report/{KEY}//etc/passwd",
    f"/artifacts/report/{KEY}/..\\..\\secret",
    f"/artifacts/report/{KEY}/.partial-index.html",
    f"/artifacts/report/{KEY}/index.html/",
    f"/artifacts/report/{KEY}/./index.html",
    f"/artifacts/report/{KEY}/pictures",
    f"/artifacts/report/{KEY}/pictures/",
    f"/artifacts/report/{KEY}.json",
    "/artifacts/report/",
    "/artifacts/",
    "/records/report/{key}.json",
    "/objects/{sha}",
    "/locks/store",
    "/secret",
    "//secret",
    "file:///etc/passwd",
    "http://127.0.0.1/secret",
    "/artifacts/report/" + "a" * 5000,
    "*",
    "\xff\xfe",
]


@pytest.mark.parametrize("path", HOSTILE)
def test_no_request_leads_out_of_the_store(server, store, report, path):
    (store.root / "secret").write_text("root:secret")
    sha = report.outputs["index.html"]
    asked = path.format(key=report.key, sha=f"{sha[:2]}/{sha}").encode("latin-1")
    answer = raw(server, b"GET " + asked + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert answer.split(b" ", 2)[1] in (b"404", b"400")
    assert b"secret" not in answer
    assert b"root:" not in answer
    assert PAGE not in answer


@pytest.mark.parametrize(
    "request_",
    [
        b"",
        b"\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET " + b"/" * 70_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 200 + b"\r\n",
        b"GET / HTTP/1.1\r\nX: " + b"y" * 70_000 + b"\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"FETCH / HTTP/1.1\r\n\r\n",
        b"<script> / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: [::1\r\n\r\n",
    ],
)
def test_broken_requests_are_refused_and_the_next_is_answered(server, request_):
    answer = raw(server, request_)
    assert not answer.startswith((b"HTTP/1.0 2", b"HTTP/1.1 2"))
    assert b"<script>" not in answer
    assert not answer or b"nosniff" in answer
    assert ask(server, "/")[0].status == 200


@pytest.mark.parametrize("host", ["attacker.example", "127.0.0.1.attacker.example:4300", "10.0.0.1"])
def test_a_page_elsewhere_cannot_give_this_machine_a_name_of_its_own(server, host):
    assert ask(server, "/", Host=host)[0].status == 421


@pytest.mark.parametrize("host", ["localhost:4300", "127.0.0.1", "[::1]:4300"])
def test_the_names_of_this_machine_are_answered(server, host):
    assert ask(server, "/", Host=host)[0].status == 200


def test_serving_writes_nothing_into_the_store(server, store, report):
    before = sorted((path, path.stat().st_mtime_ns) for path in store.root.rglob("*"))
    for path in ("/", "/health", artifact_path(report), artifact_path(report, "index.html")):
        ask(server, path)
    assert sorted((path, path.stat().st_mtime_ns) for path in store.root.rglob("*")) == before


COMMAND = [sys.executable, "-m", "drl_meshgen.cli", "store", "serve"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(store, report, number):
    command = [*COMMAND, "--port", "0", "--store", str(store.root)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    port = int(process.stdout.readline().rpartition(":")[2])
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", artifact_path(report, "index.html"))
    assert connection.getresponse().read() == PAGE
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "Traceback" not in errors


def test_a_taken_port_is_one_sentence(run, store, server):
    result = run(store, "serve", "--port", server.server_address[1])
    assert result.exit_code == 3
    assert result.stderr.count("\n") == 1
    assert "--port" in result.stderr


def test_another_address_than_this_machines_is_refused_where_it_is_none(run, store):
    result = run(store, "serve", "--host", "no.such.host.invalid")
    assert result.exit_code == 3
    assert result.stderr.count("\n") == 1


def test_a_store_of_files_that_belong_to_others_is_served(store, report):
    """A worker writes, the file server runs as another user and only reads."""
    assert Store(store.root).record("report", report.key) is not None
    modes = [store.objects.path(sha).stat().st_mode & 0o444 for sha in report.outputs.values()]
    assert modes == [0o444] * len(modes)
