"""The train flow: what it hands to training, and what it shows of it. Training itself is tested beside the learner."""

import pandas as pd
import pytest

from drl_meshgen.errors import InputError
from drl_meshgen.export import write_table
from drl_meshgen.progress import counter
from drl_meshgen.rl import train as module
from flows.train import page, train

COLUMNS = [f"{one} {name}" for one in ("easy", "hard") for name in ("reward", "orthogonality", "jacobian", "valid")]


def curve(*steps):
    return pd.DataFrame([{"step": s} | dict.fromkeys(COLUMNS, s / 100) for s in steps])


@pytest.fixture
def given(monkeypatch):
    """What a stand-in for training was called with."""
    calls = []

    def stub(out, **options):
        calls.append(options)
        step = counter("training steps", 20)
        step("reward 0.1")
        out.mkdir(parents=True)
        write_table(out / "curve.parquet", curve(10, 20))
        return options.get("minutes") is None

    monkeypatch.setattr(module, "train", stub)
    return calls


@pytest.mark.usefixtures("server")
def test_the_flow_hands_on_what_is_given_and_leaves_the_rest_to_training(given, tmp_path):
    state = train(seed=7, out=str(tmp_path / "a"), return_state=True)
    assert state.message == "trained after 20 steps"
    assert state.result() == str(tmp_path / "a/agent.safetensors")
    early = train(minutes=2, steps=50, out=str(tmp_path / "b"), return_state=True)
    assert early.message == "ended early after 20 steps"
    assert given == [{"seed": 7, "threads": 1}, {"minutes": 2, "steps": 50, "threads": 1}]


@pytest.mark.usefixtures("server")
def test_what_is_wrong_is_the_state_of_the_run(monkeypatch, tmp_path):
    def refuse(_out, **_options):
        raise InputError("checkpoint", "is of other networks")

    monkeypatch.setattr(module, "train", refuse)
    state = train(out=str(tmp_path), return_state=True)
    assert state.is_failed()
    assert isinstance(state.result(raise_on_failure=False), InputError)


def test_the_page_shows_the_curve_and_the_last_figures():
    written = page(curve(10, 20), "trained after 20 steps", "out/x", ended=True)
    assert "# Training: trained after 20 steps" in written
    assert "(data:image/jpeg;base64," in written
    assert "| easy | 0.2000 | 0.2000 | 0.2000 | 0.2000 |" in written
    assert "goes on" not in written
    assert "goes on" in page(curve(10), "ended early", "out/x", ended=False)
