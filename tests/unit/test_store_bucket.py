"""Copies of artifacts to and from an S3 bucket, which a server on loopback plays."""

import pytest
import s3fs
from moto.server import ThreadedMotoServer

from drl_meshgen.store import Store, execute
from drl_meshgen.store.verify import verify
from tests.flow.toys import STAGES

PLACE = "s3://bucket/deep/store"


@pytest.fixture(scope="module")
def server():
    served = ThreadedMotoServer("127.0.0.1", 0)
    served.start()
    yield "http://{}:{}".format(*served.get_host_and_port())
    served.stop()


@pytest.fixture
def bucket(server, monkeypatch):
    """Return the file system of a server with one new bucket; credentials and address come from the environment."""
    for name, value in {"ACCESS_KEY_ID": "key", "SECRET_ACCESS_KEY": "secret", "DEFAULT_REGION": "us-east-1"}.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    monkeypatch.setenv("AWS_ENDPOINT_URL", server)
    s3fs.S3FileSystem.clear_instance_cache()
    system = s3fs.S3FileSystem(use_listings_cache=False)
    system.mkdir("bucket")
    yield system
    system.rm("bucket", recursive=True)


@pytest.fixture
def other(tmp_path):
    return Store(tmp_path / "other")


@pytest.mark.usefixtures("bucket")
def test_what_was_pushed_to_a_bucket_is_pulled_under_the_same_ids(run, store, refs, other):
    assert "sent 3 artifacts, 3 objects" in run(store, "push", PLACE).stdout
    assert "sent 0 artifacts, 0 objects" in run(store, "push", PLACE).stdout
    assert "fetched 3 artifacts, 3 objects" in run(other, "pull", PLACE).stdout
    assert execute(STAGES, store=other).refs == refs
    assert verify(other).damages == ()


def test_an_object_that_was_altered_in_the_bucket_is_not_pulled(run, store, refs, other, bucket):
    run(store, "push", PLACE)
    sha = refs["double"].outputs["value.json"]
    bucket.pipe(f"bucket/deep/store/objects/{sha[:2]}/{sha}", b"9")
    told = run(other, "pull", PLACE)
    assert told.exit_code == 1
    assert f"objects/{sha[:2]}/{sha} is missing or damaged there" in told.stderr
    assert verify(other).damages == ()


@pytest.mark.usefixtures("bucket", "refs")
def test_a_bucket_that_is_not_there_is_told_in_one_sentence(run, store):
    told = run(store, "push", "s3://nowhere/store")
    assert told.exit_code == 1
    assert told.stderr == "s3://nowhere/store: The specified bucket does not exist\n"


@pytest.mark.usefixtures("bucket", "refs")
def test_a_server_that_does_not_answer_is_told_in_one_sentence(run, store, monkeypatch):
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    s3fs.S3FileSystem.clear_instance_cache()
    told = run(store, "push", PLACE)
    assert told.exit_code == 1
    assert told.stderr.startswith(f"{PLACE}: Could not connect")
    assert len(told.stderr.splitlines()) == 1
