"""The organiser's procedure of docs/manual/organise.md, from a throwaway key to its successor."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from xden1k.folder import open_folder
from xden1k.folder.verify import verify_folder
from xden_bench.cli import cli
from xden_builder.cli import cli as builder_cli

SEED, NEXT_SEED = 0xB2C1_7F60_93D4_A58E, 0x9E37_79B9_7F4A_7C15
PRIVATE = ("--root", "challenge/public", "--split", "private")
KEY = ("--sealed", "challenge/sealed-truth.xden", "--key", "organiser.key")


def run(*words: str) -> Result:
    return CliRunner().invoke(cli, words)


def done(*words: str) -> str:
    result = run(*words)
    assert result.exit_code == 0, result.stderr
    return result.stdout


def make(out: str, seed: int) -> None:
    words = f"phantoms {out} --as-dataset --count 20 --size 32 --split test --seed {seed}"
    chosen = ["--categories", "pencil,eraser", "--workers", "1"]
    made = CliRunner().invoke(builder_cli, [*words.split(), *chosen])
    assert made.exit_code == 0, made.stderr


def published(root: Path) -> list[bytes]:
    """Each file as it is, and the values of each table without compression."""
    files = [path for path in root.rglob("*") if path.is_file()]
    tables = [pq.read_table(path) for path in files if path.suffix == ".parquet"]
    values = [repr(table.to_pylist()).encode() for table in tables]
    return [path.read_bytes() for path in files] + values


def spellings(seed: int) -> list[bytes]:
    """A seed as text and as bytes, and its checksum."""
    text = str(seed).encode()
    hexadecimal = f"{seed:x}".encode()
    digest = hashlib.sha256(text).hexdigest().encode()
    return [text, hexadecimal, hexadecimal.upper(), digest] + [
        seed.to_bytes(8, order) for order in ("little", "big")
    ]


@pytest.mark.slow
def test_the_procedure_of_the_manual_keeps_the_secret_and_can_be_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    make("truth", SEED)
    assert str(SEED).encode() in b"".join(published(Path("truth")))  # what is looked for below
    done("keygen", "organiser.key")
    sealed = ("seal", "truth", "--key", "organiser.key", "--out", "challenge", "--share", "0.75")
    assert len(json.loads(done(*sealed, "--json"))["private_ids"]) == 3

    public = published(Path("challenge"))
    key = Path("organiser.key").read_text().split()[1].encode()
    settings = open_folder("truth").manifest.config_sha256.encode()
    for secret in (*spellings(SEED), key, settings):
        assert not any(secret in content for content in public)
    assert verify_folder(Path("challenge/public")) == []

    done("baseline", "water", *PRIVATE, "--out", "preds.npz")
    done("validate", "preds.npz", *PRIVATE)
    assert run("score", "preds.npz", *PRIVATE).exit_code == 1  # nobody without the key
    entry = json.loads(done("submit", "preds.npz", *PRIVATE, *KEY, "--out", "kept", "--json"))
    assert entry["status"] == "by the organiser"
    assert entry["dataset"]["split"] == "private"

    checked = ("verify-sealed", "challenge/sealed-truth.xden", "--root", "challenge/public")
    assert "all as committed to" in done(*checked, "--key", "organiser.key")
    done("verify", entry["file"], "--submission", "preds.npz", *PRIVATE[:2], *KEY)

    make("truth-2", NEXT_SEED)
    done("keygen", "next.key")
    done("seal", "truth-2", "--key", "next.key", "--out", "challenge-2", "--share", "0.75")
    old = ("--sealed", "challenge-2/sealed-truth.xden", "--key", "organiser.key")
    new_root = ("--root", "challenge-2/public", "--split", "private")
    done("baseline", "water", *new_root, "--out", "preds-2.npz")
    assert (
        run("score", "preds-2.npz", *new_root, *old).exit_code == 1
    )  # the leaked key is worth nothing
