"""``xden-build audit``: a dataset against its radiographs and CTs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from xden1k.commands import DONE_IN_PART, LOCAL_ROOT, json_option, print_json
from xden_builder.commands.shared import FOLDER, progress_bar, workers_option

if TYPE_CHECKING:
    from xden_builder.audit.run import AuditReport

__all__ = ["audit"]


@click.command(epilog="Example: xden-build audit dataset --captures captures")
@click.argument("root", type=LOCAL_ROOT)
@click.option("--captures", type=FOLDER, required=True, help="What the dataset was made from.")
@workers_option
@json_option
def audit(root: Path, captures: Path, workers: int, as_json: bool) -> None:
    """Compare a dataset with its radiographs and CTs.

    Its parts are projected again with the attenuation that was fitted. Exits with 3 if a view does
    not show its object's parts (correlation below 0.9), or an object could not be audited.
    """
    from xden1k.folder import open_folder
    from xden_builder.audit.run import audit_folder

    with progress_bar(len(open_folder(root).ids())) as bar:
        report = audit_folder(root, captures, workers=workers, on_done=lambda _: bar.update())
    if as_json:
        print_json(report.to_dict())
    else:
        _echo_audits(report)
    if not report.good:
        raise SystemExit(DONE_IN_PART)


def _echo_audits(report: AuditReport) -> None:
    from tabulate import tabulate

    headers = ["object", "view", "T MAE", "T corr", "p MAE", "p corr", "T MAE beside", "verdict"]
    rows = [
        (
            one.object_id,
            view.name if view.fitted else f"{view.name} (unseen)",
            f"{view.transmission_mae:.2g}",
            f"{view.transmission_corr:.5f}",
            f"{view.attenuation_mae:.2g}",
            f"{view.attenuation_corr:.5f}",
            f"{view.background_transmission_mae:.2g}",
            view.verdict.upper() if view.verdict == "bad" else view.verdict,
        )
        for one in report.audits
        for view in one.views
    ]
    click.echo(tabulate(rows, headers, disable_numparse=True))
    for one in report.audits:
        if one.ct:
            click.echo(
                f"{one.object_id} against its CT: voxel MAE {one.ct.voxel_mae_per_cm:.3g}/cm "
                f"({one.ct.voxel_mae_rel:.1%}), mass ratio {one.ct.mass_ratio:.4f}, "
                f"centre of mass off by {one.ct.com_l1_cm:.2g} cm (L1)"
            )
    click.echo("T = transmission, p = -ln T, on pixels whose ray meets the object; beside = air")
    for object_id, message in report.failures:
        click.echo(f"failed: {object_id}: {message}", err=True)
