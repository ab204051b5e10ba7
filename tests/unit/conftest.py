"""What the tests of the artifact store have in common."""

import pytest
from typer.testing import CliRunner

from drl_meshgen.cli import app
from drl_meshgen.store import Store, execute
from tests.flow.toys import STAGES


@pytest.fixture
def run():
    """Run `drl-meshgen store` on a store."""

    def command(store, *arguments):
        return CliRunner().invoke(app, ["store", *map(str, arguments), "--store", str(store.root)])

    return command


@pytest.fixture
def store(tmp_path):
    """Return an empty store."""
    return Store(tmp_path / "store")


@pytest.fixture
def refs(store):
    """Return the artifacts of the toy stages, in the store."""
    return execute(STAGES, store=store).refs
