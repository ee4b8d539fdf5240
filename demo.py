"""The whole way once, on simulated objects: ``make demo``.

Simulates captures, rebuilds them, audits the result, loads it, runs the baselines and prints the
leaderboard. Every line that starts with a dollar sign is a command to try.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click

OUT = Path("demo-output")
COUNT, SEED = 24, 1
CATEGORIES = (
    "screwdriver,hammer,pliers,water_bottle,mug,kettle,flashlight,remote_control,"
    "scissors,teapot,power_drill,thermos"
)
BASELINES = ("zero", "water", "train-median", "category-median")


def run(line: str) -> None:
    """Show a command of ours and run it; stop the demo if it fails."""
    click.secho(f"\n$ {line}", bold=True)
    words = shlex.split(line)
    program = Path(sys.executable).with_name(words[0])  # of this environment, whatever PATH says
    subprocess.run([str(program), *words[1:]], check=True)  # noqa: S603


def main() -> None:
    """Run the demo."""
    shutil.rmtree(OUT, ignore_errors=True)
    same = f"--count {COUNT} --seed {SEED} --categories {CATEGORIES}"
    run(f"xden-build phantoms {OUT}/captures {same}")
    run(f"xden-build run {OUT}/captures --out {OUT}/dataset")
    run(f"xden-build audit {OUT}/dataset --captures {OUT}/captures")
    run(f"xden verify {OUT}/dataset")
    load()
    click.secho("\nThe benchmark: the simulator's truth, and predictions of it", bold=True)
    run(f"xden-build phantoms {OUT}/truth {same} --as-dataset")
    for name in BASELINES:
        predict(f"baseline {name}", name)
    predict(f"baseline root --from {OUT}/dataset", "root")
    run(f"xden-bench leaderboard --results {OUT}/results --out {OUT}/LEADERBOARD.md")
    click.echo(f"\ncontact sheet: {sheet()}")


def predict(command: str, name: str) -> None:
    """Write a submission and enter it."""
    preds = f"{OUT}/{name}.npz"
    run(f"xden-bench {command} --root {OUT}/truth --out {preds}")
    run(f"xden-bench submit {preds} --root {OUT}/truth --out {OUT}/results")


def load() -> None:
    """Load the rebuilt dataset through ``datasets``."""
    from datasets import load_dataset

    import xden1k  # noqa: F401  registers the name

    root = str(OUT.resolve() / "dataset")
    click.secho(f'\n>>> load_dataset("xden1k", data_dir="{root}", split="test")', bold=True)
    for row in load_dataset("xden1k", data_dir=root, split="test"):
        click.echo(f"{row['object_id']:<24} {row['mass_g']:8.1f} g  density {row['density'].shape}")


def sheet() -> Path:
    """Draw every rebuilt object."""
    from xden1k.folder import open_folder
    from xden1k.pictures.figures import contact_sheet

    path = OUT / "contact-sheet.png"
    contact_sheet(open_folder(OUT / "dataset").objects(), path)
    return path


if __name__ == "__main__":
    main()
