import numpy as np
import pytest
import torch

from drl_meshgen.errors import InputError
from drl_meshgen.export import read_table
from drl_meshgen.rl import DataSet, samples_of
from drl_meshgen.rl import train as training
from drl_meshgen.rl.checkpoint import read_checkpoint, write_checkpoint
from drl_meshgen.rl.console import run
from drl_meshgen.rl.learning import Bank, Learner, LearnOptions
from drl_meshgen.rl.networks import weights_of
from drl_meshgen.rl.policy_file import read_card
from drl_meshgen.rl.train_transitions import train_transitions

TINY = LearnOptions(steps=8, polish=2, domains=4, sizes=(24, 40), width=16, drawn=20)


@pytest.fixture(scope="module")
def bank():
    sets = [[sample.domain for sample in samples_of(data, range(3))] for data in (DataSet.TRAIN, DataSet.TRAIN_HARD)]
    return Bank(*sets)


def test_training_goes_on_from_a_checkpoint_as_if_never_interrupted(bank, tmp_path):
    straight, first, second = (Learner(bank, TINY) for _ in range(3))
    for _ in range(8):
        straight.advance()
    for _ in range(5):
        first.advance()
    write_checkpoint(tmp_path / "checkpoint.safetensors", first)
    read_checkpoint(tmp_path / "checkpoint.safetensors", second)
    for _ in range(3):
        second.advance()
    ends = [weights_of(one.networks) for one in (straight, second)]
    assert all(np.array_equal(ends[0][key], ends[1][key]) for key in ends[0])
    with pytest.raises(InputError, match="checkpoint of other networks"):
        read_checkpoint(tmp_path / "checkpoint.safetensors", Learner(bank, LearnOptions(width=8)))


def test_a_run_leaves_policy_early_policy_and_curve(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "EXAMINED", 2)
    monkeypatch.setattr(training, "EVERY", 5)
    threads = torch.get_num_threads()
    try:
        given = {"steps": 10, "seed": 3, "domains": 4, "transition_steps": 2, "threads": 1}
        assert not training.train(tmp_path, **given, minutes=0)
        assert read_table(tmp_path / "curve.parquet")["step"].tolist() == [1]
        assert training.train(tmp_path, **given)
        before = (tmp_path / "agent.safetensors").read_bytes()
        assert training.train(tmp_path, **given)
    finally:
        torch.set_num_threads(threads)
    curve = read_table(tmp_path / "curve.parquet")
    assert curve["step"].tolist() == [1, 5, 10]
    assert (curve["episodes"] == curve["step"] * 16 * 12).all()
    assert read_card(tmp_path / "early.safetensors")["steps"] == 1
    assert read_card(tmp_path / "agent.safetensors")["validation"].keys() == {
        f"{key} {name}"
        for key in ("validation", "validation-hard")
        for name in ("reward", "orthogonality", "jacobian", "valid")
    }
    assert (tmp_path / "agent.safetensors").read_bytes() == before
    assert list((tmp_path / "tensorboard").iterdir())


def test_a_damaged_checkpoint_ends_training_with_one_sentence(tmp_path, capsys, monkeypatch):
    (tmp_path / "transitions.safetensors").write_bytes(b"half a")
    monkeypatch.setattr("sys.argv", ["train_transitions", "--out", str(tmp_path), "--steps", "1"])
    with pytest.raises(SystemExit) as end:
        run(train_transitions)
    assert end.value.code == 3
    assert capsys.readouterr().err == "transitions.safetensors: is no whole checkpoint; delete it and begin anew\n"
