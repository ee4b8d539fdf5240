"""Commands of organisers who hide the truth: keygen, seal, verify-sealed."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from xden1k.commands import LOCAL_ROOT, json_option, open_root, print_json
from xden_bench.commands.shared import (
    FILE,
    FOLDER,
    progress_bar,
    root_option,
)

__all__ = ["keygen", "seal", "verify_sealed"]

required_key_option = click.option("--key", type=FILE, required=True, help="The key, from keygen.")


@click.command(epilog="Example: xden-bench keygen team.key --team 'Some Lab'")
@click.argument("keyfile", type=FILE)
@click.option("--team", metavar="NAME", help="Draw a key that signs entries, for this team.")
@json_option
def keygen(keyfile: Path, team: str | None, as_json: bool) -> None:
    """Draw a key.

    Without --team it seals and opens the answers of a private split. Keep a copy apart: without it
    the answers are lost, and whoever has it reads them. With --team it signs entries, notes and
    withdrawals; the public key, which it prints, tells whose they are.
    """
    from xden_bench.entries.signing import write_signing_key
    from xden_bench.sealed import write_key

    if team is None:
        kind, found = "key_id", write_key(keyfile).id
    else:
        kind, found = "public_key", write_signing_key(keyfile, team).public_key
    if as_json:
        print_json({"file": str(keyfile), kind: found})
    else:
        click.echo(f"{keyfile}: {'key' if team is None else 'public key'} {found}")


@click.command(epilog="Example: xden-bench seal dataset --key organiser.key --out sealed")
@click.argument("root", type=LOCAL_ROOT)
@required_key_option
@click.option("--out", type=FOLDER, required=True, help="The folder to make.")
@click.option(
    "--share", default=0.5, show_default=True, help="Of the test split that becomes private."
)
@json_option
def seal(root: Path, key: Path, out: Path, share: float, as_json: bool) -> None:
    """Divide the test split of a dataset folder, and seal the answers of one part.

    OUT gets public/, in which the split private holds inputs only, and sealed-truth.xden, the
    answers, which only the key opens. Both may be published.
    """
    from xden1k.folder import open_folder
    from xden_bench.sealed import read_key
    from xden_bench.sealed import seal as seal_folder

    made = seal_folder(open_folder(root), read_key(key), out, share=share, progress=progress_bar)
    if as_json:
        print_json({"out": str(out), **asdict(made)})
    else:
        click.echo(
            f"{out}: {len(made.private_ids)} objects private, {len(made.test_ids)} in test, "
            f"key {made.key_id}"
        )
    if made.simulated:
        click.echo(
            f"note: {made.simulated} private objects are simulated: whoever guesses their seed "
            "draws them again, so it must be random, of 64 bits or more, and stay secret",
            err=True,
        )


@click.command(
    "verify-sealed",
    epilog="Example: xden-bench verify-sealed sealed-truth.xden --key organiser.key",
)
@click.argument("sealed", type=FILE)
@root_option
@required_key_option
@json_option
def verify_sealed(sealed: Path, root: Path | str | None, key: Path, as_json: bool) -> None:
    """Compare sealed answers with the commitments published before.

    For everyone, once the organiser has published the key: whether an answer was changed. Prints
    each problem and exits with 1 if there is one.
    """
    from xden_bench.sealed import SealedTruth, check_sealed, read_key

    truth = SealedTruth(sealed, open_root(root), read_key(key))
    problems = check_sealed(truth, progress_bar)
    if as_json:
        values = {"objects": len(truth.commitments), "problems": problems}
        print_json({"file": str(sealed), **values})
    else:
        good = f"{sealed}: {len(truth.commitments)} objects, all as committed to"
        click.echo("\n".join(problems) or good)
    if problems:
        raise SystemExit(1)
