"""A hidden challenge, from the key to the score, as an organiser and a team meet it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from tests.bench.sealing import Sealed
from xden1k.folder import open_folder
from xden_bench.cli import cli
from xden_bench.entries.reading import read_entry
from xden_bench.serve.explorer import Explorer

Run = Callable[..., Result]
PRIVATE = ("--root", "out/public", "--split", "private")
OPEN = (*PRIVATE, "--sealed", "out/sealed-truth.xden", "--key", "organiser.key")


def run(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])


@pytest.fixture(scope="module")
def challenge(tmp_path_factory: pytest.TempPathFactory, sealed: Sealed) -> Path:
    """A sealed dataset and a submission for its private split."""
    folder = tmp_path_factory.mktemp("challenge")
    (folder / "whole").symlink_to(sealed.whole.root)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert run("keygen", "organiser.key").exit_code == 0
        assert run("keygen", "other.key").exit_code == 0
        made = run("seal", "whole", "--key", "organiser.key", "--out", "out")
        assert made.exit_code == 0, made.stderr
        predicted = run("baseline", "category-median", *PRIVATE, "--out", "preds.npz")
        assert predicted.exit_code == 0, predicted.stderr
    return folder


@pytest.fixture(autouse=True)
def here(challenge: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(challenge)


def test_seal_says_what_it_made_and_warns_of_seeds(tmp_path: Path) -> None:
    out = tmp_path / "out"
    made = run("seal", "whole", "--key", "organiser.key", "--out", out, "--share", "0.25", "--json")
    values = json.loads(made.stdout)
    assert len(values["private_ids"]) == 4
    assert len(values["test_ids"]) == 12
    assert "note: 4 private objects are simulated: whoever guesses their seed" in made.stderr
    again = run("seal", "whole", "--key", "organiser.key", "--out", out)
    assert again.exit_code == 1
    assert "exists: remove it yourself" in again.stderr


def test_keygen_says_its_id_and_keeps_the_secret(tmp_path: Path) -> None:
    made = run("keygen", tmp_path / "my.key", "--json")
    assert len(json.loads(made.stdout)["key_id"]) == 16
    secret = (tmp_path / "my.key").read_text().split()[1]
    assert secret not in made.output
    again = run("keygen", tmp_path / "my.key")
    assert (again.exit_code, len(again.stderr.splitlines())) == (1, 1)


def test_a_team_checks_its_file_without_the_key() -> None:
    assert run("validate", "preds.npz", *PRIVATE).stdout == "preds.npz: valid\n"
    assert run("template", *PRIVATE, "--out", "empty.npz").exit_code == 0


@pytest.mark.parametrize("command", ["score", "submit"])
def test_without_the_key_there_is_no_score(command: str) -> None:
    done = run(command, "preds.npz", *PRIVATE)
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert line.endswith(
        "the answers of the split private are sealed: scoring needs the organiser's sealed truth "
        "and key"
    )


def test_the_organiser_scores_and_the_entry_says_so() -> None:
    entry = json.loads(run("score", "preds.npz", *OPEN, "--json").stdout)
    assert entry["dataset"]["split"] == "private"
    assert entry["status"] == "by the organiser"
    assert entry["n_objects"] == 8
    assert 0 < entry["metrics"]["mass_mape"]["mean"] < 5


def test_an_entry_of_sealed_truth_goes_where_the_organiser_says(tmp_path: Path) -> None:
    refused = run("submit", "preds.npz", *OPEN)
    assert refused.exit_code == 2
    assert "The scores of single objects tell their answers" in refused.stderr
    assert not Path("benchmarks").exists()
    done = run("submit", "preds.npz", *OPEN, "--out", tmp_path / "results", "--json")
    assert Path(json.loads(done.stdout)["file"]).is_file()


@pytest.fixture
def entered(tmp_path: Path) -> str:
    """An entry of the private split."""
    done = run("submit", "preds.npz", *OPEN, "--out", tmp_path / "results", "--json")
    return str(json.loads(done.stdout)["file"])


def test_the_organiser_verifies_an_entry(entered: str) -> None:
    for words in (("--submission", "preds.npz"), ()):
        done = run("verify", entered, *words, "--root", "out/public", *OPEN[4:], "--json")
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["same"]
    done = run("verify", entered, "--root", "out/public")
    assert done.exit_code == 1
    assert "the answers of the split private are sealed" in done.stderr


@pytest.mark.slow
def test_the_organiser_compares_and_no_object_is_listed(entered: str) -> None:
    words = ("compare", "preds.npz", entered, *OPEN, "--json")
    for one in json.loads(run(*words).stdout)["metrics"].values():
        assert one["difference"]["mean"] == 0.0
    assert run("baseline", "zero", *PRIVATE, "--out", "zero.npz").exit_code == 0
    found = json.loads(run("compare", "zero.npz", entered, *OPEN, "--json").stdout)["metrics"]
    assert found["density_mae_g_cm3"]["difference"]["mean"] > 0.0
    assert all(one["largest"] == [] for one in found.values())
    refused = run("compare", "zero.npz", entered, *PRIVATE)
    assert refused.exit_code == 1
    assert "the answers of the split private are sealed" in refused.stderr


def test_the_web_app_shows_neither_private_objects_nor_their_scores(
    entered: str, tmp_path: Path
) -> None:
    folder = open_folder(Path("out/public"))
    explorer = Explorer(folder, lambda _: None, tmp_path)
    assert "private" not in explorer.splits
    assert explorer.methods((read_entry(Path(entered)),), "private") == {}


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ((*PRIVATE, "--key", "organiser.key"), 2, "--sealed, --key and the split private go"),
        ((*OPEN, "--split", "test"), 2, "--sealed, --key and the split private go together"),
        ((*OPEN, "--key", "other.key"), 1, "was sealed with the key"),
        ((*OPEN, "--key", "none.key"), 1, "none.key: No such file or directory"),
        ((*OPEN, "--sealed", "none.xden"), 1, "none.xden: No such file or directory"),
        ((*OPEN, "--sealed", "preds.npz"), 1, "not a sealed truth: no seal.json"),
        ((*OPEN, "--root", "whole"), 1, "belongs to the dataset of manifest"),
    ],
)
def test_errors_are_one_line(words: tuple[str, ...], code: int, message: str) -> None:
    done = run("score", "preds.npz", *words)
    assert done.exit_code == code
    assert message in done.stderr
    assert code == 2 or len(done.stderr.splitlines()) == 1


def test_everyone_checks_the_answers_once_the_key_is_out(tmp_path: Path) -> None:
    words = ("--root", "out/public", "--key", "organiser.key")
    done = run("verify-sealed", "out/sealed-truth.xden", *words)
    assert done.exit_code == 0
    assert done.stdout == "out/sealed-truth.xden: 8 objects, all as committed to\n"
    data = bytearray(Path("out/sealed-truth.xden").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "s.xden").write_bytes(data)
    done = run("verify-sealed", tmp_path / "s.xden", *words, "--json")
    assert done.exit_code == 1
    assert len(json.loads(done.stdout)["problems"]) == 1
